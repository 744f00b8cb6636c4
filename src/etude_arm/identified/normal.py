"""What logs say of the inertial parameters that all commands share: a quadratic form for each segment.

Beside them each drive has terms of its own (armature, friction, offset), which are taken out of the form with
their prior, as `physics.rigid_body` has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.types import Array, Index, Samples
from etude_arm.identified.links import Links
from etude_arm.physics.estimate import information_per_sample, output_priors
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.physics.rigid_body import command_regressors
from etude_arm.spec import PATH, PLAN, ArmSpec


@dataclass(frozen=True, eq=False)
class Normal:
    """Information A (J, n, n) and b (J, n) of each command on [phi, its own terms], n = P + E."""

    A: Array
    b: Array

    def __add__(self, other: Normal) -> Normal:
        return Normal(self.A + other.A, self.b + other.b)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Samples, as rows of regressors in units of the noise.

    Attributes:
        rows: of each command (n, P + E) and its commands (n,), both divided by the noise's deviation.
        group: of each command (n,), which segment a row is of.
        weight: of one sample, since neighbours repeat each other.
        own: (J, E) prior deviations of each drive's own terms.
        deviation: (J,) the noise's, command units.
    """

    rows: Sequence[tuple[Array, Array]]
    group: Sequence[Index]
    weight: float
    own: Array
    deviation: Array

    @staticmethod
    def of(samples: Samples, spec: ArmSpec, links: Links, found: RigidBodyMean) -> Evidence:
        """Of the samples in which a joint moves; noise and friction velocity are those of `found`."""
        motion = tuple(samples.log[name] for name in (PLAN if found.desired else PATH))
        model, tree, drives = found.model, links.tree, links.drives
        v0 = model.friction_velocity
        both = np.concatenate(command_regressors(tree, drives, v0, *motion), axis=2)
        own = np.array([prior.extra for prior in output_priors(spec, tree, drives, v0)])
        rows, groups = [], []
        for j in range(spec.dof):
            used = samples.moving[:, j] & samples.usable[:, j]
            noise = float(model.deviation[j])
            rows.append((both[used, j] / noise, samples.command[used, j] / noise))
            groups.append(samples.group[used])
        return Evidence(rows, groups, information_per_sample(samples), own, model.deviation)

    def normal(self, groups: Sequence[int] | None = None) -> Normal:
        """Of those groups, or of all."""
        found = []
        for (rows, y), group in zip(self.rows, self.group, strict=True):
            used = slice(None) if groups is None else np.isin(group, groups)
            found.append((self.weight * rows[used].T @ rows[used], self.weight * rows[used].T @ y[used]))
        A, b = zip(*found, strict=True)
        return Normal(np.array(A), np.array(b))

    def reduced(self, normal: Normal) -> tuple[Array, Array]:
        """H (P, P) and g (P,) of phi alone, the drives' own terms at their best."""
        P = normal.A.shape[1] - self.own.shape[1]
        H, g = np.zeros((P, P)), np.zeros(P)
        for A, b, own in zip(normal.A, normal.b, self.own, strict=True):
            gain = np.linalg.solve(A[P:, P:] + np.diag(own**-2), A[P:, :P]).T
            H += A[:P, :P] - gain @ A[P:, :P]
            g += b[:P] - gain @ b[P:]
        return 0.5 * (H + H.T), g

    def own_terms(self, normal: Normal, phi: Array) -> Array:
        """(J, E) the drives' own terms beside phi."""
        P = len(phi)
        return np.array(
            [
                np.linalg.solve(A[P:, P:] + np.diag(own**-2), b[P:] - A[P:, :P] @ phi)
                for A, b, own in zip(normal.A, normal.b, self.own, strict=True)
            ]
        )

    def squared_error(self, phi: Array, own: Array, groups: Sequence[int]) -> Array:
        """(J,) mean squared error on those groups, command units squared."""
        found = []
        for j, ((rows, y), group) in enumerate(zip(self.rows, self.group, strict=True)):
            used = np.isin(group, groups)
            residual = y[used] - rows[used] @ np.concatenate([phi, own[j]])
            found.append(float(np.mean(residual**2)) if used.any() else np.nan)
        return np.asarray(np.array(found) * self.deviation**2)
