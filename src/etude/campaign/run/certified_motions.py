"""Motions that a run sends: proposals, slow ones with their first segment alone, and the ways to and from
them; each is proved before it is sent, with the learned command where the robot takes one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude import plugins
from etude.campaign.ingest.recordings import file_gravity
from etude.campaign.propose.approach import There, clear_poses, require_inside, there_and_back
from etude.campaign.propose.constraints import Constraints, constraints_then
from etude.campaign.propose.export import GROUP, accelerated_by
from etude.campaign.propose.learned_velocity import peak_speeds
from etude.campaign.propose.typical_motions import approaches_of
from etude.campaign.record.controls import LEARNED
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import proposal_advice, speed_folder, stored_bytes
from etude.campaign.run.run_history import FULL
from etude.campaign.run.supervision import bounds_for
from etude.deploy.playback_certificate import certified_playback, learned_part
from etude.deploy.trajectory_files import COEFFICIENTS
from etude.drivers import About, Bounds, PlannedMotion, first_segment_ends, planned
from etude.drivers.contract import MotionPart
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits.certificate import certify
from etude.models.learned_model import LearnedModel
from etude.protocols import Trajectory
from etude.trajectories.json_text import from_json
from etude.trajectories.splined import Splined
from etude.types import Array, Motion

NEAR = 1e-9
"""rad or m: within this distance of a motion's start a robot needs no approach."""
COMMAND_HZ = 200.0
"""Rate of learned commands, Hz; between, they are interpolated linearly."""
FADE_S = 1.5
"""s in which a learned command fades in or out between motions without and with it."""


@dataclass(frozen=True, eq=False)
class Learned:
    """The command of a model along a motion, in the campaign's order.

    Attributes:
        t: (T,) s. sent: (T, k) the part that is sent: without gravity where the robot adds it by itself.
        deviation: (T, k) of the model's command. logged: (T, k) the part that the robot's own commands show.
            None of both where accelerations are sent, which no log shows.
    """

    t: Array
    sent: Array
    deviation: Array | None = None
    logged: Array | None = None

    @classmethod
    def along(cls, campaign: Campaign, model: LearnedModel, motion: CertifiedMotion, about: About) -> Learned:
        """The learned command of a motion. UnsafeTrajectoryError: its learned accelerations leave a limit."""
        trajectory = motion.trajectory
        if about.learned_as:
            return cls._of_accelerations(campaign, model, motion, about.learned_as)
        states = model.planned(trajectory, COMMAND_HZ)
        forecast = model.commanded(states)
        total = forecast["command"]
        t = np.minimum(np.arange(len(total)) / COMMAND_HZ, trajectory.duration)
        if about.gravity_in_command is not False:
            return cls(t, total, forecast["deviation"], total)
        q = trajectory.motion(t, 1).orders[0]
        added = file_gravity(campaign, q)
        sent = total - (model.static(states) if added is None else added)
        logged = total if added is None or about.command_of == "measured" else sent
        return cls(t, sent, forecast["deviation"], logged)

    @classmethod
    def _of_accelerations(
        cls, campaign: Campaign, model: LearnedModel, motion: CertifiedMotion, name: str
    ) -> Learned:
        """The learned part of that exporter's files, with the same proof."""
        exporter, trajectory = plugins.load(GROUP, name), motion.trajectory
        what = accelerated_by(campaign, trajectory, model)
        limits = motion.constraints.limits_as_played(campaign, trajectory)
        files, _ = certified_playback(exporter, what, campaign.kind, campaign.spec, limits, LEARNED)
        table = learned_part(exporter, files)
        return cls(np.zeros(1), np.zeros((1, len(campaign.axes)))) if table is None else cls(*table)

    def at(self, t: Array, values: Array) -> Array:
        """(n, k) of `sent` or `logged`."""
        return np.stack([np.interp(t, self.t, column) for column in values.T], axis=1)


@dataclass(frozen=True, eq=False)
class CertifiedMotion:
    """One motion that may be sent.

    Attributes:
        number: of the proposal. part: of it. speed: per cent. first: it is the motion's beginning alone.
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
    first: bool = False
    learned: Learned | None = None
    fade: tuple[float, float] = (1.0, 1.0)

    @property
    def start(self) -> Array:
        """(k,) rad or m"""
        return np.asarray(self.trajectory.motion(np.zeros(1), 1).orders[0, 0])

    @property
    def end(self) -> Array:
        """(k,) rad or m"""
        return np.asarray(self.trajectory.motion(np.array([self.trajectory.duration]), 1).orders[0, 0])

    def for_driver(self, campaign: Campaign, about: About) -> PlannedMotion:
        """The motion's rows at the driver's rate, with joints in the driver's order."""
        return planned(
            self.data,
            number=self.number,
            part=self.part,
            speed=self.speed,
            names=campaign.axes,
            joints=about.joints,
            rate=about.rate,
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
        """(n, k) predicted commands at times t; None without a learned command."""
        logged = None if self.learned is None else self.learned.logged
        return None if self.learned is None or logged is None else self.learned.at(t, logged)

    def bounds(self, campaign: Campaign, about: About) -> Bounds:
        """The supervisor's bounds, in the campaign's order of axes."""
        deviation = None if self.learned is None else self.learned.deviation
        return bounds_for(campaign, about, self.constraints, self.trajectory, self.control, deviation)


def proposal_motion(campaign: Campaign, number: int, control: str) -> CertifiedMotion:
    """The whole motion of a proposal at full speed. UsageError: its file is missing or was changed."""
    path = speed_folder(campaign, number, FULL) / COEFFICIENTS
    data = stored_bytes(campaign, path, proposal_advice(campaign, number))
    constraints = constraints_then(campaign.round(number).asked)
    return CertifiedMotion(number, "motion", FULL, data, from_json(data), constraints, control)


CAREFUL_S = 10.0
"""Longest part of a motion that runs slowly first, in s at full speed; at most the first segment."""
BRAKES = (3.0, 6.0)
"""s of braking along the path at full speed; the first value with a proof is used."""
KNOTS_S = 0.05
"""s of the motion between two knots of the slow one."""


def careful_motion(campaign: Campaign, motion: CertifiedMotion, speed: int) -> CertifiedMotion | None:
    """The beginning of a motion at a speed in percent, braked to rest along its path. None without a
    proof: at full speed, for example, there may be no room to brake.
    """
    limits, rests = motion.constraints.limits(campaign), first_segment_ends(motion.trajectory)
    if rests <= CAREFUL_S and rests == motion.trajectory.duration and speed == FULL:
        return motion
    for brake in BRAKES if rests > CAREFUL_S else (0.0,):
        trajectory = _beginning(motion.trajectory, speed / FULL, brake)
        if certify(trajectory, limits).ok:
            data = trajectory.to_json().encode()
            return replace(motion, speed=speed, first=True, data=data, trajectory=trajectory)
    return None


def _beginning(trajectory: Trajectory, pace: float, brake: float) -> Splined:
    """Its first seconds at that pace, braked to rest by a raised cosine, as quintics through its knots.

    brake: s at full speed; 0 where the motion rests by itself.
    """
    last = min(CAREFUL_S, first_segment_ends(trajectory))
    until = (last - 0.5 * brake) / pace  # s of our time, from where on it is braked
    duration = until + brake / pace
    t = np.linspace(0.0, duration, int(np.ceil(duration * pace / KNOTS_S)) + 1)
    x = np.clip((t - until) * pace / max(brake, KNOTS_S), 0.0, 1.0) * (brake > 0.0)
    at = pace * np.minimum(t, until) + 0.5 * brake * (x + np.sin(np.pi * x) / np.pi)
    rate = 0.5 * pace * (1.0 + np.cos(np.pi * x))
    change = -0.5 * pace * pace * np.pi / max(brake, KNOTS_S) * np.sin(np.pi * x)
    q, dq, ddq = trajectory.motion(np.minimum(at, trajectory.duration)).orders
    points = np.stack([q, dq * rate[:, None], ddq * rate[:, None] ** 2 + dq * change[:, None]])
    points[1:, -1] = 0.0
    return Splined(t, points, like=trajectory.pieces()[0][2].form)


@dataclass(frozen=True, eq=False)
class Transfers:
    """The approach to a motion, and the return from its end; None: not needed."""

    approach: CertifiedMotion | None
    back: CertifiedMotion | None


SLOW = 0.05
"""Part of a joint's velocity limit at which it may be transferred however slowly the motion moves it."""


def transfers_of(campaign: Campaign, motion: CertifiedMotion, pose: Array) -> Transfers:
    """Proved transfers from a pose (k,) to the motion's start, and from its end back, at its speed.

    No joint is faster on them than in the motion, or than `SLOW`: logs of such motions say nothing of
    commands at higher speeds, and the supervisor compares commands on transfers too.

    Raises:
        UsageError: the pose is outside the limits, or the kind has no approaches, or the motion does not
            begin and end at rest. UnsafeTrajectoryError: no approach is proved.
    """
    lower, upper = campaign.kind.expected(campaign.spec).limits[campaign.kind.path]
    require_inside(pose, lower, upper, campaign.axes, f"motion {motion.number}, the approach to it")
    limits = motion.constraints.limits(campaign)
    home, clear = np.asarray(campaign.kind.home(campaign.spec), dtype=float), clear_poses(campaign)

    def paths_at(speed: float) -> There | None:
        return there_and_back(motion.trajectory, pose, approaches_of(campaign), limits, home, clear, speed)

    try:
        paths = paths_at(motion.speed)
        pace = 1.0 if paths is None else _pace(campaign, motion.trajectory, paths)
        paths = paths if pace == 1.0 else paths_at(pace * motion.speed)
    except UnsafeTrajectoryError as problem:
        raise _no_approach(campaign, motion, pose, home, problem) from None
    if paths is None or paths.whole is None:
        raise UsageError(
            f"robots of the kind '{campaign.kind.name}' have no approach to a motion from rest to rest",
            where=str(campaign.path),
            next_step="Play the files of etude ask with the robot's own controller, then ingest its log.",
        )
    at_start, at_end = (float(np.abs(end - pose).max()) <= NEAR for end in (motion.start, motion.end))
    return Transfers(
        None if at_start else _transfer(motion, "approach", paths.approach),
        None if at_end or motion.first else _transfer(motion, "return", paths.back),
    )


def _pace(campaign: Campaign, motion: Trajectory, paths: There) -> float:
    """Part of their speed, at most 1, at which no joint is faster on the paths than in the motion."""
    rate = next((c.name for c in campaign.channels if c.derivative_of == campaign.kind.path), "")
    limits = campaign.kind.expected(campaign.spec).limits.get(rate)
    slow = np.zeros(len(campaign.axes)) if limits is None else SLOW * np.minimum(limits[1], -limits[0])
    least = np.maximum(peak_speeds(motion), np.where(np.isfinite(slow), slow, 0.0))
    fastest = np.maximum(peak_speeds(paths.approach), peak_speeds(paths.back))
    moving = (fastest > 0.0) & (least > 0.0)
    return float(np.min(least[moving] / fastest[moving], initial=1.0))


def _no_approach(
    campaign: Campaign, motion: CertifiedMotion, pose: Array, home: Array, problem: UnsafeTrajectoryError
) -> UnsafeTrajectoryError:
    """Error without an approach: the pose itself is not proved, or no path from it is."""
    stands = certify(_rest_at(pose), motion.constraints.limits(campaign)).ok
    fact = (
        f"no certified approach to motion {motion.number}"
        if stands
        else "the position of the robot is the problem"
    )
    named = ", ".join(f"{a} = {x:.3g}" for a, x in zip(campaign.axes, home.tolist(), strict=True))
    return UnsafeTrajectoryError(
        f"{fact}: {problem.fact}",
        where=problem.where,
        next_step="Move the robot home with its own controller. A simulated robot starts there with a "
        f"line in [driver] of run.toml: start = {{ {named} }}",
    )


def _rest_at(pose: Array) -> Splined:
    """Rest at a pose (k,) while a learned command fades in or out."""
    points = np.zeros((3, 2, len(pose)))
    points[0] = pose
    return Splined(np.array([0.0, 2.0 * FADE_S]), points)


def _transfer(motion: CertifiedMotion, part: MotionPart, trajectory: Trajectory) -> CertifiedMotion:
    data = trajectory.to_json().encode()
    return CertifiedMotion(
        motion.number, part, motion.speed, data, trajectory, motion.constraints, motion.control
    )


def holding(motion: CertifiedMotion, pose: Array) -> CertifiedMotion:
    """Rest at a pose (k,) while a learned command fades in or out."""
    return _transfer(replace(motion, speed=FULL), "hold", _rest_at(pose))


def require_accepted(refusals: Sequence[str], motion: CertifiedMotion) -> None:
    """Raise UnsafeTrajectoryError with the driver's reasons to refuse a motion."""
    if refusals:
        raise UnsafeTrajectoryError(
            f"the robot refuses {motion.part} {motion.number}: {' '.join(refusals).rstrip('.')}",
            where=motion.part,
            next_step="Write the limits that the robot enforces into robot.toml, and write another motion.",
        )
