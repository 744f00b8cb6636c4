"""Is this the log of that trajectory? Alignment of a log with the proposal it claims to follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.delay import measure_delay
from etude.logs.derivatives import median_rate, resample, uniform_grid
from etude.logs.doctor import add_repair
from etude.logs.log import RobotLog
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

LARGEST_MISMATCH = 0.5  # root mean square deviation from the proposal, over the proposal's own spread
LEAST_COVERAGE = 0.5  # part of the proposal that the log has to contain


def align_with(log: RobotLog, trajectory: Trajectory, spec: RobotSpec) -> RobotLog:
    """The log with t = 0 at the trajectory's start and the desired motion filled in.

    The log's own desired positions decide the alignment if it has them, else the measured ones. The motion
    is judged over all joints together, in parts of their ranges: one joint alone may be stuck.

    Raises:
        DataError: the motion is another one, or less than half of it is in the log.
    """
    if log.dof != trajectory.dof:
        raise DataError(f"the log has {log.dof} joints, the proposal {trajectory.dof}", where=log.source)
    rate = median_rate(log.t)
    grid = uniform_grid(log.t, rate)
    motion = resample(log.t, log.q if log.q_des is None else log.q_des, grid)
    wanted = trajectory.sample(np.arange(0.0, trajectory.duration, 1.0 / rate)).q
    span = (-trajectory.duration, float(grid[-1] - grid[0]))
    delay = measure_delay(wanted, motion, rate, span).seconds
    shifted = replace(log, t=log.t - log.t[0] - delay)
    _check_coverage(shifted, trajectory)
    _check_match(shifted, trajectory, spec)
    aligned = _with_desired(shifted, trajectory)
    shift = float(log.t[0] + delay)
    if abs(shift) <= 0.5 / rate:
        return replace(aligned, t=log.t)
    return add_repair(
        aligned, f"The proposal starts {shift:.3f} s into the log's time; t = 0 was moved there."
    )


def _check_coverage(log: RobotLog, trajectory: Trajectory) -> None:
    covered = min(log.t[-1], trajectory.duration) - max(log.t[0], 0.0)
    if covered < LEAST_COVERAGE * trajectory.duration:
        raise DataError(
            f"the log holds {max(covered, 0.0):.3g} of the proposal's {trajectory.duration:.3g} s, "
            "or another motion",
            where=log.source,
            next_step="Tell the log of this proposal, recorded from start to end.",
        )


def _check_match(log: RobotLog, trajectory: Trajectory, spec: RobotSpec) -> None:
    inside = (log.t >= 0) & (log.t <= trajectory.duration)
    wanted = trajectory.sample(log.t[inside]).q
    motion = (log.q if log.q_des is None else log.q_des)[inside]
    size = spec.upper - spec.lower
    error = np.sqrt((((motion - wanted) / size) ** 2).mean(axis=0))
    spread = np.maximum((wanted / size).std(axis=0), 1e-12)
    pooled = float(np.linalg.norm(error) / np.linalg.norm(spread))
    mismatch = error / spread
    causes = [
        _cause(motion, wanted, log.names, j) if mismatch[j] > LARGEST_MISMATCH else "" for j in range(log.dof)
    ]
    if pooled <= LARGEST_MISMATCH and not any(causes):
        return
    j = next((k for k in range(log.dof) if causes[k]), int(np.argmax(error)))
    raise DataError(
        f"this is not the log of the proposed trajectory: the motion deviates from it by {pooled:.2g} times "
        f"its spread, joint {log.names[j]} by {mismatch[j]:.2g}{causes[j]}",
        where=log.source,
        next_step="Tell the log of this proposal, or the number of the proposal that was run.",
    )


def _cause(motion: Array, wanted: Array, names: tuple[str, ...], j: int) -> str:
    """A guess in words (sign, degrees, exchanged joints); empty without one."""
    a, b = motion - motion.mean(axis=0), wanted - wanted.mean(axis=0)
    norms = np.outer(np.sqrt((a * a).sum(axis=0)), np.sqrt((b * b).sum(axis=0))) + 1e-300
    likeness = (a.T @ b) / norms
    slope = float(a[:, j] @ b[:, j] / (b[:, j] @ b[:, j] + 1e-300))
    if likeness[j, j] < -0.9:
        return "; it moves in the opposite direction (sign?)"
    if likeness[j, j] > 0.9 and 40 < slope < 80:
        return "; its unit looks like degrees"
    other = int(np.argmax(likeness[j]))
    if likeness[j, j] < 0.5 and likeness[j, other] > 0.9:
        return f"; it follows what was proposed for {names[other]} (joints exchanged?)"
    return ""


def _with_desired(log: RobotLog, trajectory: Trajectory) -> RobotLog:
    """The exact desired motion at the log's times; before and after, the trajectory rests at its ends."""
    samples = trajectory.sample(np.clip(log.t, 0.0, trajectory.duration))
    outside = ((log.t < 0) | (log.t > trajectory.duration))[:, None]
    return replace(
        log,
        q_des=samples.q,
        qd_des=np.where(outside, 0.0, samples.qd),
        qdd_des=np.where(outside, 0.0, samples.qdd),
    )
