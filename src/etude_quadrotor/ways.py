"""Take-off, approach, return and landing: from where a vehicle stands or hovers to a plan's start, and back.

All are septics: their jerk begins and ends as it must, so that attitudes do too. A plan may be in motion at
its ends, and have no lead-in (`limits.at_rest`); the way then leads from rest into that motion and out of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.limits.certificate import certify, use
from etude.limits.library import AxisLimit
from etude.protocols import Limit, Trajectory
from etude.trajectories.chain import Chain, Part
from etude.trajectories.splined import Splined
from etude.types import Array, Proof
from etude_quadrotor.spec import QuadrotorSpec

PEAK_SPEED, PEAK_ACCELERATION = 35.0 / 16.0, 84.0 / (5.0 * math.sqrt(5.0))
"""Of a septic from rest to rest over length and time 1."""
UNHURRIED, GENTLE, SHORTEST = 0.3, 0.5, 2.0
"""Of ways: part of the speed limit, m/s^2, and s that one lasts at least."""
ORDERS = 4
STILL = 1e-9
"""m/s, m/s^2, ...: less is rest."""
UPRIGHT, SETTLED = 1e-4, 1e-3
"""m that a way to or from the ground may go sideways or begin beside it, and the m/s, m/s^2 at its ends that
count as rest: receivers play single precision.
"""
LIFTED, RAMP = 0.03, 4.0
"""m that a take-off rises in its first s. An autopilot ramps thrust up once a set-point is above the ground
(PX4 for 3 s, MPC_TKO_RAMP_T, and 1 s for the motors, COM_SPOOLUP_TIME) and lags behind what rises before.
"""
LASTING = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Times of that of a straight way, in which one into a motion is tried."""


@dataclass(frozen=True, eq=False)
class RoomLimit(AxisLimit):
    """The box less its margins; a way straight up from the ground, or down to it, may be below these.

    Attributes:
        ground: m, of the vehicle's centre where it stands.
    """

    ground: float = 0.0

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each axis; of a take-off or landing the one of z begins at the ground."""
        rows = list(super().prove(piece))
        ends = piece.motion(np.array([0.0, piece.duration]), 3).orders
        sideways = max(row.proved_upper - row.proved_lower for row in rows[:2])
        stands = np.abs(ends[0, :, 2] - self.ground) <= UPRIGHT
        still = np.abs(ends[1:]).max() <= SETTLED
        if sideways <= UPRIGHT and stands.any() and still:
            rows[2] = replace(rows[2], lower=self.ground - UPRIGHT, margin=0.0, confidence=1.0)
        return rows


def standing(spec: QuadrotorSpec, over: Array) -> Array:
    """(3,) the vehicle on the ground, below a place (3,)."""
    return np.array([over[0], over[1], spec.floor])


def ways(
    spec: QuadrotorSpec, motion: Trajectory, pose: Array, height: float, limits: Sequence[Limit]
) -> tuple[Trajectory, Trajectory]:
    """From the pose to where the plan begins, and back from where it ends.

    Args:
        spec: the vehicle. motion: the plan.
        pose: (3,) m, where it hovers; or stands, if that is lower than a flight may be.
        height: m, to which it takes off.
        limits: by which ways into a motion are chosen.
    """
    low = spec.lower[2] + spec.margins[2]
    hover = np.array(pose, dtype=float)
    if pose[2] < low:
        hover[2] = height
    there, back = _between(spec, motion, hover, limits)
    if pose[2] < low:
        there = [("take-off", _lifted(spec, pose, hover)), *there]
        back = [*back, ("landing", _straight(spec, hover, pose))]
    return _one(there), _one(back)


def _between(
    spec: QuadrotorSpec, motion: Trajectory, hover: Array, limits: Sequence[Limit]
) -> tuple[list[Part], list[Part]]:
    """From hover to the plan and back."""
    first, last = np.moveaxis(motion.motion(np.array([0.0, motion.duration]), ORDERS).orders, 1, 0)
    there = _way(spec, at_rest(hover), first, limits)
    back = _way(spec, last, at_rest(hover), limits)
    return [("approach", there)], [("return", back)]


def _one(parts: list[Part]) -> Trajectory:
    return parts[0][1] if len(parts) == 1 else Chain(tuple(parts))


def at_rest(place: Array) -> Array:
    """(4, 3) position to jerk of hover."""
    return np.concatenate([place[None], np.zeros((ORDERS - 1, 3))])


def _way(spec: QuadrotorSpec, start: Array, end: Array, limits: Sequence[Limit]) -> Splined:
    """From state to state (4, 3): straight between two of rest, else what leaves most of the limits."""
    straight = _straight(spec, start[0], end[0])
    if max(np.abs(start[1:]).max(), np.abs(end[1:]).max()) <= STILL:
        return straight
    tried = [
        Splined(np.array([0.0, _whole(spec, part * straight.duration)]), np.stack([start, end], axis=1))
        for part in LASTING
    ]
    return min(tried, key=lambda way: max(use(row) for row in certify(way, limits).rows))


def _straight(spec: QuadrotorSpec, start: Array, end: Array) -> Splined:
    length = float(np.linalg.norm(end - start))
    slow = PEAK_SPEED * length / (UNHURRIED * spec.speed)
    lasting = max(slow, math.sqrt(PEAK_ACCELERATION * length / GENTLE), SHORTEST)
    points = np.stack([at_rest(start), at_rest(end)], axis=1)
    return Splined(np.array([0.0, _whole(spec, lasting)]), points)


def _lifted(spec: QuadrotorSpec, ground: Array, hover: Array) -> Splined:
    """Straight up, after a first rise for which thrust is ramped up."""
    first = ground + LIFTED * (hover - ground) / np.linalg.norm(hover - ground)
    rest = _straight(spec, first, hover)
    points = np.concatenate([at_rest(ground)[:, None], rest.points], axis=1)
    return Splined(np.concatenate([[0.0], RAMP + rest.times]), points)


def _whole(spec: QuadrotorSpec, seconds: float) -> float:
    """At least so long, and a whole number of set-points."""
    return math.ceil(seconds * spec.table_rate - 1e-9) / spec.table_rate
