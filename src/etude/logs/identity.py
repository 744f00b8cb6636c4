"""Is this the log of that trajectory? Alignment of a log with the proposal it claims to follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.delay import measure_delay
from etude.logs.smoothing import median_rate, resample, uniform_grid
from etude.logs.doctor import add_repair
from etude.logs.log import RobotLog
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]

# Root mean square deviation over the proposal's own spread. A weak controller against stiction reaches 0.8 on
# a small motion, other motions of the same kind begin at 0.9; up to 0.5 there is no doubt.
LARGEST_MISMATCH = 0.85
CLEAR_MATCH = 0.5
ALIKE = 0.9  # correlation of two motions that are the same but for sign, unit or name
LEAST_COVERAGE = 0.5  # part of the proposal that the log has to contain


def align_with(log: RobotLog, trajectory: Trajectory, spec: RobotSpec) -> RobotLog:
    """The log with t = 0 at the trajectory's start and the desired motion filled in.

    A log with negative times marks its own start: its clock is kept if the motion fits. Otherwise the best
    correlation decides, of the log's desired positions if it has them, else of the measured ones (the start
    is then late by the controller's lag). The motion is judged over all joints together, in parts of their
    ranges: one joint alone may be stuck.

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
    shift = float(log.t[0] + delay)
    marked = log.t[0] < 0 and _mismatch(log, trajectory, spec)[0] <= LARGEST_MISMATCH
    moved = not marked and abs(shift) > 0.5 / rate
    shifted = replace(log, t=log.t - shift) if moved else log
    _check_match(shifted, log, trajectory, spec)
    _check_coverage(shifted, trajectory)
    aligned = _with_desired(shifted, trajectory)
    if not moved:
        return aligned
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


def _check_match(log: RobotLog, unshifted: RobotLog, trajectory: Trajectory, spec: RobotSpec) -> None:
    """Refuses another motion. A wrong sign or order spoils the alignment; the log's own clock may show it."""
    pooled, mismatch = _mismatch(log, trajectory, spec)
    cause = _cause(log, trajectory, mismatch)
    if pooled > CLEAR_MATCH and not cause:
        cause = _cause(unshifted, trajectory, _mismatch(unshifted, trajectory, spec)[1])
    if pooled <= LARGEST_MISMATCH and not cause:
        return
    raise DataError(
        "this is not the log of the proposed trajectory: the motion deviates from it by "
        f"{pooled:.2g} times its spread{cause}",
        where=log.source,
        next_step="Tell the log of this proposal, or the number of the proposal that was run.",
    )


def _motions(log: RobotLog, trajectory: Trajectory) -> tuple[Array, Array]:
    """(motion, proposal) at the log's times within the proposal."""
    inside = (log.t >= 0) & (log.t <= trajectory.duration)
    motion = (log.q if log.q_des is None else log.q_des)[inside]
    return motion, trajectory.sample(log.t[inside]).q


def _mismatch(log: RobotLog, trajectory: Trajectory, spec: RobotSpec) -> tuple[float, Array]:
    """Root mean square deviation over the proposal's spread: pooled in parts of the ranges, and (dof,)."""
    motion, wanted = _motions(log, trajectory)
    size = spec.upper - spec.lower
    error = np.sqrt((((motion - wanted) / size) ** 2).mean(axis=0))
    spread = np.maximum((wanted / size).std(axis=0), 1e-12)
    return float(np.linalg.norm(error) / np.linalg.norm(spread)), error / spread


def _cause(log: RobotLog, trajectory: Trajectory, mismatch: Array) -> str:
    """A guess in words (sign, degrees, exchanged joints) for the first joint that has one; else empty."""
    motion, wanted = _motions(log, trajectory)
    a, b = motion - motion.mean(axis=0), wanted - wanted.mean(axis=0)
    norms = np.outer(np.sqrt((a * a).sum(axis=0)), np.sqrt((b * b).sum(axis=0))) + 1e-300
    likeness = (a.T @ b) / norms
    slope = (a * b).sum(axis=0) / ((b * b).sum(axis=0) + 1e-300)
    for j in np.flatnonzero(mismatch > CLEAR_MATCH):
        other = int(np.argmax(likeness[j]))
        if likeness[j, j] < -ALIKE:
            return f"; joint {log.names[j]} moves in the opposite direction (sign?)"
        if likeness[j, j] > ALIKE and 40 < slope[j] < 80:
            return f"; joint {log.names[j]} looks like degrees"
        if likeness[j, j] < 0.5 and likeness[j, other] > ALIKE:
            return f"; joint {log.names[j]} does what was proposed for {log.names[other]} (joints exchanged?)"
    return ""


def _with_desired(log: RobotLog, trajectory: Trajectory) -> RobotLog:
    """The exact desired motion at the log's times; before and after, a trajectory rests."""
    samples = trajectory.sample(log.t)
    return replace(log, q_des=samples.q, qd_des=samples.qd, qdd_des=samples.qdd)
