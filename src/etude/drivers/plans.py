"""Rows of a certified trajectory at a driver's rate, evaluated exactly, not read from a table of 100 Hz."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np

from etude.drivers.contract import MotionPart, PlannedMotion
from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories import from_json, segment_starts
from etude.types import Array, Index, Motion

AT_REST = 1e-6
"""rad/s or m/s: a motion that is cut there has come to rest."""


def planned(
    trajectory_json: bytes,
    *,
    number: int,
    part: MotionPart,
    speed: int,
    names: Sequence[str],
    joints: Sequence[str],
    rate: float,
    until: float | None = None,
    effort: Callable[[Motion], Array] | None = None,
) -> PlannedMotion:
    """The motion of a trajectory.json for a driver.

    Args:
        trajectory_json: the file's bytes, as they were proved; a slow motion has a file of its own.
        number: of the proposal. part: of it. speed: per cent, of the file.
        names: joints of the trajectory in its order, the campaign's.
        joints: in the driver's order.
        rate: Hz, of the driver.
        until: s at which it ends, at rest there, as at `first_segment_ends`; None: whole.
        effort: from the motion in the order of `names` to the learned command (n, J), less gravity where the
            robot adds it.

    Raises:
        UsageError: other joints, no trajectory, or one that is in motion where it is to end.
    """
    trajectory = from_json(trajectory_json)
    columns = _columns(names, joints)
    last = trajectory.duration if until is None else until
    t = _instants(last, rate)
    motion = trajectory.motion(t)
    if motion.orders.shape[2] != len(names):
        raise UsageError(
            f"the trajectory moves {motion.orders.shape[2]} joints, not {len(names)}",
            next_step="Use the trajectory.json of etude ask for this robot.",
        )
    if until is not None and np.abs(motion.orders[1, -1]).max() > AT_REST:
        raise UsageError(
            f"the trajectory is not at rest at {until:g} s, its requested end",
            next_step="End it at the end of a segment.",
        )
    q, qd, qdd = (np.ascontiguousarray(order[:, columns]) for order in motion.orders)
    command = None if effort is None else np.ascontiguousarray(effort(motion)[:, columns])
    return PlannedMotion(
        number=number,
        part=part,
        speed=speed,
        sha256=hashlib.sha256(trajectory_json).hexdigest(),
        joints=tuple(joints),
        names=tuple(names),
        rate=rate,
        t=t,
        q=q,
        qd=qd,
        qdd=qdd,
        effort=command,
        trajectory_json=trajectory_json.decode("utf-8"),
    )


def first_segment_ends(trajectory: Trajectory) -> float:
    """s at which the first segment ends, before the link to the next one; of one segment, the end."""
    first = segment_starts(trajectory)[:1]
    for start, label, _ in trajectory.pieces():
        if first and start > first[0] and label not in ("segment", "lead-out"):
            return start
    return trajectory.duration


def _columns(names: Sequence[str], joints: Sequence[str]) -> Index:
    """The trajectory's column for each of the driver's joints."""
    if sorted(names) != sorted(joints):
        lacking = [name for name in names if name not in joints]
        beyond = [name for name in joints if name not in names]
        raise UsageError(
            f"the driver moves other joints than the campaign: it lacks {', '.join(lacking) or 'none'} "
            f"and also has {', '.join(beyond) or 'none'}",
            next_step="Give the driver the names of the joints in robot.toml.",
        )
    return np.array([list(names).index(name) for name in joints])


def _instants(last: float, rate: float) -> Array:
    """(n,) whole cycles from 0, and the end itself, which is a cycle of its own unless it is one of them."""
    whole = np.arange(int(np.floor(last * rate + 1e-6)) + 1) / rate
    if last - whole[-1] <= 1e-6 / rate:
        whole[-1] = last
        return whole
    return np.append(whole, last)
