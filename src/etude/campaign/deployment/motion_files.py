"""User motions from files: trajectory.json, or a table of times and the robot's path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.deploy.trajectory_files import csv_bytes, table_rate
from etude.errors import UsageError
from etude.logs.cleaning.read import matched_log
from etude.logs.cleaning.repairs import drop_unreadable, order_rows
from etude.logs.columns.headers import read_headers
from etude.logs.columns.mapping import mapped
from etude.logs.columns.vocabulary import is_time, normal, split_suffix, split_unit, unit_of
from etude.logs.readers.registry import read_raw
from etude.trajectories.json_text import from_json
from etude.trajectories.splined import Splined
from etude.types import Array, Channel, Log

TABLES = (".csv", ".parquet")
ORDERS, DEGREE = 4, 7
"""Position to jerk at the ends of septics."""
KNOT_S = 0.25
"""s, smallest distance of knots: with closer ones, rounding of the rows would cause jerk."""
MISSED, REST = 0.01, 0.02
"""Fraction of the path's extent by which a curve may miss a row; fraction of the top speed that is rest."""
TURNED = 1e-3
"""rad, heading that counts as zero."""


def is_plan(campaign: Campaign, place: Path) -> bool:
    """Whether a table belongs to the trajectory.json beside it. For flights such a table has planned values,
    which are no states: its accelerations are not those of an accelerometer.
    """
    planned = place.with_suffix(".json")
    if place.suffix != ".csv" or not planned.is_file():
        return False
    try:
        motion = from_json(planned.read_bytes())
    except UsageError:
        return False
    inputs = campaign.kind.inputs(campaign.spec, campaign.config)
    return place.read_bytes() == csv_bytes(motion, inputs, table_rate(campaign.spec))


def is_path_alone(campaign: Campaign, place: Path) -> bool:
    """Whether a table has no state that models use; a vehicle's path is no such state."""
    if _path(campaign).role == "state":
        return False
    states = [c for c in campaign.channels if c.role == "state"]
    raw = mapped(read_raw(place), campaign.config.log)
    headers = read_headers([name for name in raw.values if not is_time(name)], states, str(place))
    return not (headers.named or headers.numbered)


def motion_of_table(campaign: Campaign, place: Path) -> Splined:
    """The smooth curve near the rows of a table with a time and the columns of the robot's path.

    It is at rest at an end if the rows are.

    Raises:
        UsageError: too few rows for a curve, rows that no smooth curve fits, or a heading.
        DataError: the table does not have these columns.
    """
    path, raw = _path(campaign), read_raw(place)
    _refuse_heading(raw, place)
    plain = {_base_name(name): name for name in raw.values}
    named = {f"{path.name}_{part}": plain[part] for part in path.parts if part in plain}  # x, y, z alone
    # waypoints may be far apart, so their rate does not determine the unit of time
    clocks = [name for name in raw.values if is_time(name)]
    named |= {"t [s]": clocks[0]} if len(clocks) == 1 and not unit_of(clocks[0]) else {}
    config = campaign.config.log
    config = replace(config, columns={**named, **config.columns})
    rate = campaign.kind.expected(campaign.spec).rate
    log, _ = matched_log(place, [replace(path, required=True)], rate, (), config)
    log = order_rows(drop_unreadable(log, recorded=False))
    if len(log) <= DEGREE:
        raise UsageError(
            f"the table has {len(log)} rows; a smooth motion needs {DEGREE + 1} or more",
            where=str(place),
            next_step="Write more rows along the path.",
        )
    return _curve(log.t - log.t[0], log[path.name], place)


def _path(campaign: Campaign) -> Channel:
    return next(c for c in campaign.channels if c.name == campaign.kind.path)


def _base_name(header: str) -> str:
    """ "yaw" of "Yaw [deg]"."""
    return normal(split_suffix(split_unit(header)[0])[0])


def _refuse_heading(raw: Log, place: Path) -> None:
    """Raise UsageError for a column of yaw that is not 0: planned flights keep yaw at zero."""
    for name, values in raw.values.items():
        if _base_name(name) in ("yaw", "heading") and np.abs(values).max(initial=0.0) > TURNED:
            raise UsageError(
                f"{name} is up to {np.abs(values).max():.3g}, but planned flights have the heading 0",
                where=str(place),
                next_step="Set it to 0: the vehicle then points along x. For another constant heading, "
                "rotate x and y.",
            )


def _curve(t: Array, rows: Array, place: Path) -> Splined:
    """Septics between knots, fitted to rows (T, k); through every row where these are far apart."""
    from scipy.interpolate import make_interp_spline, make_lsq_spline

    count = max(1, int(t[-1] / max(KNOT_S, 2.0 * float(np.diff(t).max()))))
    times = np.linspace(0.0, t[-1], count + 1)
    if count + DEGREE < len(t) // 2:
        knots = np.concatenate([np.zeros(DEGREE), times, np.full(DEGREE, t[-1])])
        curve = make_lsq_spline(t, rows, knots, k=DEGREE)
    else:
        curve, times = make_interp_spline(t, rows, k=DEGREE), t
    points = np.stack([curve(times, nu=order) for order in range(ORDERS)])
    speed = np.linalg.norm(points[1], axis=1)
    for end in (0, -1):
        if speed[end] <= REST * speed.max():
            points[1:, end] = 0.0
    splined = Splined(times, points)
    away = float(np.abs(splined.motion(t, 1).orders[0] - rows).max())
    if away > MISSED * float(np.ptp(rows, axis=0).max()):
        raise UsageError(
            f"no smooth motion follows these rows: the nearest one deviates by up to {away:.3g}",
            where=str(place),
            next_step="Remove jumps and noise from the path, or add rows at its corners.",
        )
    return splined
