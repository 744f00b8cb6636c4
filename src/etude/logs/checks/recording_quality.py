"""Recording quality of a log: its clock, its columns, and the excitation of its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.filtered_motion import LEAST_ROWS, Seen
from etude.logs.checks.finding_texts import named
from etude.logs.cleaning.filters import longest_stretch
from etude.logs.cleaning.smoothing import GAP_FACTOR, median_rate, resample, uniform_grid
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Finding, Index, Log, Mask

COARSE = 1e-3  # of a part's range: a step of the sensor that a filter cannot make up for
DISTINCT = 0.5  # of the rows hold values of their own: finer than the file can tell
SATURATED = 0.01  # of the rows at an extreme
AT_EDGE = 1e-3  # of the range
NOT_FILLED = "Remove the column from the log if it was never recorded."
EMPTY = 0.2  # of the rows: a log that lacks more of what is needed is refused
LEAPS = 30.0  # times the step that 99 % of the rows stay below


def column_findings(log: Log, limits: Limits) -> tuple[Finding, ...]:
    """Findings of each separate column; rows are ordered, cells may be empty. A raw column may be unneeded by
    the robot, so that an empty one is no reason to refuse the log.
    """
    return (_dead(log), _empty(log), _coarse(log), _saturated(log, limits), _leaping(log))


def checked_channels(log: Log) -> list[Channel]:
    """The channels that are measured or commanded."""
    return [c for n, c in log.channels.items() if c.role in ("state", "command", "aside") and n in log]


def label(channel: Channel, j: int) -> str:
    """ "q of elbow"; a raw column is its own name."""
    return f"{channel.name} of {channel.parts[j]}" if channel.parts[j] else channel.name


def _listed(names: Sequence[str], most: int = 8) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _dead(log: Log) -> Finding:
    dead, worse, still = [], [], False
    for channel in checked_channels(log):
        values = log[channel.name]
        for j in np.flatnonzero((_range(values) == 0.0) & np.isfinite(values).any(axis=0)).tolist():
            dead.append(label(channel, j))
            still |= channel.role == "state"
            moves = channel.acts_on in log and _range(log[channel.acts_on])[j] > 0.0
            worse += [label(channel, j)] if channel.role == "command" and moves else []
    if worse:
        fact = f"{_listed(worse)} never changes although its joint moves."
        return Finding("dead", "red", fact, "Log this command, or remove the joint from the robot file.")
    if dead:
        fact = f"Never changing: {_listed(dead)}."
        step = "A joint at rest shows only its gravity and friction." if still else NOT_FILLED
        return Finding("dead", "yellow", fact, step)
    return Finding("dead", "green", "Every column changes.")


def _range(values: Array) -> Array:
    """(k,) of the finite cells; 0 of a column without."""
    finite = np.where(np.isfinite(values), values, np.nan)
    with np.errstate(all="ignore"):
        top, low = np.fmax.reduce(finite, axis=0), np.fmin.reduce(finite, axis=0)
    return np.asarray(np.nan_to_num(top - low))


def _empty(log: Log) -> Finding:
    shares, needed = {}, 0.0
    for channel in checked_channels(log):
        for j, share in enumerate((1.0 - np.isfinite(log[channel.name]).mean(axis=0)).tolist()):
            if share > 0.0:
                shares[label(channel, j)] = share
                needed = max(needed, share if channel.parts[j] else 0.0)
    if not shares:
        return Finding("empty", "green", "Every cell is a number.")
    worst = max(shares, key=lambda name: shares[name])
    some = "1 column has" if len(shares) == 1 else f"{len(shares)} columns have"
    return Finding(
        "empty",
        "red" if needed > EMPTY else "yellow",
        f"{some} empty or infinite cells, most {worst}: {100 * shares[worst]:.3g} %.",
        "Such rows are dropped if the column is needed; export all channels at the same times.",
    )


def _coarse(log: Log) -> Finding:
    steps = {}
    for channel in [c for c in checked_channels(log) if c.role == "state" or not c.parts[0]]:
        for j in range(len(channel.parts)):
            quantum, size = resolution(log[channel.name][:, j])
            if quantum > 0.0:
                steps[label(channel, j)] = quantum / size
    if not steps:
        return Finding("quantisation", "green", "No column shows the resolution of its sensor.")
    worst = max(steps, key=lambda name: steps[name])
    fact = f"The coarsest column is {worst}: its range is {1.0 / steps[worst]:.3g} steps of the sensor."
    if steps[worst] < COARSE:
        return Finding("quantisation", "green", fact)
    step = "Write more digits. If the encoder itself is this coarse, move further and faster."
    return Finding("quantisation", "yellow", fact, step)


def resolution(values: Array) -> tuple[float, float]:
    """The quantisation step of the values (T,), and their range; a step of 0 if there is none."""
    finite = values[np.isfinite(values)]
    distinct = np.unique(finite)
    if len(distinct) < 2 or len(distinct) > DISTINCT * len(finite):
        return 0.0, 1.0
    size = float(distinct[-1] - distinct[0])
    steps = np.diff(distinct)
    return float(np.median(steps[steps > 1e-9 * size])), size


def _saturated(log: Log, limits: Limits) -> Finding:
    marked, shares = np.zeros(len(log), dtype=np.bool_), {}
    for channel in [c for c in checked_channels(log) if c.role == "command"]:
        at = _at_edge(log[channel.name], channel, limits)
        for j in np.flatnonzero(at.mean(axis=0) > SATURATED).tolist():
            shares[label(channel, j)] = float(at[:, j].mean())
            marked |= at[:, j]
    if not shares:
        return Finding("saturation", "green", "No command stays at an extreme.")
    names = ", ".join(f"{name} for {100 * share:.3g} %" for name, share in shares.items())
    return Finding(
        "saturation",
        "yellow",
        f"Commands stay at an extreme: {names} of the time.",
        "There the command contains little information on the motion: run it slower.",
        spans=spans_of(log.t, np.flatnonzero(marked)),
    )


def _at_edge(values: Array, channel: Channel, limits: Limits) -> Mask:
    """(T, k) at the stated limits, or at an extreme of the log that is held for two rows or more."""
    low, high = np.nanmin(values, axis=0, initial=np.inf), np.nanmax(values, axis=0, initial=-np.inf)
    near = AT_EDGE * (high - low)
    edge = ((values >= high - near) | (values <= low + near)) & (high > low)
    held = edge & (np.roll(edge, 1, axis=0) | np.roll(edge, -1, axis=0))
    held &= np.isclose(values, np.roll(values, 1, axis=0)) | np.isclose(values, np.roll(values, -1, axis=0))
    if channel.name in limits:
        lower, upper = limits[channel.name]
        held |= (values >= upper) | (values <= lower)
    return np.asarray(held)


def _leaping(log: Log) -> Finding:
    rows: list[int] = []
    names = []
    between = np.diff(log.t)
    pause = between > GAP_FACTOR * np.median(between) if len(between) else between > 0.0
    for channel in [c for c in checked_channels(log) if c.role == "state" and not c.derivative_of]:
        step = np.nan_to_num(np.abs(np.diff(log[channel.name], axis=0)))
        usual = np.quantile(step, 0.99, axis=0) if len(step) else np.zeros(len(channel.parts))
        step[pause] = 0.0
        leaps = (step > LEAPS * usual) & (step > 1e-2 * _range(log[channel.name])) & (usual > 0.0)
        names += [label(channel, j) for j in np.flatnonzero(leaps.any(axis=0)).tolist()]
        rows += np.flatnonzero(leaps.any(axis=1)).tolist()
    if not rows:
        return Finding("jumps", "green", "No position leaps.")
    return Finding(
        "jumps",
        "yellow",
        f"{_listed(names)} jumps {len(rows)} time{'s'[: len(rows) > 1]}, first at {log.t[rows[0]]:.3g} s.",
        "Single outlier rows are dropped; cut the file where another recording begins.",
        spans=spans_of(log.t, np.array(sorted(set(rows)))),
    )


JITTER = 0.5  # of a step, in 95 % of the rows: beyond, linear interpolation starts to bend the motion
REPEATED = 0.01  # of the rows
SLOWEST, FASTEST = 2.0, 5e4  # rows a second that a robot's recorder writes
SPANS = 50  # that are marked


def clock_findings(log: Log) -> tuple[Finding, ...]:
    """Findings of the recorded times, row by row; times may be unordered or missing."""
    finite = np.isfinite(log.t)
    if finite.sum() < 2 or not (np.diff(log.t[finite]) > 0).any():
        return (
            Finding("rate", "red", "The log has no two rows at different times.", "Export the log again."),
        )
    log = log.take(finite)
    steps = np.diff(log.t)
    forward = steps[steps > 0]
    step = float(np.median(forward))
    return (_rate(forward, step), _order(log.t, steps), _gaps(log.t, steps, step), _repeats(steps))


def _rate(forward: Array, step: float) -> Finding:
    spread = float(np.quantile(np.abs(forward / step - 1.0), 0.95))
    fact = f"{1.0 / step:.4g} rows a second; 95 % of the steps within {100.0 * spread:.3g} % of {step:.4g} s."
    if not SLOWEST < 1.0 / step < FASTEST:
        return Finding(
            "rate", "yellow", fact, "This rate is implausible: perhaps the times are in another unit."
        )
    if spread < JITTER:
        return Finding("rate", "green", fact)
    return Finding(
        "rate",
        "yellow",
        fact,
        "Log at a fixed rate, or use the time stamps of the sensor instead of the host's.",
    )


def _order(t: Array, steps: Array) -> Finding:
    back = np.flatnonzero(steps < 0)
    if not len(back):
        return Finding("order", "green", "Time never runs backwards.")
    spans = tuple((float(t[k + 1]), float(t[k])) for k in back[:SPANS])
    return Finding(
        "order",
        "yellow" if len(back) < 0.01 * len(t) else "red",
        f"Time runs backwards at {len(back)} row{'s'[: len(back) > 1]}, first at row {back[0] + 1}, "
        f"by {-steps[back[0]]:.3g} s.",
        "Rows out of order are dropped; cut the file where a second recording begins.",
        spans=spans,
    )


def _gaps(t: Array, steps: Array, step: float) -> Finding:
    gaps = np.flatnonzero(steps > GAP_FACTOR * step)
    if not len(gaps):
        return Finding("gaps", "green", f"No pause is longer than {GAP_FACTOR:g} steps.")
    lost = float(steps[gaps].sum())
    share = lost / max(float(t.max() - t.min()), step)
    return Finding(
        "gaps",
        "red" if share > 0.5 else "yellow",
        f"{len(gaps)} pause{'s'[: len(gaps) > 1]} without samples, together {lost:.3g} s, the longest "
        f"{steps[gaps].max():.3g} s.",
        "Pauses split the log; a lower rate or another recorder loses fewer rows.",
        spans=tuple((float(t[k]), float(t[k + 1])) for k in gaps[:SPANS]),
    )


def _repeats(steps: Array) -> Finding:
    """Rows at the time of the row before; rows that hold their values are `exact`'s."""
    share = float((steps == 0).mean())
    fact = f"{100 * share:.3g} % of the rows repeat the time before."
    if share < REPEATED:
        return Finding("repeats", "green", fact)
    return Finding(
        "repeats", "yellow", fact, "Rows with a repeated time are dropped; log at the sensor's rate."
    )


def spans_of(t: Array, rows: Index) -> tuple[tuple[float, float], ...]:
    """Stretches of time (s) that neighbouring rows make."""
    if not len(rows):
        return ()
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    last = len(t) - 1
    return tuple((float(t[p[0]]), float(t[min(int(p[-1]) + 1, last)])) for p in pieces[:SPANS])


NOISY = 0.3  # deviation of the acceleration's noise over that of the acceleration
THIRD = 20.0  # variance of the third difference of white noise
STANDING, SMALL = 0.8, 0.2  # of the time; of the limits


def motion_findings(log: Log, path: Channel, motion: Seen, limits: Limits) -> tuple[Finding, ...]:
    """Findings of the coordinates `path` of a log with ordered rows and finite numbers."""
    findings = [_noise(log, path, motion)]
    if motion.moves.any():
        findings.append(_standstill(motion))
    if path.name in limits:
        findings.append(_coverage(log, path, motion, limits))
    return tuple(findings)


def _noise(log: Log, path: Channel, motion: Seen) -> Finding:
    part = longest_stretch(log)
    rate = median_rate(part.t)
    grid = uniform_grid(part.t, rate)
    q = resample(part.t, part[path.name], grid)
    if len(grid) < 4 * LEAST_ROWS or not motion.moves.any():
        return Finding("noise", "cannot tell", "There is too little motion to distinguish it from noise.")
    level = np.sqrt(np.mean(np.diff(q, 3, axis=0) ** 2, axis=0) / THIRD)
    raw, filtered = np.sqrt(6.0) * level * rate**2, level * _filter_gain(rate, motion.cutoff)
    size = motion.qdd.std(axis=0)
    share = np.where(motion.moves, filtered / np.where(size > 0.0, size, np.inf), 0.0)
    worst = int(np.argmax(share))
    unit = path.units[worst]
    fact = (
        f"Positions of {path.parts[worst]} are noisy by {level[worst]:.2g} {unit}; differentiated twice "
        f"that is {raw[worst]:.2g} {unit}/s^2, behind the filter of {motion.cutoff:.3g} Hz "
        f"{filtered[worst]:.2g}, where the motion has {size[worst]:.2g}."
    )
    if share[worst] < NOISY:
        return Finding("noise", "green", fact)
    return Finding("noise", "yellow", fact, "Move faster, or log positions with more digits and less noise.")


def _filter_gain(rate: float, cutoff: float) -> float:
    """Deviation of the second derivative behind the filter, per deviation of white noise at that rate."""
    f = np.linspace(0.0, 0.5 * rate, 2001)
    density = (2.0 * np.pi * f) ** 4 / (1.0 + (f / cutoff) ** 4) ** 2
    return float(np.sqrt(density.mean()))


def _standstill(motion: Seen) -> Finding:
    share = 1.0 - motion.moving.mean(axis=0)
    never, long = ~motion.moves, motion.moves & (share > STANDING)
    fact = f"Joints are at rest for {100 * share.min():.0f} to {100 * share.max():.0f} % of the time."
    if never.any():
        fact = f"{named(motion.parts, never)} never move{'s'[: int(never.sum()) == 1]}. {fact}"
    elif not long.any():
        return Finding("rest", "green", fact)
    return Finding("rest", "yellow", fact, "Move every joint of the model, and for more of the time.")


def _coverage(log: Log, path: Channel, motion: Seen, limits: Limits) -> Finding:
    lower, upper = limits[path.name]
    share = np.ptp(log[path.name], axis=0) / (upper - lower)
    fact = f"Positions cover {100 * share.min():.0f} to {100 * share.max():.0f} % of their limits"
    top = limits.get(f"{path.name}d")
    if top is not None:
        fast = np.abs(motion.qd).max(axis=0) / np.abs(top[1])
        fact += f", speeds reach {100 * fast.min():.0f} to {100 * fast.max():.0f} %"
    small = share < SMALL
    if not small.any():
        return Finding("coverage", "green", f"{fact}.")
    fact += f"; the range of {named(motion.parts, small)} is hardly covered."
    return Finding(
        "coverage",
        "yellow",
        fact,
        "A model is accurate only where it has data: etude ask proposes motions for the rest.",
    )
