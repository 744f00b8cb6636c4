"""Sensor consistency of a flight log: gyroscope, accelerometer, attitude, position, motors.

A rigid body's kinematics holds for any vehicle. Over a short time, the attitude turns by the integral of the
rates. The second difference of the position is the specific force in the world, less gravity, under a
triangular window. A log is doubted only if another interpretation of its columns (units, axes, order of the
quaternion, frames) explains it much better than its header.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from etude.logs.checks.finding_texts import accepted
from etude.types import Array, Finding, Index, Log
from etude_quadrotor.channels import AXES
from etude_quadrotor.recorder import rotation
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY

RATES, FORCE, DELAY = "gyroscope", "accelerometer", "motor_delay"
"""The checks."""
GRID = 100.0
"""Hz on which logs are compared; attitudes and motors are slower."""
TURN_S, MOVE_S = 0.1, 0.5
"""s over which attitudes are differenced, and half the window of positions: long against noise and filters,
short against a turn."""
LEAST_S = 5.0
"""s: shorter flights are not compared."""
LEAST_TURN, LEAST_PUSH = 0.01, 0.4
"""Least error of the stated interpretation, rad and m/s^2 (rms): biases and offsets of sensors are
smaller.
"""
LIKE, BETTER = 0.5, 4.0
"""Largest unexplained part of the motion under another interpretation, and least ratio to it of that under
the stated one.
"""
NEAR = 1.5
"""Of the interpretations within this factor of the best one, that with the fewest changes is named."""
DEGREES = 180.0 / np.pi
FRD, NED = np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
BIAS = 0.5
"""m/s^2: constant difference attributed to a sensor offset, or to an attitude error of 3 degrees."""
OUTLIER = 30.0
"""m/s^2: a leap of the position, not a flight."""
LATE, SOON, SPAN = 0.25, -0.1, 1.5
"""s: largest delay of motors behind their commands in the search, propellers and filters included."""
SMOOTH_S = 0.05
"""s over which commands, forces and angular accelerations are averaged: less is noise."""
HEARD, CLEAR = 0.75, 1.5
"""Largest unexplained part of the thrust, or of one torque, for which a delay is stated; and the ratio, as a
product over all four, by which another delay must be worse.
"""
SMALLEST = 1e-6
"""Least unexplained part: smaller values are below the measurement noise."""


@dataclass(frozen=True, eq=False)
class Reading:
    """An interpretation of some columns: its description, its number of changes, its unexplained part."""

    description: str
    changes: int
    left: float


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight on an even grid: rates, force (T, 3), quaternion (T, 4) w first and its rotation, position (T,
    3).
    """

    step: float
    rates: Array
    force: Array
    R_world_body: Array
    quaternion: Array | None
    position: Array | None


def agreement_findings(spec: QuadrotorSpec, log: Log) -> tuple[Finding, ...]:
    """A finding for each pair of instruments in the log, whether they agree."""
    findings = [_delay_finding(spec, log)]
    flight = _flight(log)
    if flight is not None:
        findings += [_rates_finding(flight), _force_finding(flight)]
    return tuple(one for one in findings if one is not None)


def _flight(log: Log) -> Flight | None:
    """The flight; None without an attitude, or for a log that is too short."""
    R = rotation(log)
    if R is None or log.t[-1] - log.t[0] < LEAST_S or not np.isfinite(R).all():
        return None
    t = np.arange(log.t[0], log.t[-1], 1.0 / GRID)
    rows = np.clip(np.searchsorted(log.t, t), 0, len(log) - 1)

    def at(values: Array) -> Array:
        return np.column_stack([np.interp(t, log.t, column) for column in values.T])

    return Flight(
        1.0 / GRID,
        at(log["rates"]),
        at(log["specific_force"]),
        _interpolated_rotations(log.t, R, t),
        log["orientation"][rows] if "orientation" in log else None,
        at(log["position"]) if "position" in log else None,
    )


def _interpolated_rotations(t: Array, R: Array, times: Array) -> Array:
    """Rotations (n, 3, 3) at other times, on the shortest path."""
    from scipy.spatial.transform import Rotation, Slerp

    distinct = np.concatenate([[True], np.diff(t) > 0.0])
    interpolated = Slerp(t[distinct], Rotation.from_matrix(R[distinct]))(
        np.clip(times, t[0], t[distinct][-1])
    )
    return np.asarray(interpolated.as_matrix())


def _attitudes(flight: Flight) -> Iterator[tuple[str, int, Array]]:
    """Interpretations of the attitude, the header's first."""
    from scipy.spatial.transform import Rotation

    yield "", 0, flight.R_world_body
    yield "the attitude is inverted (world in the body frame)", 1, flight.R_world_body.swapaxes(1, 2)
    if flight.quaternion is not None:  # w, x, y, z are in fact x, y, z, w
        turned = np.asarray(Rotation.from_quat(flight.quaternion).as_matrix())
        yield "the quaternion's parts are x, y, z, w, under a header w, x, y, z", 1, turned


SCALES = {
    "": 1.0,
    "the gyroscope is in degrees per second": 1.0 / DEGREES,
    "the gyroscope is 57 times too small": DEGREES,
    "the times are twice as long as they were": 0.5,
    "the times are half as long as they were": 2.0,
}
"""What rates, or the clock, may be, and the factor that it takes."""


def _rates_finding(flight: Flight) -> Finding | None:
    """A finding on rates against changes of the attitude."""
    span = round(TURN_S / flight.step)
    measured = _windowed(flight.rates, span)
    readings: list[Reading] = []
    for label, changes, R in _attitudes(flight):
        turns = _vectors(R, span)
        size = float(np.mean(np.sum(turns**2, axis=1)))
        for unit, factor in SCALES.items():
            for axes, turn in _signed_permutations():
                left = float(np.mean(np.sum((turns - factor * measured @ turn.T) ** 2, axis=1)))
                if not readings and np.sqrt(left) < LEAST_TURN:  # as stated: no other interpretation is tried
                    return Finding(RATES, "green", "The gyroscope matches the rotation of the attitude.")
                parts = [
                    label,
                    unit,
                    _axes("the gyroscope", axes, turn),
                ]
                count = changes + bool(unit) + _change_count(turn)
                # 1e-300: a log without motion explains nothing
                readings.append(Reading("; ".join(filter(None, parts)), count, left / max(size, 1e-300)))
    return _agreement_finding(RATES, readings, "The gyroscope does not match the rotation of the attitude")


def _vectors(R: Array, span: int) -> Array:
    """Rotation vectors (n, 3) in the body, from each row to the row `span` later."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(np.einsum("tji,tjk->tik", R[:-span], R[span:])).as_rotvec())


def _windowed(values: Array, span: int) -> Array:
    """Integrals over `span` steps of the grid."""
    whole = np.cumsum(0.5 * (values[1:] + values[:-1]), axis=0) / GRID
    whole = np.concatenate([np.zeros((1, values.shape[1])), whole])
    return np.asarray(whole[span:] - whole[:-span])


def _force_finding(flight: Flight) -> Finding | None:
    """A finding on the specific force in the world against the second difference of the position."""
    if flight.position is None:
        return None
    span = round(MOVE_S / flight.step)
    p = flight.position
    moved = (p[2 * span :] - 2.0 * p[span:-span] + p[: -2 * span]) / MOVE_S**2
    valid = np.isfinite(moved).all(axis=1) & (np.abs(moved) < OUTLIER).all(axis=1)
    if valid.sum() < LEAST_S * GRID / 2:
        return None
    moved = moved[valid]
    # vertical and horizontal motion have different information: each axis is weighted by its motion
    size = float(np.mean(np.sum((moved - moved.mean(axis=0)) ** 2, axis=1)))
    readings: list[Reading] = []
    for labels, changes, force in _world_forces(flight):
        pushed = _triangle(force - [0.0, 0.0, GRAVITY], span)[valid]
        for axes, turn in _signed_permutations():
            off = moved @ turn.T - pushed
            off = off - np.clip(off.mean(axis=0), -BIAS, BIAS)
            left = float(np.mean(np.sum(off**2, axis=1)))
            if not readings and np.sqrt(left) < LEAST_PUSH:
                return Finding(FORCE, "green", "The accelerometer matches the motion of the position.")
            parts = [*labels, _axes("the position", axes, turn)]
            # 1e-300: a log without motion explains nothing
            readings.append(
                Reading(
                    "; ".join(filter(None, parts)), changes + _change_count(turn), left / max(size, 1e-300)
                )
            )
    return _agreement_finding(
        FORCE,
        readings,
        "The accelerometer, rotated by the attitude, does not match the motion of the position",
    )


def _world_forces(flight: Flight) -> Iterator[tuple[list[str], int, Array]]:
    """Specific force (T, 3) in the world by each reading of attitude, frames and accelerometer.

    Each has its words, and the number of changes to what the log says.
    """
    frames = (
        ("", 0, np.eye(3), np.eye(3)),
        (
            "the attitude is that of a body x forward, y right, z down in a world north, east, down",
            1,
            NED,
            FRD,
        ),
        ("the attitude is that of a body x forward, y right, z down", 2, np.eye(3), FRD),
    )
    senses = (
        ("", 0, np.eye(3)),
        ("the accelerometer's axes are x forward, y right, z down", 1, FRD),
        ("the accelerometer has the sign of gravity, -9.81 along z in hover", 1, -np.eye(3)),
    )
    for attitude, changes, R in _attitudes(flight):
        for frame, one, world, body in frames:
            for force, two, sense in senses:
                turned = np.einsum("tij,tj->ti", world @ R @ body, flight.force @ sense.T)
                yield [attitude, frame, force], changes + one + two, turned


def _triangle(values: Array, span: int) -> Array:
    """Means under the triangular window of a second difference."""
    weights = np.concatenate([np.arange(1, span + 1), np.arange(span - 1, 0, -1)]) / span**2
    made = [np.convolve(column, weights, "valid") for column in values.T]
    return np.column_stack(made)[: len(values) - 2 * span]


def _signed_permutations() -> list[tuple[str, Array]]:
    """The 48 signed permutations of the axes with their names, such as "y, x, -z"."""
    permutations = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            name = ", ".join(("-" if s < 0 else "") + AXES[k] for k, s in zip(order, signs, strict=True))
            permutations.append((name, turn))
    return permutations


def _change_count(turn: Array) -> int:
    """Number of changes of an interpretation; a common frame counts as one."""
    if np.array_equal(turn, np.eye(3)):
        return 0
    if any(np.array_equal(turn, frame) for frame in (FRD, NED)):
        return 1
    return 2 if np.linalg.det(turn) > 0.0 or (np.abs(np.trace(turn)) == 1.0 and (turn >= 0.0).all()) else 3


def _axes(whose: str, axes: str, turn: Array) -> str:
    """The permutation in words; "" for unchanged axes."""
    if np.array_equal(turn, np.eye(3)):
        return ""
    names = {"x, -y, -z": "; x forward, y right, z down", "y, x, -z": "; north, east, down"}
    return f"{whose} has ({axes}) where (x, y, z) is stated{names.get(axes, '')}"


def _agreement_finding(check: str, readings: Sequence[Reading], fact: str) -> Finding:
    """A finding, red if another interpretation explains the motion and that of the header does not."""
    stated, best = readings[0], min(readings, key=lambda one: one.left)
    alone = f"{fact} everywhere, and no other interpretation of the columns is better."
    if best.left > LIKE or stated.left < BETTER * best.left:
        return Finding(
            check, "cannot tell", f"{fact} everywhere, and no other interpretation of the columns is better."
        )
    # 0.01: two interpretations with almost no residual are equally good
    near = [one for one in readings if one.left < NEAR * best.left + 0.01]
    named = min(near, key=lambda one: (one.changes, one.left))
    if not named.changes:
        return Finding(check, "green", alone)
    step = f"Correct the columns or their header; {accepted(check)}."
    share = 100.0 * min(stated.left, 99.0)
    sentence = f"{fact} ({share:.0f} % of it is unexplained). It matches if {named.description}"
    return Finding(check, "red", f"{sentence} ({100.0 * named.left:.0f} %).", step, flag=check)


def _delay_finding(spec: QuadrotorSpec, log: Log) -> Finding | None:
    """A finding on the delay from the motors' commands to their thrust and torques.

    The force along the body's z axis and the angular accelerations are linear in four commands, for any frame
    and order of the motors. A controller changes these commands all the time, also in hover.
    """
    motors = np.array(spec.command_lower) >= 0.0
    if not motors.all() or log.t[-1] - log.t[0] < 2.0 * LEAST_S:
        return None
    t = np.arange(log.t[0], log.t[-1], 1.0 / GRID)
    force = np.interp(t, log.t, log["specific_force"][:, 2])
    rates = np.column_stack([np.interp(t, log.t, column) for column in log["rates"].T])
    commands = np.column_stack([np.interp(t, log.t, column) for column in log["command"].T])
    turning = np.gradient(_smooth(rates), axis=0) * GRID
    made = np.column_stack([force, turning])
    lags = np.arange(round(-SPAN * GRID), round(SPAN * GRID) + 1, 2)
    left = _unexplained(_slow_removed(_smooth(commands)), _slow_removed(_smooth(made)), lags)
    total = np.log(left).sum(axis=1)
    within = np.flatnonzero((lags >= SOON * GRID) & (lags <= LATE * GRID))
    best, usual = int(np.argmin(total)), int(within[np.argmin(total[within])])
    lag = lags[best] / GRID
    if left[best].min() > HEARD or SOON <= lag <= LATE or total[usual] - total[best] < np.log(CLEAR):
        return None
    shift = f"{abs(lag):.2f} s {'before' if lag > 0.0 else 'after'}"
    shares = ["/".join(f"{100.0 * (1.0 - part):.0f}" for part in left[k]) for k in (best, usual)]
    fact = (
        f"The motor commands are {shift} their thrust and torques (shifted, they explain {shares[0]} % of "
        f"these, within {LATE:g} s at most {shares[1]} %): another clock, or another column."
    )
    step = f"Shift their column, or record everything with one clock; {accepted(DELAY)}."
    return Finding(DELAY, "red", fact, step, flag=DELAY)


def _smooth(values: Array) -> Array:
    """Means over `SMOOTH_S` of columns (T, n), of the same length."""
    return _means(values, round(SMOOTH_S * GRID))


def _slow_removed(values: Array) -> Array:
    """The columns less their means over two seconds, because weight and battery change slowly."""
    return np.asarray(values - _means(values, round(2.0 * GRID) + 1))


def _means(values: Array, width: int) -> Array:
    """Means (T, n) over an odd number of rows about each row."""
    padded = np.pad(values, ((width // 2, width // 2), (0, 0)), mode="edge")
    weights = np.ones(width) / width
    return np.column_stack([np.convolve(column, weights, "valid") for column in padded.T])


def _unexplained(commands: Array, made: Array, lags: Index) -> Array:
    """Fraction (L, n) of the squares of made (T, n) that no linear combination of earlier commands (T, m)
    explains.
    """
    fractions = []
    for lag in lags.tolist():
        a = commands[max(0, -lag) : len(commands) - max(0, lag)]
        b = made[max(0, lag) : len(made) - max(0, -lag)]
        off = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
        fractions.append(np.sum(off**2, axis=0) / np.maximum(np.sum(b**2, axis=0), np.finfo(float).tiny))
    return np.asarray(np.maximum(np.array(fractions), SMALLEST))
