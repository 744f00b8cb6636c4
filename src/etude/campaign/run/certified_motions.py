"""What a run sends: motions of proposals, slow ones with their first segment alone, and the ways to and from
them; each proved before it moves, with the learned command where the robot takes one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from etude.campaign.propose.approach import require_inside, there_and_back
from etude.campaign.propose.constraints import Constraints, constraints_then
from etude.campaign.propose.typical_motions import approaches_of
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import proposal_advice, speed_folder, stored_bytes
from etude.campaign.run.run_history import FULL, SpeedStep
from etude.campaign.run.supervision import bounds_for
from etude.deploy.trajectory_files import COEFFICIENTS
from etude.drivers import About, Bounds, PlannedMotion, first_segment_ends, planned
from etude.drivers.contract import MotionPart
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.models.learned_model import LearnedModel
from etude.protocols import Trajectory
from etude.trajectories.json_text import from_json
from etude.trajectories.splined import Splined
from etude.types import Array, Motion

NEAR = 1e-9
"""rad or m: a robot that was asked to stand so near to a motion's start needs no way there."""
COMMAND_HZ = 200.0
"""At which learned commands are computed; between, they are joined by lines."""
FADE_S = 1.5
"""s in which a learned command comes or goes, where the motion before was sent without, or with it."""


@dataclass(frozen=True, eq=False)
class Learned:
    """The command of a model along a motion, in the campaign's order.

    Attributes:
        t: (T,) s. total: (T, k) what the model predicts. deviation: (T, k) of it.
        sent: (T, k) the part that is sent: without gravity where the robot adds it by itself.
    """

    t: Array
    total: Array
    deviation: Array
    sent: Array

    @classmethod
    def along(cls, campaign: Campaign, model: LearnedModel, trajectory: Trajectory, about: About) -> Learned:
        states = model.planned(trajectory, COMMAND_HZ)
        found = model.commanded(states)
        total = found["command"]
        sent = total - _gravity(campaign, model, states) if about.gravity_in_command is False else total
        t = np.minimum(np.arange(len(total)) / COMMAND_HZ, trajectory.duration)
        return cls(t, total, found["deviation"], sent)

    def at(self, t: Array, values: Array) -> Array:
        """(n, k) of `total` or `sent`."""
        return np.stack([np.interp(t, self.t, own) for own in values.T], axis=1)


def _gravity(campaign: Campaign, model: LearnedModel, states: object) -> Array:
    """(T, k) what the robot adds by itself: by its model file, else what of the model remains at rest."""
    from etude.campaign.ingest.questions import body_of
    from etude.models.data.as_log import as_log
    from etude.models.selection.linear import at_rest

    body = body_of(campaign.kind, campaign.spec)
    if body is None:
        return model.static(states)
    return np.asarray(body.predict(at_rest(as_log(states, model.columns))))


@dataclass(frozen=True, eq=False)
class CertifiedMotion:
    """One motion that may be sent.

    Attributes:
        number: of the proposal. part: of it. speed: per cent. until: s at which it ends; None: whole.
        data: the JSON that was proved, its trajectory. control: that it is run under.
        learned: command along it; None under feedback alone.
        fade: levels of the learned command at its beginning and from `FADE_S` on.
    """

    number: int
    part: MotionPart
    speed: int
    data: bytes
    trajectory: Trajectory
    constraints: Constraints
    control: str
    until: float | None = None
    learned: Learned | None = None
    fade: tuple[float, float] = (1.0, 1.0)

    @property
    def start(self) -> Array:
        """(k,) rad or m"""
        return np.asarray(self.trajectory.motion(np.zeros(1), 1).orders[0, 0])

    @property
    def end(self) -> Array:
        """(k,) rad or m"""
        last = self.trajectory.duration if self.until is None else self.until
        return np.asarray(self.trajectory.motion(np.array([last]), 1).orders[0, 0])

    def for_driver(self, campaign: Campaign, about: About) -> PlannedMotion:
        """Its rows at the driver's rate, joints in the driver's order."""
        return planned(
            self.data,
            number=self.number,
            part=self.part,
            speed=self.speed,
            names=campaign.axes,
            joints=about.joints,
            rate=about.rate,
            until=self.until,
            effort=self._effort(),
        )

    def _effort(self) -> Callable[[Motion], Array] | None:
        learned = self.learned
        if learned is None:
            return None

        def effort(motion: Motion) -> Array:
            level = np.interp(motion.t, [0.0, FADE_S], self.fade)
            return np.asarray(level[:, None] * learned.at(motion.t, learned.sent))

        return effort

    def predicted(self, t: Array) -> Array | None:
        """(n, k) the commands that are expected at times t; None where nothing is learned."""
        return None if self.learned is None else self.learned.at(t, self.learned.total)

    def bounds(self, campaign: Campaign, about: About) -> Bounds:
        """In the campaign's order of axes."""
        deviation = None if self.learned is None else self.learned.deviation
        return bounds_for(campaign, about, self.constraints, self.trajectory, self.control, deviation)


def proposal_motion(campaign: Campaign, number: int, step: SpeedStep, control: str) -> CertifiedMotion:
    """The motion of a proposal at that step; its files are on the disk. UsageError: they are not."""
    path = speed_folder(campaign, number, step.speed) / COEFFICIENTS
    data = stored_bytes(campaign, path, proposal_advice(campaign, number))
    trajectory = from_json(data)
    until = first_segment_ends(trajectory) if step.first else None
    if until == trajectory.duration and step.speed == FULL:  # one segment is the whole motion
        until = None
    constraints = constraints_then(campaign.round(number).asked)
    return CertifiedMotion(number, "motion", step.speed, data, trajectory, constraints, control, until)


@dataclass(frozen=True, eq=False)
class Ways:
    """To a motion, and from its end back to the pose; an approach of None: it stands at the start."""

    approach: CertifiedMotion | None
    back: CertifiedMotion | None


def ways_of(campaign: Campaign, motion: CertifiedMotion, pose: Array) -> Ways:
    """Proved ways from a pose (k,) to the motion's start, and from its end back.

    Raises:
        UsageError: the pose is outside the limits, or the kind knows no ways, or the motion does not begin
            and end at rest. UnsafeTrajectoryError: no way is proved.
    """
    lower, upper = campaign.kind.expected(campaign.spec).limits[campaign.kind.path]
    require_inside(pose, lower, upper, campaign.axes)
    limits = motion.constraints.limits(campaign)
    home = campaign.kind.home(campaign.spec)
    found = there_and_back(motion.trajectory, pose, approaches_of(campaign), limits, home)
    if found is None or found.whole is None:
        raise UsageError(
            f"robots of the kind '{campaign.kind.name}' know no way to a motion that begins and ends at rest",
            where=str(campaign.path),
            next_step="Play the files of etude ask by the robot's own controller, then tell its log.",
        )
    near, again = (float(np.abs(own - pose).max()) <= NEAR for own in (motion.start, motion.end))
    return Ways(
        None if near else _way(motion, "approach", found.approach),
        None if again or motion.until is not None else _way(motion, "return", found.back),
    )


def _way(motion: CertifiedMotion, part: MotionPart, trajectory: Trajectory) -> CertifiedMotion:
    data = trajectory.to_json().encode()
    return CertifiedMotion(motion.number, part, FULL, data, trajectory, motion.constraints, motion.control)


def holding(motion: CertifiedMotion, pose: Array) -> CertifiedMotion:
    """Standing at a pose (k,) for as long as a learned command comes or goes."""
    still = np.zeros((2, 3, len(pose)))
    still[:, 0] = pose
    trajectory = Splined(np.array([0.0, 2.0 * FADE_S]), still)
    return _way(motion, "hold", trajectory)


def require_accepted(said: Sequence[str], motion: CertifiedMotion) -> None:
    """UnsafeTrajectoryError with what the driver says against a motion."""
    if said:
        raise UnsafeTrajectoryError(
            f"the robot refuses {motion.part} {motion.number}: {' '.join(said).rstrip('.')}",
            where=motion.part,
            next_step="Write what the robot enforces into robot.toml, and ask for another motion.",
        )
