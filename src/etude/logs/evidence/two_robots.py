"""Logs of two robots, as their motion and commands tell without a model file.

Each log in turn has a model of its own beside that of the others. The evidence of both is compared with that
of one model of all. No model is quite right, so the halves of one log gain by models of their own, too: a log
is odd only where it gains far more than these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.exact import LIKELY
from etude.logs.evidence.file_hypotheses import contradicting
from etude.logs.evidence.joint_evidence import MOST_GROUPS
from etude.logs.evidence.likelihood import FEW, SMALL_WAY, WhitenedMotion
from etude.logs.evidence.rows import FilteredRows, rows_of
from etude.types import Array, Channel, Finding, Index, Log, Mask

# log odds over all joints, and the part that say so: right logs had 160 and a half, others 210 and 5 of 6
ODDS, MOST_JOINTS = 150.0, 0.75


def odd_log(logs: Sequence[Log], path: Channel) -> tuple[int, Array] | None:
    """The log that one model explains worst with the others, and by joint (m,) the log odds of a model of its
    own; None where no log is odd, or most joints go a short way in one.

    Args:
        logs: with positions `path` and commands on them, whose signs, order and clocks are right.
    """
    rows = rows_of(logs, path)
    if rows is None or not rows.moving.any():
        return None
    own = np.flatnonzero(rows.moving & _far_in_each(rows))
    if 2 * len(own) < rows.moving.sum():
        return None
    together = WhitenedMotion(rows, own, FEW).free(rows.command)[:, 0]
    numbers = np.unique(rows.log)
    each = {int(i): _apart(rows, own, int(i)) - together for i in numbers[-MOST_GROUPS:] if len(numbers) > 1}
    odd = max(each, key=lambda i: float(each[i].sum()), default=-1)
    if odd < 0 or not _clear(each[odd]):
        return None
    gains = each[odd] - np.max([_of_halves(log, path, own) for log in logs], axis=0)
    return (odd, gains) if _clear(gains) else None


def _far_in_each(rows: FilteredRows) -> Mask:
    """(k,) sliding joints, and turning ones that go far in every log: in a short way all is of the place."""
    ways = [np.ptp(rows.q[rows.log == i], axis=0) for i in np.unique(rows.log)]
    turns = np.array([unit == "rad" for unit in rows.units])
    return np.asarray(~turns | (np.min(ways, axis=0) > SMALL_WAY))


def _apart(rows: FilteredRows, own: Index, log: int) -> Array:
    return WhitenedMotion(rows, own, FEW, odd=rows.log == log).free(rows.command)[:, 0]


def _clear(gains: Array) -> bool:
    return float(gains.sum()) >= ODDS and float((gains >= LIKELY).mean()) >= MOST_JOINTS


def _of_halves(log: Log, path: Channel, own: Index) -> Array:
    """(m,) what halves of a log gain by models of their own, 0 at least."""
    first = log.t <= 0.5 * (log.t[0] + log.t[-1])
    rows = rows_of([log.take(first), log.take(~first)], path)
    if rows is None or len(np.unique(rows.log)) < 2:
        return np.zeros(len(own))
    together = WhitenedMotion(rows, own, FEW).free(rows.command)[:, 0]
    return np.maximum(_apart(rows, own, 0) - together, 0.0)


def contradiction_without_file(logs: Sequence[Log], path: Channel, sources: Sequence[str]) -> Finding | None:
    """The finding that logs are not of one robot; None of none."""
    found = odd_log(logs, path)
    if found is None:
        return None
    odd, gains = found
    joints = f"{int((gains >= LIKELY).sum())} of {len(gains)} joints"
    fact = f"a model of its own explains the commands of {joints} better (odds e^{gains.sum():.0f} to 1)"
    return contradicting(sources, odd, range(len(logs)), fact, "No sign, order or delay explains it")
