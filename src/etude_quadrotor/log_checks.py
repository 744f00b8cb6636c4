"""Log checks of a flight besides units and ranges: ground, jumps, scales, contradicting sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.logs.checks.filtered_motion import runs
from etude.logs.checks.finding_texts import Excludable
from etude.logs.checks.plausibility import jump_finding
from etude.types import Array, Finding, Log, Mask
from etude_quadrotor.channels import PATH
from etude_quadrotor.sensor_consistency import agreement_findings
from etude_quadrotor.spec import QuadrotorSpec

HOVER = (0.5, 2.0)
"""Plausible range of the mean command of a flight, as a ratio to the hover voltage."""


def findings(spec: QuadrotorSpec, log: Log) -> Sequence[Finding]:
    """The findings of every check."""
    jump = jump_finding(log, PATH, np.full(3, spec.speed))
    return (_ground(spec, log), *_idle(log), jump, *agreement_findings(spec, log), _scale(spec, log))


def _idle(log: Log) -> tuple[Finding, ...]:
    """A finding about a vehicle that was never armed: its log is not informative."""
    if np.ptp(log["command"], axis=0).any():
        return ()
    fact = "No motor's command ever changes: the vehicle was not armed, or commands were not recorded."
    return (Finding("motors", "red", fact, "Record a flight, with the motors' set-points."),)


CHECK = "ground"
WINDOW_S = 0.2  # windows in which rest and ground are judged
TURNING = 0.05  # rad/s: deviation of the gyroscope in a window, above which something moves
SHAKING = 0.35  # m/s^2: the same of the specific force
WEIGHT, OFF = 9.81, 0.6  # m/s^2: specific force at rest, and its tolerance
COMMANDED = 0.2  # of a motor's range: commands that count for the median
IDLE = 0.5  # of that median: idling motors
TURNS = 0.1  # rad/s: a vehicle with a larger mean rate in a window does not stand still
CARRIED = 3  # windows in a row: a dive whose drag is the weight for a moment is no landing
LANDED_S = 1.0  # of ground between two flights, below which it stays
SPARE_S = 0.5  # next to the ground: its effect, and contact


@dataclass(frozen=True, eq=False)
class Windows:
    """Start and end (w,) s of each window, and whether the vehicle is at rest or on the ground."""

    start: Array
    end: Array
    rest: Mask
    ground: Mask


def windows(t: Array, gyro: Array | None, force: Array | None, throttle: Array) -> Windows:
    """Rest and ground in each window.

    On the ground the floor carries the weight: the motors idle, and the accelerometer still reads gravity. So
    ground is detected even if idling motors shake the sensors.

    Args:
        t: (T,) s. gyro: (T, 3) rad/s, force: (T, 3) m/s^2 of the body; None if not measured: then the command
            alone decides.
        throttle: (T, m) commands of the motors as fractions of their range.
    """
    count = max(int((t[-1] - t[0]) / WINDOW_S), 1)
    number = np.minimum(((t - t[0]) / WINDOW_S).astype(np.int64), count - 1)
    rows = np.maximum(np.bincount(number, minlength=count), 1)

    def mean(values: Array) -> Array:
        sums = [np.bincount(number, column, count) for column in values.T]
        return np.asarray(np.stack(sums, axis=1) / rows[:, None])

    def deviation(values: Array) -> Array:
        squares = ((values - mean(values)[number]) ** 2).sum(axis=1)
        return np.asarray(np.sqrt(mean(squares[:, None])[:, 0]))

    at_rest = np.asarray(np.bincount(number, minlength=count) > 1)  # one row has no deviation
    carried = at_rest & (gyro is not None and force is not None)
    if gyro is not None:
        at_rest &= deviation(gyro) < TURNING
        carried &= np.linalg.norm(mean(gyro), axis=1) < TURNS
    if force is not None:
        weight = np.abs(np.linalg.norm(mean(force), axis=1) - WEIGHT) < OFF
        at_rest &= weight & (deviation(force) < SHAKING)
        carried &= weight
    level = throttle.mean(axis=1)
    used = level[level > COMMANDED]
    hover = float(np.median(used)) if len(used) else 0.0
    low = mean(level[:, None])[:, 0] < IDLE * hover
    edges = t[0] + WINDOW_S * np.arange(count + 1)
    edges[-1] = max(float(t[-1]), float(edges[-2]))
    return Windows(edges[:-1], edges[1:], at_rest, low & (at_rest | _lasting(carried & low)))


def _lasting(marked: Mask) -> Mask:
    """Mask of marks that last for CARRIED windows or more."""
    lasting = np.zeros_like(marked)
    for a, b in runs(marked):
        lasting[a:b] = b - a >= CARRIED
    return lasting


def spans_of(segments: Windows, marked: Mask) -> tuple[tuple[float, float], ...]:
    """Intervals (s) of neighbouring marked windows."""
    return tuple((float(segments.start[a]), float(segments.end[b - 1])) for a, b in runs(marked))


class Grounded(Excludable):
    """Removes time on the ground at both ends and between flights, which is not informative."""

    def cut(self, log: Log) -> Log:
        """The log without the ground at its ends and between flights, and without SPARE_S beside it.

        A log entirely on the ground stays unchanged, and so do short contacts within a flight.
        """
        start, end = float(log.t[0]), float(log.t[-1])
        flown = np.ones(len(log), dtype=np.bool_)
        between = False
        for low, high in self.spans:
            # 1 ns: a span that ends with the log, however its time is rounded
            inside = low > start and high < end - 1e-9
            if not inside or high - low >= LANDED_S:
                flown &= (log.t <= low - SPARE_S) | (log.t >= high + SPARE_S)
                between |= inside
        if not flown.any() or flown.all():
            return log.repaired(self.sentence)
        where = "there and beside it" if between else "at the ends"
        cut = float((~flown).sum() * np.median(np.diff(log.t)))
        return log.take(flown).repaired(f"{self.sentence} {cut:.3g} s {where} were cut.")


def ground_finding(segments: Windows) -> Finding:
    """A finding about time on the ground, with the intervals to trim or mark."""
    spans = spans_of(segments, segments.ground)
    if not spans:
        return Finding(CHECK, "green", "The vehicle is in flight in the whole log.")
    seconds = sum(end - start for start, end in spans)
    return Grounded(
        CHECK,
        "yellow",
        f"The vehicle is on the ground for {seconds:.3g} s.",
        f"These parts, at the ends and between flights, are cut with {SPARE_S:g} s around them, unless "
        f"ingested with --accept {CHECK}.",
        spans=spans,
    )


def _ground(spec: QuadrotorSpec, log: Log) -> Finding:
    """A finding about idle motors while nothing moves, before take-off or after landing."""
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    motors = low >= 0.0  # other commands are angles and rates, whose mean is not a thrust
    if not motors.any():
        return Finding(CHECK, "cannot tell", "No command is that of a motor.")
    throttle = (log["command"] - low)[:, motors] / (high - low)[motors]
    return ground_finding(windows(log.t, log["rates"], log["specific_force"], throttle))


def _scale(spec: QuadrotorSpec, log: Log) -> Finding:
    """A finding about a vehicle with described motors: its voltage in hover against that of the flight."""
    vehicle = spec.body
    if vehicle is None:
        return Finding("scale", "cannot tell", "The motors of the vehicle are not described in V.")
    mean = float(np.mean(log["command"]))
    fact = f"The mean command is {mean:.3g} V, but it should hover at {vehicle.hover_voltage:.3g} V."
    if HOVER[0] < mean / vehicle.hover_voltage < HOVER[1]:
        return Finding("scale", "green", fact)
    step = "Check mass, thrust_constant, motor_constant and resistance in "
    return Finding("scale", "yellow", fact, f"{step}robot.toml, and the commands' unit.")
