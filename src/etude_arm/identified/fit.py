"""From samples to a possible robot, with its error on segments that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array, Samples
from etude_arm.identified.consistent import Consistent, consistent
from etude_arm.identified.files import JointTerms
from etude_arm.identified.links import Links, links_of
from etude_arm.identified.normal import Evidence
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.rigid_body import EXTRA_TERMS
from etude_arm.spec import ArmSpec

MOST_FOLDS = 10


@dataclass(frozen=True, eq=False)
class Errors:
    """Root mean square errors on segments left out, (J,) each, command units.

    Attributes:
        file: of the model file's inertias; found: of the possible ones; both with each drive's friction,
            armature and offset fitted to the other segments.
        segments: how many there are; 0: one alone, so nothing could be left out.
    """

    file: Array
    found: Array
    segments: int


@dataclass(frozen=True, eq=False)
class Identified:
    """Attributes:
    links: the bodies of the file. result: their parameters. own: (J, E) terms of the drives.
    deviation: (J,) of the commands' noise. errors: on segments left out.
    """

    links: Links
    result: Consistent
    own: Array
    deviation: Array
    errors: Errors

    def terms(self, spec: ArmSpec) -> dict[str, JointTerms]:
        """Armature, damping and friction by joint, of drives that are one joint's; none below zero."""
        found = {}
        for j, (name, drive) in enumerate(zip(spec.names, self.links.drives, strict=True)):
            turns = drive.gear * drive.coefficients
            if len(drive.bodies) or np.count_nonzero(turns) != 1 or turns[j] == 0.0:
                continue
            own, turn = dict(zip(EXTRA_TERMS, self.own[j].tolist(), strict=True)), abs(float(turns[j]))
            armature, damping = (max(0.0, own[term]) * turn**2 for term in ("armature", "viscous"))
            friction = sum(value for term, value in own.items() if term.startswith("friction"))
            found[name] = JointTerms(armature, damping, max(0.0, friction) * turn)
        return found


def identified(samples: Samples, spec: ArmSpec, mean: RigidBodyMean) -> Identified:
    """The possible robot nearest to the file that explains the samples' commands.

    Args:
        samples: of all logs. mean: the identified model of the same samples, for the noise.

    Raises:
        NumericalError: no possible inertias explain the commands.
    """
    links = links_of(spec)
    evidence = Evidence.of(samples, spec, links, mean)
    whole = evidence.normal()
    result = consistent(*evidence.reduced(whole), links.nominal)
    own = evidence.own_terms(whole, result.phi)
    return Identified(links, result, own, evidence.deviation, _left_out(evidence, links, samples))


def _left_out(evidence: Evidence, links: Links, samples: Samples) -> Errors:
    groups = np.unique(samples.group)
    folds = np.array_split(groups, min(len(groups), MOST_FOLDS))
    if len(folds) < 2:
        unknown = np.full(len(evidence.deviation), np.nan)
        return Errors(unknown, unknown, 0)
    squares = []
    for fold in folds:
        others = evidence.normal([int(g) for g in groups if g not in fold])
        result = consistent(*evidence.reduced(others), links.nominal)
        squares.append(
            [
                evidence.squared_error(phi, evidence.own_terms(others, phi), fold.tolist())
                for phi in (links.nominal, result.phi)
            ]
        )
    file, found = np.sqrt(np.nanmean(squares, axis=0))
    return Errors(file, found, len(groups))
