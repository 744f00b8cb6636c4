"""Ground and rest in a flight, by windows of 0.2 s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Finding, Log, Mask

CHECK = "ground"
WINDOW_S = 0.2
TURNING = 0.05  # rad/s: deviation of the gyroscope in a window, above which something moves
SHAKING = 0.35  # m/s^2: the same of the specific force
WEIGHT, OFF = 9.81, 0.6  # m/s^2: what is felt at rest, and by how much it may be off
COMMANDED = 0.2  # of a motor's range: commands that count for the median
IDLE = 0.5  # of that median: motors that carry nothing
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
    if gyro is not None:
        rest &= deviation(gyro) < TURNING
    if force is not None:
        felt = np.linalg.norm(mean(force), axis=1)
        rest &= (deviation(force) < SHAKING) & (np.abs(felt - WEIGHT) < OFF)
    level = throttle.mean(axis=1)
    used = level[level > COMMANDED]
    hover = float(np.median(used)) if len(used) else 0.0
    low = mean(level[:, None])[:, 0] < IDLE * hover
    edges = t[0] + WINDOW_S * np.arange(count + 1)
    edges[-1] = max(float(t[-1]), float(edges[-2]))
    return Windows(edges[:-1], edges[1:], rest, rest & low)


def spans_of(found: Windows, marked: Mask) -> tuple[tuple[float, float], ...]:
    """Stretches (s) of neighbouring windows that are marked."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return tuple((float(found.start[a]), float(found.end[b - 1])) for a, b in pairs)


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
        f"At either end that is cut, with {SPARE_S:g} s beside it, unless told with --accept {CHECK}.",
        spans=spans,
    )


def without_ends(log: Log, finding: Finding) -> Log:
    """The log less the ground at its ends and SPARE_S beside it; ground between flights stays, and is said.

    A log that is ground throughout stays as it is.
    """
    start, end = float(log.t[0]), float(log.t[-1])
    first, last = finding.spans[0], finding.spans[-1]
    low = first[1] + SPARE_S if first[0] <= start else start
    high = last[0] - SPARE_S if last[1] >= end - 1e-9 else end
    kept = (log.t >= low) & (log.t <= high)
    if not kept.any() or kept.all():
        return log.repaired(finding.sentence)
    cut = end - start - (float(log.t[kept][-1]) - float(log.t[kept][0]))
    return log.take(kept).repaired(f"{finding.sentence} {cut:.3g} s at the ends were cut.")
