"""Units that a log does not state: time by its steps, degrees and milli-units by the robot's limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.doctor import add_repair
from etude.logs.log import RobotLog
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SMALLER_POSITIONS = {"degrees": np.pi / 180, "milliradians (or mm)": 1e-3}
FAR = 2.0  # ranges outside the limits: no other robot, another unit
OVERSHOOT = 0.1  # of a joint's range: a controller may overshoot, a spec may be a little tight
COMMAND_EXCESS = (
    1.5  # times the command limit: measured effort exceeds its rating, another unit exceeds it more
)


def time_factor(t: Array, rate: float, where: str) -> tuple[float, str]:
    """Factor to seconds and the unit's name, from the typical step of t (T,) against the robot's rate in Hz.

    Raises:
        DataError: no unit brings the steps within a factor 50 of the rate.
    """
    steps = np.diff(t)
    steps = steps[steps > 0]
    if not len(steps):
        raise DataError(
            "the time never advances", where=f"{where}, time column", next_step="Export the log again."
        )
    step = float(np.median(steps))
    distance = {unit: abs(np.log(step * factor * rate)) for unit, factor in TIME_UNITS.items()}
    unit = min(distance, key=lambda name: distance[name])
    if distance[unit] > np.log(50.0):
        raise DataError(
            f"the time step {step:g} fits no unit at {rate:g} Hz",
            where=f"{where}, time column",
            next_step="Name the unit in the header (time_ms, t [s]), or correct the robot's rate.",
        )
    return TIME_UNITS[unit], unit


def start_at_zero(log: RobotLog) -> RobotLog:
    """Shifts time to begin at 0 unless the log itself contains t = 0 (then earlier samples are lead-in)."""
    if log.t[0] <= 0 <= log.t[-1]:
        return log
    shifted = replace(log, t=log.t - log.t[0])
    if abs(log.t[0]) < float(np.median(np.diff(log.t))):
        return shifted
    return add_repair(shifted, f"Time begins at {log.t[0]:.3f} s and was shifted to 0.")


def position_suspicion(values: Array, spec: RobotSpec) -> str:
    """The unit ("degrees", ...) that positions (T, dof) outside the limits seem to have, else ''."""
    excess = np.maximum(values.max(axis=0) - spec.upper, spec.lower - values.min(axis=0))
    far = (excess > FAR * (spec.upper - spec.lower)).any() and np.abs(values).max() > np.pi
    if not far:
        return ""
    for unit, factor in SMALLER_POSITIONS.items():
        if _fits(values * factor, spec):
            return unit
    return ""


def _fits(values: Array, spec: RobotSpec) -> bool:
    slack = OVERSHOOT * (spec.upper - spec.lower)
    return bool(np.all((values >= spec.lower - slack) & (values <= spec.upper + slack)))


def check_positions(log: RobotLog, spec: RobotSpec) -> RobotLog:
    """Notes positions a little outside the limits; refuses degrees and positions far outside."""
    unit = position_suspicion(log.q, spec)
    if unit:
        raise DataError(
            f"the positions look like {unit}, not radians: they reach {np.abs(log.q).max():.4g} "
            f"where the limits are within {max(np.abs(spec.lower).max(), np.abs(spec.upper).max()):.4g} rad",
            where=log.source,
            next_step="Convert them, name the unit in the header (q_joint [deg]), or ask for the conversion.",
        )
    over = np.maximum(log.q.max(axis=0) - spec.upper, spec.lower - log.q.min(axis=0))
    if not _fits(log.q, spec):
        j = int(np.argmax(over / (spec.upper - spec.lower)))
        raise DataError(
            f"the position reaches {log.q[np.argmax(np.abs(log.q[:, j])), j]:.4g} rad, outside the limits "
            f"{spec.lower[j]:.4g} to {spec.upper[j]:.4g} rad",
            where=f"{log.source}, joint {log.names[j]}",
            next_step="Is this log of another robot or in another unit? If not, correct the robot's limits.",
        )
    for k in np.flatnonzero(over > 0):
        log = add_repair(
            log, f"Joint {log.names[k]} went {over[k]:.2g} rad outside its position limits; kept."
        )
    return log


def check_consistency(log: RobotLog, spec: RobotSpec) -> None:
    """Refuses positions whose slope is 57 or 1000 times the logged velocity (mixed units)."""
    if log.qd is None:
        return
    slope = np.gradient(log.q, log.t, axis=0)
    for j in np.flatnonzero(np.abs(log.qd).max(axis=0) > 0):
        factor = float(slope[:, j] @ log.qd[:, j] / (log.qd[:, j] @ log.qd[:, j]))
        for unit, ratio in {"degrees": 180 / np.pi, "milliradians (or mm)": 1e3}.items():
            for text, expected in (
                (f"position in {unit}", ratio),
                (f"velocity in {unit} per second", 1 / ratio),
            ):
                if 0.8 < abs(factor) / expected < 1.25:
                    raise DataError(
                        f"position and velocity disagree by a factor {factor:.3g}: {text}?",
                        where=f"{log.source}, joint {spec.names[j]}",
                        next_step="Convert it to radians, or name the unit in the header.",
                    )


def check_commands(log: RobotLog, spec: RobotSpec) -> RobotLog:
    """Notes commands above their limit; refuses commands so far above that the unit must be another."""
    largest = np.abs(log.tau).max(axis=0)
    for j in np.flatnonzero(largest > spec.command):
        place = f"{log.source}, joint {log.names[j]}"
        if largest[j] > COMMAND_EXCESS * spec.command[j]:
            milli = largest[j] * 1e-3 <= spec.command[j] and largest[j] > 30 * spec.command[j]
            raise DataError(
                f"the command reaches {largest[j]:.4g}, "
                f"its limit is {spec.command[j]:.4g} {spec.command_unit}",
                where=place,
                next_step=f"It looks like a thousandth of the unit: convert it to {spec.command_unit}."
                if milli
                else f"Is it in {spec.command_unit}? If so, correct the command limit in the robot file.",
            )
        log = add_repair(
            log,
            f"The command of joint {log.names[j]} reached {largest[j]:.4g} {spec.command_unit}, "
            f"above its limit {spec.command[j]:.4g}; kept.",
        )
    return log
