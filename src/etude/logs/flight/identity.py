"""Is this the log of that flight? Alignment of a recorded flight with the proposal it claims to follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.delay import measure_delay
from etude.logs.smoothing import median_rate
from etude.logs.flight.log import FlightLog
from etude.logs.flight.table import ending
from etude.robots.flight_spec import FlightSpec
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]

LARGEST_MISMATCH = 0.85
"""Root mean square deviation over the proposal's spread: as for arms."""
LEAST_COVERAGE = 0.5
"""Part of the proposal that the log has to contain."""


def align_flight(log: FlightLog, trajectory: FourierTrajectory, spec: FlightSpec) -> FlightLog:
    """The flight with t = 0 at the proposal's start and the desired position filled in.

    A log without positions is taken at its word: its clock then has to start with the flight.

    Raises:
        DataError: it is another flight, less than half of it, or one that broke off: a flight that hit the
            ground or left its room teaches nothing from there on.
    """
    if log.position is None:
        return log
    rate = median_rate(log.t)
    t = np.arange(0.0, trajectory.duration, 1.0 / rate)
    wanted = trajectory.sample(t).q
    span = (-trajectory.duration, float(log.t[-1] - log.t[0]))
    shift = float(log.t[0] + measure_delay(wanted, log.position, rate, span).seconds)
    own = _mismatch(log.t, log.position, trajectory, spec)
    moved = abs(shift) > 0.5 / rate and _mismatch(log.t - shift, log.position, trajectory, spec) < 0.5 * own
    times = log.t - shift if moved else log.t
    _check(times, log, trajectory, spec)
    inside = (times >= -0.5 / rate) & (times <= trajectory.duration + 0.5 / rate)
    kept = _taken(log, inside, times[inside])
    desired = trajectory.sample(np.clip(kept.t, 0.0, trajectory.duration)).q
    sentence = f"The proposal starts {shift:.3f} s into the log's time; t = 0 was moved there."
    return replace(kept, position_des=desired, repairs=(*log.repairs, sentence) if moved else log.repairs)


def _taken(log: FlightLog, inside: NDArray[np.bool_], times: Array) -> FlightLog:
    assert log.position is not None
    return replace(
        log,
        t=times,
        states=log.states.take(inside),
        command=log.command[inside],
        position=log.position[inside],
    )


def _mismatch(t: Array, position: Array, trajectory: FourierTrajectory, spec: FlightSpec) -> float:
    """Root mean square distance over the proposal's spread; infinite without overlap."""
    inside = (t >= 0.0) & (t <= trajectory.duration)
    if not inside.any():
        return np.inf
    wanted = trajectory.sample(t[inside]).q
    size = np.array(spec.upper) - np.array(spec.lower)
    spread = np.linalg.norm(wanted.std(axis=0) / size)
    error = np.sqrt(np.mean((((position[inside] - wanted) / size) ** 2).sum(axis=1)))
    return float(error / max(spread, 1e-9))


def _check(times: Array, log: FlightLog, trajectory: FourierTrajectory, spec: FlightSpec) -> None:
    assert log.position is not None
    mismatch = _mismatch(times, log.position, trajectory, spec)
    if mismatch > LARGEST_MISMATCH:
        raise DataError(
            f"this is not the log of the proposed flight: it is {mismatch:.2g} of its spread away from it",
            where=log.source,
            next_step="Tell the log of this proposal, or the number of the proposal that was flown.",
        )
    covered = min(times[-1], trajectory.duration) - max(times[0], 0.0)
    if covered < LEAST_COVERAGE * trajectory.duration:
        share = f"{max(covered, 0.0):.3g} of the flight's {trajectory.duration:.3g} s"
        raise DataError(
            f"the log holds {share}. {ending(log)}".rstrip(" ."),
            where=log.source,
            next_step="Fly it again from start to end; fly gentler if it hit the ground or left its room.",
        )
