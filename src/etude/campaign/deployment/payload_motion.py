"""Motion of `etude ask --payload`: ten seconds that identify the load; no model learns from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.abilities import SupportsVariations
from etude.campaign.deployment.payload import TOLD, apparent_of, weighable
from etude.campaign.propose.ask import Proposal, presented
from etude.campaign.propose.constraints import Constraints, constraints_now, constraints_then
from etude.campaign.propose.export import require_formats
from etude.campaign.propose.proposal import roam_of
from etude.campaign.propose.typical_motions import from_rest
from etude.campaign.record.controls import FEEDBACK
from etude.campaign.record.deployed_model import deployed_model
from etude.campaign.record.events import Asked
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import FULL, require_description, take_up
from etude.campaign.record.stored_models import newest_model
from etude.deploy.trajectory_files import TrajectoryFiles, render
from etude.design.candidates import ClearPoseSource, SampledPoint, Source
from etude.design.objective import instants
from etude.design.solve import search
from etude.errors import UsageError
from etude.limits.commands import require_possible
from etude.models import LearnedModel, load_forecast, whole_mass
from etude.models.accuracy import NORMAL_95
from etude.protocols import Family, Inputs, Limit
from etude.types import Array, Log

STREAM = 7
"""Stream that separates the random numbers of these motions from those of other proposals and tests."""
DURATION_S = 10.0
"""Of a motion, without its lead-in."""
CORRELATED_S = 0.5
"""s, correlation time of errors: samples within it count as one."""
POINTS = 50
"""Number of instants of a motion: five per second."""
CANDIDATES = 48
"""Number of random motions, of which the best is refined."""
REGIONS = 4
"""Number of searches for motions between obstacles; each finds two."""
SHARE = 0.2
"""Fraction of the mass that uses all of some command: about a rated load."""
REFINED, STEPS = 1, 12
"""Refined candidates, and iterations: on a UR10 deviations fall by a fifth, in about ten seconds."""
STEP = 1e-5
"""Step of finite differences, as a fraction of a parameter's size."""


@dataclass(frozen=True, eq=False)
class Weighs:
    """Information of a motion on a load: minus half the log determinant of the posterior covariance of mass
    and first moments. Implements `objective.SearchFunction`.

    Attributes:
        model, body, apparent, mass: see `load_forecast`.
        family: of motions. inputs: of the model.
    """

    model: LearnedModel
    body: SupportsVariations
    apparent: Array | None
    mass: float
    family: Family
    inputs: Inputs

    def of(self, family: Family) -> Weighs:
        return replace(self, family=family)

    def covariance(self, p: Array) -> Array:
        """(4, 4) posterior covariance after the motion of p (P,)."""
        duration = self.family.trajectory(p).duration
        times, keep = instants(duration, POINTS, self.inputs.rate)
        motion = self.family.motion(p, times, self.inputs.orders)
        log, gains = self.inputs.states(motion), self.inputs.plan(motion, keep).gains
        log = log if keep is None else log.take(keep)
        votes = max(duration / CORRELATED_S, 1.0) / len(log)
        weight = np.sqrt(min(votes, 1.0)) * gains
        return load_forecast(self.model, log, weight, self.body, self.mass, self.apparent)

    def value(self, p: Array) -> float:
        return -0.5 * float(np.linalg.slogdet(self.covariance(p))[1])

    def value_and_gradient(self, p: Array) -> tuple[float, Array]:
        """Value and gradient (P,) by forward differences; it costs as much as a few candidates."""
        value, gradient = self.value(p), np.zeros_like(p)
        for i in range(len(p)):
            moved = p.copy()
            moved[i] += STEP * max(abs(p[i]), 1.0)
            gradient[i] = (self.value(moved) - value) / (moved[i] - p[i])
        return value, gradient


def ask_to_weigh(
    campaign: Campaign,
    *,
    new: bool = False,
    speed: int = FULL,
    formats: Sequence[str] = (),
    start: str = "",
    say: Say = lambda _: None,
) -> Proposal:
    """The open motion that identifies the load at the hand, or a new one.

    Args:
        campaign: the folder.
        new: propose another one although one is open.
        speed, formats, start: as of `ask`.
        say: receives one sentence per step.

    Raises:
        UsageError: nothing was learned yet, the robot's links are unknown, no command depends on a load, a
            file was changed, or a format is unknown or not for this robot.
        UnsafeTrajectoryError: no such motion inside the limits; nothing is written.
    """
    require_formats(campaign, formats)
    with campaign.writing():
        require_description(campaign)
        state = campaign.state()
        made, open_ones = None, state.weighings
        if open_ones and not new:
            number = open_ones[-1].number
            constraints = constraints_then(campaign.round(number).asked)
        else:
            number, constraints = state.next_number, constraints_now(campaign, state, FEEDBACK)
            made = _propose(campaign, state, number, constraints, say)
        proposal = presented(campaign, number, constraints, made, speed, start, formats)
        take_up(campaign)
        return proposal


def _propose(
    campaign: Campaign, state: State, number: int, constraints: Constraints, say: Say
) -> tuple[TrajectoryFiles, str]:
    """Files of the motion, committed, and its expected accuracy."""
    used = deployed_model(campaign)
    body = weighable(campaign)
    say(used.sentence)
    constraints = constraints.using(newest_model(campaign, state))
    limits = constraints.limits(campaign)
    require_possible(limits)
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    path = replace(config.trajectory, duration=DURATION_S, omega0=None)
    family = kind.family(spec, replace(config, trajectory=path))
    rng = np.random.default_rng([state.seed, number, STREAM])
    candidates = _candidates(campaign, family, limits, rng)
    first = candidates[0]
    log = used.model.inputs.states(first.family.motion(first.p, np.linspace(0.0, DURATION_S, POINTS), 3))
    mass = SHARE * _require_mass(campaign, log, body)
    apparent = apparent_of(campaign, used.model, body)
    aim = Weighs(used.model, body, apparent, mass, family, used.model.inputs)
    say("Designing a motion that identifies the payload.")
    design = search(aim, candidates, replace(config.design, refine=REFINED, steps=STEPS), limits)
    motion = from_rest(campaign, design.best.trajectory, limits)
    motion_constraints = constraints.of(motion)
    files = render(
        motion, kind, spec, config, limits, motion_constraints.unenforced, control=motion_constraints.control
    )
    status = forecast(aim.of(design.best.family).covariance(design.best.p), mass)
    asked = Asked(
        weighs=True,
        status=status,
        seed=(state.seed, number, STREAM),
        learned=len(state.trained),
        active_limits=tuple(files.certificate.active()),
        value=design.value,
        baseline_value=design.baseline,
        evaluations=design.evaluations,
        model_sha256=used.sha256,
    )
    campaign.commit(motion_constraints.recorded(asked), number, files.write(campaign.proposal(number)))
    return files, status


def _candidates(
    campaign: Campaign, family: Family, limits: Sequence[Limit], rng: np.random.Generator
) -> list[SampledPoint]:
    """Random motions; between obstacles where there are some."""
    config, roam = campaign.config.design, roam_of(campaign, family, ())
    if roam is None:
        source = Source(family, tuple(limits), campaign.kind.home(campaign.spec), config.sampler)
        return source.candidates(rng, CANDIDATES)
    between = ClearPoseSource.of(family, tuple(limits), roam, config.sampler)
    return [one for _ in range(REGIONS) for one in between.candidates(rng, CANDIDATES)]


def _require_mass(campaign: Campaign, log: Log, body: SupportsVariations) -> float:
    whole = whole_mass(log, body, np.asarray(campaign.kind.limit(campaign.spec)))
    if whole == 0.0:
        raise UsageError(
            f"no command of '{campaign.spec.name}' depends on a load: all axes meet at the payload",
            where=str(campaign.path),
            next_step="Choose more joints with --joints, or weigh the load on a scale.",
        )
    return whole


def forecast(covariance: Array, mass: float) -> str:
    """Expected 95 % intervals for a load of `mass` kg with its centre at the link's origin."""
    wide = NORMAL_95 * np.sqrt(np.diag(covariance)) / np.array([1.0, mass, mass, mass])
    axes = [
        f"{name} +- {1e3 * half_width:.0f} mm" if half_width <= TOLD else f"{name} cannot be determined"
        for name, half_width in zip("xyz", wide[1:].tolist(), strict=True)
    ]
    return (
        f"to identify the payload. Forecast for {mass:.2g} kg: mass +- {wide[0]:.2g} kg, centre "
        f"{', '.join(axes)}"
    )
