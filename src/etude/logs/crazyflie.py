"""Flights of a Crazyflie, as in `examples/crazyflie`: body motion and four motor set-points, no joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.derivatives import segments
from etude.logs.table import Table, read_table

Array = NDArray[np.float64]

FORCE = ("force_x", "force_y", "force_z")
RATES = ("rate_x", "rate_y", "rate_z")
MOTORS = ("motor_1", "motor_2", "motor_3", "motor_4")
COLUMNS = ("flight", "t", *FORCE, *RATES, *MOTORS)
LEAST_ROWS = 50
STANDARD_GRAVITY, DEGREE = 9.80665, float(np.pi / 180.0)
FASTEST = 100.0  # rad/s: 5700 deg/s, beyond every gyroscope of such a vehicle


@dataclass(frozen=True)
class Flight:
    """One uninterrupted stretch of a flight; arrays have one row for each time.

    Attributes:
        number: of the recording; stretches of one flight share it.
        t: (T,) s, strictly increasing.
        specific_force: (T, 3) what the accelerometer measures, body frame, m/s^2; hovering has +9.81 along z.
        rates: (T, 3) angular velocity, body frame, rad/s.
        command: (T, 4) set-point of each motor as a part of full scale, 0 to 1. The motion lags it.
    """

    number: int
    t: Array
    specific_force: Array
    rates: Array
    command: Array


def read_flights(path: str | Path) -> list[Flight]:
    """The stretches in a file with the columns `COLUMNS`, in its order.

    Raises:
        DataError: a column is missing, a number is missing or infinite, time does not increase, set-points
            are not between 0 and 1, rates or specific force in other units, or a short stretch.
    """
    path = Path(path)
    table = read_table(path)
    _check_columns(table, path.name)
    values = {name: table.columns[name] for name in COLUMNS}
    _check_finite(values, path.name)
    flights = []
    for number in dict.fromkeys(values["flight"].tolist()):
        own = values["flight"] == number
        t = values["t"][own]
        if np.any(np.diff(t) <= 0):
            raise DataError(
                f"time does not increase in flight {number:g}",
                where=path.name,
                next_step="Export the flights again, rows in the order of time.",
            )
        force, rates, command = (
            np.column_stack([values[name][own] for name in names]) for names in (FORCE, RATES, MOTORS)
        )
        flights += [
            Flight(int(number), t[piece], force[piece], rates[piece], command[piece]) for piece in segments(t)
        ]
    _check_physics(flights, path.name)
    return flights


def _check_columns(table: Table, where: str) -> None:
    missing = [name for name in COLUMNS if name not in table.columns]
    if missing:
        raise DataError(
            f"there is no column {', '.join(missing)}",
            where=where,
            next_step=f"A file of flights has the columns {', '.join(COLUMNS)}.",
        )


def _check_finite(values: dict[str, Array], where: str) -> None:
    for name, column in values.items():
        bad = np.flatnonzero(~np.isfinite(column))
        if len(bad):
            raise DataError(
                f"{len(bad)} cells are no numbers, the first in data row {bad[0] + 1}",
                where=f"{where}, column {name}",
                next_step="Was the file cut or edited? Export it again.",
            )


def _check_physics(flights: list[Flight], where: str) -> None:
    for flight in flights:
        if len(flight.t) < LEAST_ROWS:
            raise DataError(
                f"a stretch of flight {flight.number} has {len(flight.t)} rows; it needs {LEAST_ROWS}",
                where=where,
                next_step="Was the recording cut? Export it again.",
            )
    command, force, rates = (
        np.concatenate([getattr(flight, name) for flight in flights])
        for name in ("command", "specific_force", "rates")
    )
    if command.min() < 0.0 or command.max() > 1.0:
        raise DataError(
            f"set-points lie between {command.min():.4g} and {command.max():.4g}",
            where=where,
            next_step="Write them as parts of full scale, 0 to 1; divide 16 bits by 65535.",
        )
    if np.abs(rates).max() > FASTEST:
        raise DataError(
            f"a rate of {np.abs(rates).max():.4g} rad/s: are these degrees?",
            where=where,
            next_step=f"Multiply the rates by {DEGREE:.6f}.",
        )
    typical = float(np.median(np.linalg.norm(force, axis=1)))
    if not 0.3 * STANDARD_GRAVITY < typical < 3.0 * STANDARD_GRAVITY:
        raise DataError(
            f"the typical specific force is {typical:.3g} m/s^2, that of a flight is near 9.8: is it in g?",
            where=where,
            next_step=f"Multiply the specific force by {STANDARD_GRAVITY}.",
        )
