"""Range checks: positions, rates and commands against a robot's limits; notes, refusals, other units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.errors import DataError
from etude.logs.columns.units import Limits, Stated
from etude.types import Array, Channel, Log, Mask, Role

SI = {"rad": "radians", "m": "metres"}
LEAST_TRAVEL = 0.02  # part of a range: a smaller motion in another unit is rather one outside its range
FAR = 2.0  # ranges outside the limits: a sign of another unit
OVERSHOOT = 0.1  # part of a range: a controller may overshoot, and a description may be narrow
COMMAND_EXCESS = 1.5  # times the limit: measured effort may exceed its rating; another unit exceeds it more
RARE = 0.01  # largest part of wild rows
AT_LIMIT = 0.99  # a command this near to its limit throughout is not informative
LIKE = 0.5  # least correlation of a rate with its position's slope, for a ratio to be meaningful


def _smaller(units: Sequence[str]) -> dict[str, float]:
    """Units of positions that logs may have in place of these, and their factors."""
    angles = {"degrees": np.pi / 180.0} if "rad" in units else {}
    thousandths = [name for unit, name in (("rad", "milliradians"), ("m", "mm")) if unit in units]
    return {**angles, " or ".join(thousandths): 1e-3} if thousandths else angles


def bounded(log: Log, limits: Limits, roles: Sequence[Role] = ("state",)) -> list[Channel]:
    """The channels of positions with known limits: by default the inputs of models."""
    return [c for n, c in log.channels.items() if n in limits and c.role in roles and not c.derivative_of]


def check_positions(log: Log, limits: Limits) -> Log:
    """Notes positions a little outside the limits; refuses degrees, and positions far outside.

    Channels that are no model input (a vehicle's position) are only noted, however far outside.
    """
    for channel in bounded(log, limits, ("state", "aside")):
        log = _checked_positions(log, channel, *limits[channel.name])
    return log


def _checked_positions(log: Log, channel: Channel, lower: Array, upper: Array) -> Log:
    q, units = log[channel.name], channel.units
    unit = _suspicion(q, lower, upper, units)
    if unit:
        raise DataError(
            f"the positions look like {unit}, not {'radians' if 'rad' in units else units[0]}: they reach "
            f"{np.abs(q).max():.4g} where the limits are within "
            f"{max(np.abs(lower).max(), np.abs(upper).max()):.4g} {units[0]}",
            where=log.source,
            next_step="Convert them, state the unit in the header (q_joint [deg]), or request the "
            "conversion.",
        )
    over = np.maximum(q.max(axis=0) - upper, lower - q.min(axis=0))
    if channel.role == "state" and not _fits(q, lower, upper):
        j = int(np.argmax(over / (upper - lower)))
        raise DataError(
            f"the position reaches {_furthest(q[:, j], lower[j], upper[j]):.4g} {units[j]}, outside the "
            f"limits {lower[j]:.4g} to {upper[j]:.4g} {units[j]}",
            where=f"{log.source}, {channel.parts[j]}",
            next_step="If the log's robot, unit and gear are right, correct the robot's limits.",
        )
    for k in np.flatnonzero(over > 0):
        log = log.repaired(
            f"{channel.parts[k]} went {over[k]:.2g} {units[k]} outside its position limits; kept."
        )
    return log


def _furthest(q: Array, lower: float, upper: float) -> float:
    """The value furthest outside the limits, or nearest to them if none is outside."""
    return float(q[np.argmax(np.maximum(q - upper, lower - q))])


def _suspicion(values: Array, lower: Array, upper: Array, units: Sequence[str]) -> str:
    """The unit ("degrees", ...) that positions (T, k) outside the limits seem to have, else ''."""
    excess = np.maximum(values.max(axis=0) - upper, lower - values.min(axis=0))
    if not ((excess > FAR * (upper - lower)).any() and np.abs(values).max() > np.pi):
        return ""
    travel = np.ptp(values, axis=0) / (upper - lower)
    for unit, factor in _smaller(units).items():
        if _fits(values * factor, lower, upper) and (travel * factor > LEAST_TRAVEL).any():
            return unit
    return ""


def _fits(values: Array, lower: Array, upper: Array) -> bool:
    slack = OVERSHOOT * (upper - lower)
    return bool(np.all((values >= lower - slack) & (values <= upper + slack)))


def looks_scaled(log: Log, channels: Sequence[Channel], limits: Limits) -> bool:
    """Whether positions are mostly outside the limits, or move mostly faster than the robot can."""
    shares = [0.0]
    for channel in bounded(log, limits):
        lower, upper = limits[channel.name]
        outside = (log[channel.name] < lower) | (log[channel.name] > upper)
        shares.append(float(outside.mean(axis=0).max()))
        top = top_speed(channel, channels, limits)
        if top is not None:
            steps = np.diff(log.t)
            for j, q in enumerate(log[channel.name].T):
                shares.append(float((np.abs(np.diff(q)) > 2 * top[j] * steps).mean()))
    # a tenth of the rows: more than wild values, fewer than with a wrong unit
    return max(shares) > 0.1


def top_speed(channel: Channel, channels: Sequence[Channel], limits: Limits) -> Array | None:
    """(parts,) the largest rate of a position, from the limits of the channel that is its derivative."""
    rates = [limits[c.name] for c in channels if c.derivative_of == channel.name and c.name in limits]
    return np.maximum(np.abs(rates[0][0]), np.abs(rates[0][1])) if rates else None


def check_consistency(log: Log) -> None:
    """Refuses a signal whose slope is 57 or 1000 times its logged rate (mixed units)."""
    for name, channel in log.channels.items():
        if channel.derivative_of in log and log[channel.derivative_of].shape == log[name].shape:
            _check_slope(log, log[channel.derivative_of], channel)


def _check_slope(log: Log, values: Array, channel: Channel) -> None:
    for j in range(values.shape[1]):
        rate = log[channel.name][:, j]
        if not rate.any():
            continue
        slope = np.gradient(values[:, j], log.t)
        product = float(slope @ rate)
        factor = product / float(rate @ rate)
        # 1e-300: without motion the correlation is 0
        like = abs(product) / float(np.linalg.norm(slope) * np.linalg.norm(rate) + 1e-300)
        position = log.channels[channel.derivative_of].units[j]
        for unit, part in _smaller([position]).items():
            for text, expected in (
                (f"{channel.derivative_of} in {unit}", 1 / part),
                (f"{channel.name} in {unit} per second", part),
            ):
                # tolerance of a quarter: filters attenuate velocities by that much
                if like > LIKE and 0.8 < abs(factor) / expected < 1.25:
                    raise DataError(
                        f"{channel.derivative_of} and {channel.name} disagree by a factor {factor:.3g}: "
                        f"{text}?",
                        where=f"{log.source}, {channel.parts[j]}",
                        next_step=f"Convert it to {SI[position]}, or state the unit in the header.",
                    )


def check_commands(log: Log, limits: Limits, stated: Stated) -> Log:
    """Notes commands beyond their limits; refuses those so far beyond that the unit must be another, and
    motors at their limit throughout. Single wild rows are dropped.

    stated: units that the file states.
    """
    for name in [n for n, c in log.channels.items() if c.role == "command"]:
        lower, upper = _command_limits(log.channels[name], limits)
        log = _without_wild(log, name, lower, upper)
        channel = log.channels[name]
        units = stated.get(name) or ("",) * len(channel.parts)
        for j, said in enumerate(units):
            log = _checked_command(log, channel, j, float(lower[j]), float(upper[j]), said)
    return log


def _command_limits(channel: Channel, limits: Limits) -> tuple[Array, Array]:
    """The expected range, else the channel's reach, else an infinite one."""
    reach = np.array(channel.reach or (np.inf,) * len(channel.parts))
    return limits.get(channel.name, (-reach, reach))


def _beyond(values: Array, lower: Array, upper: Array) -> Array:
    """Distance from the middle of the range, in half ranges; 0 for an infinite range."""
    with np.errstate(invalid="ignore"):
        share = np.abs(values - 0.5 * (lower + upper)) / (0.5 * (upper - lower))
    return np.asarray(np.where(np.isfinite(upper - lower), share, 0.0))


def _without_wild(log: Log, name: str, lower: Array, upper: Array) -> Log:
    wild: Mask = np.zeros(len(log), dtype=bool)
    for j, command in enumerate(log[name].T):
        wild |= _beyond(command, lower[j], upper[j]) > COMMAND_EXCESS
    if not wild.any() or wild.mean() > RARE:
        return log
    return without_rows(log, wild, "with a single outlier command")


def _checked_command(log: Log, channel: Channel, j: int, lower: float, upper: float, stated: str) -> Log:
    values, unit = log[channel.name][:, j], channel.units[j]
    share = _beyond(values, np.array(lower), np.array(upper))
    largest, excess = float(values[np.argmax(share)]), float(share.max())
    unit, behind = ("parts of full scale", "") if unit == "1" else (unit, f" {unit}")
    limit = f"{upper:.4g}{behind}" if lower == -upper else f"{lower:.4g} to {upper:.4g}{behind}"
    where = f"{log.source}, {channel.name} {channel.parts[j]}"
    if excess > COMMAND_EXCESS:
        raise DataError(
            f"the command of {channel.parts[j]} reaches {largest:.4g}, its limit is {limit}",
            where=where,
            next_step=_unit_advice(f"{channel.name}_{channel.parts[j]}", unit, excess, stated),
        )
    if not channel.acts_on and np.isfinite(upper) and (values >= lower + AT_LIMIT * (upper - lower)).all():
        raise DataError(
            f"the command of {channel.parts[j]} is always at its limit, so it contains no information on "
            "the motion",
            where=where,
            next_step="Run it with less payload, a fuller battery, or gentler limits.",
        )
    if excess > 1.0:
        reached = f"The command of {channel.parts[j]} reached {largest:.4g}{behind}"
        log = log.repaired(f"{reached}, outside its limit {limit}; kept.")
    return log


def _unit_advice(column: str, unit: str, excess: float, stated: str) -> str:
    """Next step after a command of that unit far beyond its limit. stated: the unit in its header, or ""."""
    if stated:
        return (
            f"The header says {stated}: correct it or the limit in the robot file, or state a factor to "
            f'{unit} in [log.columns] of campaign.toml, as in "{column}" = "0.15 * HEADER".'
        )
    # inside the limit in thousandths, and above any overload
    if excess * 1e-3 <= 1.0 and excess > 30.0:
        return f"It looks like a thousandth of the unit: convert it to {unit}."
    return f"If it is in {unit}, state the unit in the header; else correct the limit in the robot file."


def without_rows(log: Log, dropped: Mask, which: str) -> Log:
    """The log without the rows of the mask (n,), and a sentence that says which they were."""
    count = int(dropped.sum())
    return log.take(~dropped).repaired(f"Dropped {count} {'row' if count == 1 else 'rows'} {which}.")
