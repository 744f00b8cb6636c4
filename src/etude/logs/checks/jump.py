"""A position that jumps: an estimator that was reset, or another origin, told by what no speed explains.

A step is held against the motion beside it, so that neither a fast flight nor a crash is one: a vehicle that
is thrown changes its speed, and goes on; one whose estimate is reset goes on as before, elsewhere.
"""

from __future__ import annotations

import numpy as np

from etude.logs.cleaning.smoothing import GAP_FACTOR
from etude.types import Array, Finding, Log, Mask

CHECK = "jump"
LEAST = 0.2  # m: below, a correction
WILD = 5.0  # times the second difference that 99 % of the rows stay below: noise and acceleration make less
RARE = 0.01  # of the steps may be further than the limits allow: with more, the limits are another vehicle's
FEW = 4  # rows that a jump may touch, however short the log is
BESIDE_S, BESIDE_ROWS = 0.5, 3  # of the motion to either side, at least
SPARE_S = 0.1  # left out to either side, or as much as makes a pause
NAMED = 5


def jump_finding(log: Log, path: str, top: Array) -> Finding:
    """Where positions leap further than their speed limits and the motion beside explain.

    Args:
        log: rows in order. path: the channel of positions, m.
        top: (k,) m/s that each may have.
    """
    if path not in log or len(log) < 2:
        return Finding(CHECK, "cannot tell", f"The log has no {path}.")
    q = log[path]
    # of a slow sensor between whose values others are recorded, the rows that are new
    new = np.flatnonzero(np.any(np.diff(q, axis=0, prepend=np.nan) != 0.0, axis=1))
    t, q = log.t[new], q[new]
    excess = _excess(t, q, top)
    marked = np.asarray((excess != 0.0).any(axis=1))
    if not marked.any() or marked.sum() > max(RARE * len(marked), FEW):
        return Finding(CHECK, "green", "No position jumps.")
    spare = max(SPARE_S, 0.6 * GAP_FACTOR * float(np.median(np.diff(log.t))))
    spans = _spans(t, marked, spare)
    parts = log.channels[path].parts
    said = [_said(t, excess, parts, span) for span in spans[:NAMED]]
    more = f", and {len(spans) - NAMED} times more" if len(spans) > NAMED else ""
    return Finding(
        CHECK,
        "yellow",
        f"The {path} jumps where no speed within the limits explains it: {'; '.join(said)}{more}.",
        "The rows around are left out, and the longest stretch between is learned from, unless told with "
        f"--accept {CHECK}. Was the estimator reset? Altitudes before and after may differ.",
        spans=spans,
    )


def _excess(t: Array, q: Array, top: Array) -> Array:
    """(n - 1, k) m by which each step is further than the motion beside it explains; 0 where it may be."""
    step, dt = np.diff(q, axis=0), np.diff(t)[:, None]
    found = np.zeros(step.shape)
    if len(q) < 2 * BESIDE_ROWS + 2:
        return found
    # in a short log one jump is more than one row in a hundred
    share = min(0.99, 1.0 - FEW / len(q))
    usual = np.quantile(np.abs(np.diff(q, 2, axis=0)), share, axis=0)
    most = np.maximum(top * dt, WILD * usual)
    for k, j in np.argwhere(np.abs(step) > most).tolist():
        rate = _beside(t, step[:, j] / dt[:, 0], np.abs(step[:, j]) > most[:, j], k)
        far = float(step[k, j] - rate * dt[k, 0])
        found[k, j] = far if abs(far) > most[k, j] and _whole(step[:, j], t, k) > LEAST else 0.0
    return found


def _beside(t: Array, rate: Array, wild: Mask, k: int) -> float:
    """Median rate of the steps around step k, without those that are too far themselves; 0 of none."""
    low, high = np.searchsorted(t[:-1], [t[k] - BESIDE_S, t[k] + BESIDE_S])
    rows = slice(max(min(int(low), k - BESIDE_ROWS), 0), max(int(high), k + BESIDE_ROWS) + 1)
    tame = rate[rows][~wild[rows]]
    return float(np.median(tame)) if len(tame) else float(np.median(rate[rows]))


def _whole(step: Array, t: Array, k: int) -> float:
    """m that the steps within `SPARE_S` of step k make: a jump may be drawn out by interpolation."""
    low, high = np.searchsorted(t[:-1], [t[k] - SPARE_S, t[k] + SPARE_S])
    return max(abs(float(step[int(low) : int(high)].sum())), abs(float(step[k])))


def _spans(t: Array, marked: Mask, spare: float) -> tuple[tuple[float, float], ...]:
    """(s) around the steps that are marked, joined where they meet."""
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(marked).tolist():
        start, end = float(t[k]) - spare, float(t[k + 1]) + spare
        if found and start <= found[-1][1]:
            start = found.pop()[0]
        found.append((start, end))
    return tuple(found)


def _said(t: Array, excess: Array, parts: tuple[str, ...], span: tuple[float, float]) -> str:
    """As "by 1.7 m in x at 12.30 s"."""
    rows = np.flatnonzero((t[:-1] > span[0]) & (t[1:] < span[1]) & (excess != 0.0).any(axis=1))
    moved = np.cumsum(excess[rows], axis=0)  # of a spike the sum is none
    row, j = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
    return f"by {moved[row, j]:.2g} m in {parts[int(j)]} at {t[rows[0]]:.2f} s"
