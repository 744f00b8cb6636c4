"""Ground and rest in a flight, by windows of 0.2 s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.logs.checks.filtered_motion import runs
from etude.types import Array, Finding, Log, Mask

CHECK = "ground"
WINDOW_S = 0.2
TURNING = 0.05  # rad/s: deviation of the gyroscope in a window, above which something moves
SHAKING = 0.35  # m/s^2: the same of the specific force
WEIGHT, OFF = 9.81, 0.6  # m/s^2: what is felt at rest, and by how much it may be off
COMMANDED = 0.2  # of a motor's range: commands that count for the median
IDLE = 0.5  # of that median: motors that carry nothing
TURNS = 0.1  # rad/s: a vehicle whose gyroscope says more in the mean of a window does not stand
CARRIED = 3  # windows in a row: a dive whose drag is the weight for a moment is no landing
LANDED_S = 1.0  # of ground between two flights, below which it stays
SPARE_S = 0.5  # next to the ground: its effect, and contact


@dataclass(frozen=True, eq=False)
class Windows:
    """Of each window: its start and end (w,) s, whether the vehicle rests and whether it is on the ground."""

    start: Array
    end: Array
    rest: Mask
    ground: Mask


def windows(t: Array, gyro: Array | None, force: Array | None, throttle: Array) -> Windows:
    """Rest and ground, window by window.

    On the ground something else than the motors carries the weight: they idle, and yet it is felt. So it is
    told although idling motors shake the sensors more than they do at rest.

    Args:
        t: (T,) s. gyro, force: (T, 3) rad/s and m/s^2 of the body; None if nobody measured them: then the
            command alone tells.
        throttle: (T, m) motors' commands in parts of their range.
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

    rest = np.asarray(np.bincount(number, minlength=count) > 1)  # one row has no deviation
    carried = rest & (gyro is not None and force is not None)
    if gyro is not None:
        rest &= deviation(gyro) < TURNING
        carried &= np.linalg.norm(mean(gyro), axis=1) < TURNS
    if force is not None:
        weight = np.abs(np.linalg.norm(mean(force), axis=1) - WEIGHT) < OFF
        rest &= weight & (deviation(force) < SHAKING)
        carried &= weight
    level = throttle.mean(axis=1)
    used = level[level > COMMANDED]
    hover = float(np.median(used)) if len(used) else 0.0
    low = mean(level[:, None])[:, 0] < IDLE * hover
    edges = t[0] + WINDOW_S * np.arange(count + 1)
    edges[-1] = max(float(t[-1]), float(edges[-2]))
    return Windows(edges[:-1], edges[1:], rest, low & (rest | _lasting(carried & low)))


def _lasting(marked: Mask) -> Mask:
    """What is marked in CARRIED windows in a row, and more."""
    kept = np.zeros_like(marked)
    for a, b in runs(marked):
        kept[a:b] = b - a >= CARRIED
    return kept


def spans_of(found: Windows, marked: Mask) -> tuple[tuple[float, float], ...]:
    """Stretches (s) of neighbouring windows that are marked."""
    return tuple((float(found.start[a]), float(found.end[b - 1])) for a, b in runs(marked))


def ground_finding(found: Windows) -> Finding:
    """Time on the ground, its spans to cut or to mark."""
    spans = spans_of(found, found.ground)
    if not spans:
        return Finding(CHECK, "green", "The vehicle flies throughout.")
    seconds = sum(end - start for start, end in spans)
    return Finding(
        CHECK,
        "yellow",
        f"The vehicle stands on the ground for {seconds:.3g} s.",
        f"At either end, and between flights, that is cut, with {SPARE_S:g} s beside it, unless told with "
        f"--accept {CHECK}.",
        spans=spans,
    )


def without_ground(log: Log, finding: Finding) -> Log:
    """The log less the ground at its ends and between flights, and SPARE_S beside it.

    A log that is ground throughout stays as it is, and so do moments on the ground inside of a flight.
    """
    start, end = float(log.t[0]), float(log.t[-1])
    kept = np.ones(len(log), dtype=np.bool_)
    between = False
    for low, high in finding.spans:
        inside = low > start and high < end - 1e-9
        if not inside or high - low >= LANDED_S:
            kept &= (log.t <= low - SPARE_S) | (log.t >= high + SPARE_S)
            between |= inside
    if not kept.any() or kept.all():
        return log.repaired(finding.sentence)
    where = "there and beside it" if between else "at the ends"
    cut = float((~kept).sum() * np.median(np.diff(log.t)))
    return log.take(kept).repaired(f"{finding.sentence} {cut:.3g} s {where} were cut.")
