"""FlightPlan: a vehicle's desired state at each tick, and the feedforward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude._runtime.rounding import MEASURED, whole_down
from etude.errors import UsageError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightPlan:
    """A reference in the world frame on the control grid.

    Attributes:
        t: (T,) s, uniform, one tick apart.
        position, velocity: (T, 3) m, m/s.
        acceleration_ff: (T, 3) added to the desired acceleration, m/s^2, or None.
        voltage_ff: (T, 4) added to the feedback's command, in the command's unit (V; normalised for a vehicle
            with set-points), or None.
    """

    t: Array
    position: Array
    velocity: Array
    acceleration_ff: Array | None = None
    voltage_ff: Array | None = None

    def __len__(self) -> int:
        return len(self.t)


def plan_on_grid(
    t: Array,
    position: Array,
    velocity: Array,
    acceleration_ff: Array | None = None,
    voltage_ff: Array | None = None,
    rate: float = 1000.0,
) -> FlightPlan:
    """A plan given at coarser times, on the control grid: cubic Hermite between positions and velocities.

    Position is right to the fourth order of the given spacing, velocity to the third; feedforwards are
    linear.

    Args:
        t: (M,) s, increasing, M >= 2; the others (M, 3), (M, 3), (M, 3) or None, (M, 4) or None.
        rate: Hz.

    Raises:
        UsageError: times that do not increase, a wrong shape, or values that are not finite.
    """
    t, position, velocity = (np.asarray(x, dtype=np.float64) for x in (t, position, velocity))
    _check_coarse(t, position, velocity, acceleration_ff, voltage_ff)
    # the last tick may lie half a tick of rounding beyond the end
    fine = t[0] + np.arange(whole_down((t[-1] - t[0]) * rate, MEASURED) + 1) / rate
    index = np.clip(np.searchsorted(t, fine, side="right") - 1, 0, len(t) - 2)
    width = (t[index + 1] - t[index])[:, None]
    s = (fine - t[index])[:, None] / width
    p0, p1, v0, v1 = (
        position[index],
        position[index + 1],
        velocity[index] * width,
        velocity[index + 1] * width,
    )
    a, b = 2.0 * (p0 - p1) + v0 + v1, 3.0 * (p1 - p0) - 2.0 * v0 - v1
    return FlightPlan(
        t=fine,
        position=p0 + s * (v0 + s * (b + s * a)),
        velocity=(v0 + s * (2.0 * b + s * 3.0 * a)) / width,
        acceleration_ff=_linear(fine, t, acceleration_ff),
        voltage_ff=_linear(fine, t, voltage_ff),
    )


def check_plan(plan: FlightPlan, rate: float, name: str) -> None:
    """
    Raises:
        UsageError: a wrong shape, values that are not finite, or another grid than that of `rate`.
    """
    count = len(plan.t)
    _check_rows("position", plan.position, count, 3, name)
    _check_rows("velocity", plan.velocity, count, 3, name)
    _check_rows("acceleration_ff", plan.acceleration_ff, count, 3, name)
    _check_rows("voltage_ff", plan.voltage_ff, count, 4, name)
    # a thousandth of a tick: times of a plan may come from a text file
    if not np.isfinite(plan.t).all() or np.any(np.abs(np.diff(plan.t) * rate - 1.0) > 1e-3):
        raise UsageError(
            "the plan is not sampled on the vehicle's control grid",
            where=f"{name}, t",
            next_step=f"Sample it every {1.0 / rate:g} s, for example with plan_on_grid.",
        )


def _check_coarse(
    t: Array, position: Array, velocity: Array, acceleration_ff: Array | None, voltage_ff: Array | None
) -> None:
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or np.any(np.diff(t) <= 0.0):
        raise UsageError(
            "the times of the plan do not increase", where="t", next_step="Give two or more increasing times."
        )
    for what, rows, columns in (
        ("position", position, 3),
        ("velocity", velocity, 3),
        ("acceleration_ff", acceleration_ff, 3),
        ("voltage_ff", voltage_ff, 4),
    ):
        _check_rows(what, rows, len(t), columns, "plan")


def _check_rows(what: str, rows: Array | None, count: int, columns: int, where: str) -> None:
    if rows is None:
        return
    if count == 0 or np.shape(rows) != (count, columns):
        raise UsageError(
            f"{what} has shape {np.shape(rows)}, not ({max(count, 1)}, {columns})",
            where=where,
            next_step="Give one row per time.",
        )
    if not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        raise UsageError(
            f"{what} is {rows[row, column]}",
            where=f"{where}, row {row}, column {column}",
            next_step="Every desired value and every feedforward must be a finite number.",
        )


def _linear(fine: Array, t: Array, rows: Array | None) -> Array | None:
    if rows is None:
        return None
    return np.column_stack([np.interp(fine, t, column) for column in np.asarray(rows).T])
