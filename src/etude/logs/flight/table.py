"""From a file to a cleaned FlightLog at its own rate: columns matched, units checked, rows repaired."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.logs.smoothing import median_rate, segments, smooth, uniform_grid
from etude.logs.flight.columns import FlightColumns, flight_columns
from etude.logs.flight.log import FlightLog
from etude.logs.flight.parquet import is_cleaned_flight, read_flight_parquet
from etude.logs.read import read_time
from etude.logs.table import read_table
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]

LEAST_ROWS = 50
USUAL_RATE = 200.0
"""Hz; flight recorders write 10 to 1000 times a second, so the unit of time can be told."""
LARGEST_LOSS = 0.2
"""Part of the rows that may be unreadable."""
CUTOFF_SHARE = 0.125
"""Cutoff of the gyroscope's derivative, of the log's rate: noise grows with frequency, motors are slower."""
SATURATED = 0.99
"""A command this near to its limit throughout says nothing of the motion."""


def read_flight(path: str | Path, spec: FlightSpec, *, degrees: bool = False) -> FlightLog:
    """Reads, checks and repairs a recorded flight of the vehicle `spec`.

    Args:
        path: CSV or Parquet; headers as `logs.flight_columns` describes.
        spec: whose commands and limits the log must fit.
        degrees: the file's rates (and roll, pitch, yaw) are degrees; convert them.

    Raises:
        DataError: the file cannot be used; the message says what, where and what to do.
    """
    path = Path(path)
    if path.suffix.lower() == ".parquet" and is_cleaned_flight(path):
        log = read_flight_parquet(path)
        if log.command_names != spec.command_names:
            raise DataError(
                f"the flight has the commands {', '.join(log.command_names)}, "
                f"the vehicle {', '.join(spec.command_names)}",
                where=path.name,
                next_step="Tell a log of this vehicle.",
            )
        return checked_flight(log, spec)
    table = read_table(path)
    t, repairs = read_time(table, USUAL_RATE, path.name)
    columns = flight_columns(table, spec, path.name)
    if degrees:
        columns.vectors["rates"] = np.deg2rad(columns.vectors["rates"])  # type: ignore[arg-type]
        repairs = [*repairs, "Rates were converted from degrees, as asked."]
    t, columns, more = _readable(t, columns, path.name)
    log = _assemble(t, columns, spec, path.name, (*table.repairs, *repairs, *more))
    return checked_flight(log, spec, stated=columns.stated)


def checked_flight(log: FlightLog, spec: FlightSpec, stated: frozenset[str] = frozenset()) -> FlightLog:
    """The flight, its units believed or corrected.

    Args:
        log: with columns in place.
        spec: the vehicle.
        stated: channels whose unit the file states, which are then believed.

    Raises:
        DataError: NaN, too short, no gravity, rates in degrees, commands out of range, or saturated.
    """
    values = np.column_stack([log.t, log.states.specific_force, log.states.rates, log.command])
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise DataError("a sensor or command is not a number", where=f"{log.source}, row {row}")
    if len(log) < LEAST_ROWS:
        raise DataError(
            f"only {len(log)} usable rows; a flight needs at least {LEAST_ROWS}. {ending(log)}".rstrip(" ."),
            where=log.source,
            next_step="Was the recording cut? Export it again.",
        )
    log = _check_gravity(log, "specific_force" in stated)
    _check_rates(log, "rates" in stated)
    _check_command(log, spec)
    return log


def ending(log: FlightLog) -> str:
    """The sentence that says why and where the flight broke off, or nothing."""
    return " ".join(sentence for sentence in log.repairs if "was cut" in sentence)


def _readable(t: Array, columns: FlightColumns, where: str) -> tuple[Array, FlightColumns, list[str]]:
    """Rows whose needed cells are numbers and whose time increases; other channels with gaps are dropped."""
    repairs = []
    needed = [t[:, None], columns.vectors["specific_force"], columns.vectors["rates"], columns.command]
    good = np.asarray(np.isfinite(np.column_stack(needed)).all(axis=1))  # type: ignore[arg-type]
    good[good] = np.diff(t[good], prepend=-np.inf) > 0
    if good.mean() < 1.0 - LARGEST_LOSS:
        raise DataError(
            f"{(~good).sum()} of {len(t)} rows have empty or NaN cells, or a time that does not advance",
            where=where,
            next_step="Export the log again, with all sensors at the same times.",
        )
    if not good.all():
        repairs.append(f"{(~good).sum()} rows with empty cells or a repeated time were dropped.")
    vectors = {}
    for name, values in columns.vectors.items():
        kept = None if values is None else values[good]
        if kept is not None and not np.isfinite(kept).all():
            repairs.append(f"Channel {name} has empty cells and was dropped.")
            kept = None
        vectors[name] = kept
    R = None if columns.R_world_body is None else columns.R_world_body[good]
    if R is not None and not np.isfinite(R).all():
        repairs.append("The attitude has empty cells and was dropped.")
        R = None
    return t[good], replace(columns, vectors=vectors, R_world_body=R, command=columns.command[good]), repairs


def _assemble(
    t: Array, columns: FlightColumns, spec: FlightSpec, where: str, repairs: tuple[str, ...]
) -> FlightLog:
    """On a uniform grid, with the derivative of the rates and what the attitude adds."""
    rate = median_rate(t)
    longest = max(segments(t), key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start < len(t):
        repairs = (
            *repairs,
            f"The flight pauses; the longest stretch, {longest.stop - longest.start} rows, is kept.",
        )
    t = t[longest]
    grid = uniform_grid(t, rate)

    def on_grid(values: Array) -> Array:
        flat = values[longest].reshape(len(t), -1)
        return np.column_stack([np.interp(grid, t, column) for column in flat.T])

    v = {name: None if values is None else on_grid(values) for name, values in columns.vectors.items()}
    force, rates = v["specific_force"], v["rates"]
    assert force is not None
    assert rates is not None
    R = None if columns.R_world_body is None else on_grid(columns.R_world_body).reshape(-1, 3, 3)
    world = v["velocity_world"]
    if world is None and v["position"] is not None:
        world = smooth(grid, v["position"], CUTOFF_SHARE * rate).first
    states = FlightStates(
        altitude=None if v["position"] is None else v["position"][:, 2],
        specific_force=force,
        rates=rates,
        angular_acceleration=smooth(grid, rates, CUTOFF_SHARE * rate).first,
        velocity=None if R is None or world is None else np.einsum("tji,tj->ti", R, world),
        # gravity seen from the body is the last row of R_world_body
        acceleration=None if R is None else force - GRAVITY * R[:, 2, :],
    )
    start = grid[0] if grid[0] > 0.0 else 0.0
    return FlightLog(
        grid - start,
        states,
        on_grid(columns.command),
        spec.command_names,
        spec.command_unit,
        v["position"],
        v["position_des"],
        where,
        repairs,
    )


def _check_gravity(log: FlightLog, stated: bool) -> FlightLog:
    """In flight the thrust carries the weight: the accelerometer's mean length is about g."""
    size = float(np.median(np.linalg.norm(log.states.specific_force, axis=1)))
    if 0.5 * GRAVITY < size < 2.0 * GRAVITY:
        return log
    if not stated and 0.5 < size < 2.0:
        states = replace(log.states, specific_force=GRAVITY * log.states.specific_force)
        if states.acceleration is not None:  # it was made with a force in another unit
            tilt = log.states.specific_force - states.acceleration
            states = replace(states, acceleration=states.specific_force - tilt)
        return replace(log, states=states, repairs=(*log.repairs, "Accelerations were converted from g."))
    raise DataError(
        f"the accelerometer's length is {size:.3g} m/s^2, not about {GRAVITY}",
        where=f"{log.source}, specific_force",
        next_step="State the unit in the header, acc_x [g] for example; cut take-off and landing away.",
    )


def _check_rates(log: FlightLog, stated: bool) -> None:
    fast = float(np.sqrt(np.mean(log.states.rates**2)))
    if fast > 10.0 and not stated:
        raise DataError(
            f"rates of {fast:.3g} rad/s on average look like degrees per second",
            where=f"{log.source}, rates",
            next_step="State the unit in the header, gyro_x [deg/s], or tell with --degrees.",
        )


def _check_command(log: FlightLog, spec: FlightSpec) -> None:
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    room = 0.05 * (high - low)
    outside = (log.command < low - room) | (log.command > high + room)
    for j, name in enumerate(spec.command_names):
        if outside[:, j].mean() > 0.01:
            raise DataError(
                f"command '{name}' reaches {log.command[:, j].max():.4g}, not {low[j]:g} to {high[j]:g}",
                where=f"{log.source}, command {name}",
                next_step="State the unit in the header, or correct the limits in robot.toml.",
            )
        if (log.command[:, j] >= low[j] + SATURATED * (high[j] - low[j])).all():
            raise DataError(
                f"command '{name}' is at its limit throughout: it says nothing of the motion",
                where=f"{log.source}, command {name}",
                next_step="Fly with less payload, a fuller battery, or gentler limits.",
            )
