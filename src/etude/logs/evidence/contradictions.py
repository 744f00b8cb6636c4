"""Logs that no one model explains: of two robots, or with a change at a time within one log.

One model of all rows is compared with two, each of some of the rows: of one log among several, or of what
comes after a time. No model is quite right, so a model of its own gains something anywhere. A log is odd only
where it gains far more than its halves, and a change has to gain more than right logs did.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Literal

import numpy as np

from etude.abilities import SupportsVariations
from etude.logs.checks.exact import LIKELY
from etude.logs.checks.filtered_motion import goes_far
from etude.logs.checks.finding_texts import Doubt, accepted, named
from etude.logs.evidence.changed_parameters import ChangeEvidence
from etude.logs.evidence.joint_evidence import LEAST_ROWS, MOST_GROUPS
from etude.logs.evidence.likelihood import FEW, SMALL_TRAVEL, Point, WhitenedMotion, covariances, log_sum
from etude.logs.evidence.rows import AS_LOGGED, TURN_SPEED, FilteredRows, rows_of
from etude.protocols import Mean
from etude.types import Array, Channel, Finding, Index, Log, Mask

# log odds over all joints, and the part that say so: right logs had 160 and a half, others 210 and 5 of 6
ODDS, MOST_JOINTS = 150.0, 0.75


def odd_log(logs: Sequence[Log], path: Channel) -> tuple[int, Array] | None:
    """The log that one model explains worst with the others, and by joint (m,) the log odds of a model of its
    own. None where no log is odd, or most joints move little in one of them.

    Args:
        logs: with positions `path` and commands on them, whose signs, order and clocks are right.
    """
    rows = rows_of(logs, path)
    if rows is None or not rows.moving.any():
        return None
    joints = np.flatnonzero(rows.moving & _moves_far_in_each(rows))
    if 2 * len(joints) < rows.moving.sum():
        return None
    together = WhitenedMotion(rows, joints, FEW).free(rows.command)[:, 0]
    numbers = np.unique(rows.log)
    newest = numbers[-MOST_GROUPS:].tolist() if len(numbers) > 1 else []
    each = {i: _odd_evidence(rows, joints, i) - together for i in newest}
    odd = max(each, key=lambda i: float(each[i].sum()), default=-1)
    if odd < 0 or not _is_clear(each[odd]):
        return None
    gains = each[odd] - np.max([_half_gains(log, path, joints) for log in logs], axis=0)
    return (odd, gains) if _is_clear(gains) else None


def _moves_far_in_each(rows: FilteredRows) -> Mask:
    """(k,) sliding joints, and turning ones that move far in every log: near one pose any term fits."""
    travels = [np.ptp(rows.q[rows.log == i], axis=0) for i in np.unique(rows.log)]
    turns = np.array([unit == "rad" for unit in rows.units])
    return np.asarray(~turns | (np.min(travels, axis=0) > SMALL_TRAVEL))


def _odd_evidence(rows: FilteredRows, joints: Index, log: int) -> Array:
    return WhitenedMotion(rows, joints, FEW, odd=rows.log == log).free(rows.command)[:, 0]


def _is_clear(gains: Array) -> bool:
    return float(gains.sum()) >= ODDS and float((gains >= LIKELY).mean()) >= MOST_JOINTS


def _half_gains(log: Log, path: Channel, joints: Index) -> Array:
    """(m,) log odds of separate models of a log's halves against one model; at least 0."""
    first = log.t <= 0.5 * (log.t[0] + log.t[-1])
    rows = rows_of([log.take(first), log.take(~first)], path)
    if rows is None or len(np.unique(rows.log)) < 2:
        return np.zeros(len(joints))
    together = WhitenedMotion(rows, joints, FEW).free(rows.command)[:, 0]
    return np.maximum(_odd_evidence(rows, joints, 0) - together, 0.0)


CONTRADICTS = "contradiction"
LOADED, OTHER = 25.0, 30.0  # log odds of a load, and of other masses: right logs had 14 at most
# of friction: a factor, log odds over the joints that have it, and their part; right logs had -31 % in a half
FACTOR, FRICTION_ODDS, MOST_FRICTION = 1.35, 40.0, 0.6


@dataclass(frozen=True, eq=False)
class _Difference:
    """How a log differs from others by the model file; odds of -inf where nothing shows.

    Attributes:
        kg: additional load at its last link; None where the masses of links differ.
        factor: of its friction; None where it does not differ; 0 where the joints' factors differ.
    """

    odds: float
    kg: float | None = 0.0
    factor: float | None = None

    def inverse(self) -> _Difference:
        """The same of the others."""
        return replace(self, kg=self.kg and -self.kg, factor=self.factor and 1.0 / self.factor)

    @property
    def causes(self) -> list[str]:
        """What explains it."""
        causes = ["other masses of its links"] if self.kg is None else []
        if self.kg:
            causes = [f"{abs(self.kg):.2g} kg {'more' if self.kg > 0.0 else 'less'} at the last link"]
        if self.factor is not None:
            causes += [f"friction {self.factor:.2g} times as large" if self.factor else "other friction"]
        return causes


def contradiction(
    logs: Sequence[Log], path: Channel, body: Mean | None, sources: Sequence[str], old: int = 0
) -> Finding | None:
    """The finding, by the model file, that a log is of another robot; None if all agree.

    Args:
        old: number of accepted logs, which come first.
    """
    rows = None if body is None or len(logs) < 2 else rows_of(logs, path, body)
    if rows is None or body is None or not isinstance(body, SupportsVariations):
        return None
    numbers = np.unique(rows.log).tolist()
    two = len(numbers) == 2
    doubted = [i for i in numbers if i >= old][-1 if two else -MOST_GROUPS :]
    if len(numbers) < 2 or not doubted:
        return None
    differences = _differences(rows, doubted, path, body)
    odd, best = max(zip(doubted, differences, strict=True), key=lambda one: one[1].odds)
    if not best.causes:
        return None
    if two and best.kg is not None and best.kg < 0.0:  # of two, that with the load is named
        odd, best = sum(numbers) - odd, best.inverse()
    verb = "explains" if len(best.causes) == 1 else "explain"
    why = f"{' and '.join(best.causes)} in {sources[odd]} {verb} it"
    fact = f"no model of one robot with one load explains them (log odds {best.odds:.0f})"
    return contradicting(sources, odd, numbers, fact, why[0].upper() + why[1:])


def _differences(rows: FilteredRows, doubted: Sequence[int], path: Channel, body: Mean) -> list[_Difference]:
    """The difference of each doubted log from the others."""
    step = float(np.median(np.diff(rows.t)))
    rows = rows.take(np.arange(0, len(rows.t), max(1, round(ROWS_APART / step))))
    joints = np.flatnonzero(rows.moving & (rows.command[..., AS_LOGGED].std(axis=0) > 0.0))
    after = np.stack([rows.log == i for i in doubted], axis=1)
    informative = np.array([goes_far(rows.q[one]) & goes_far(rows.q[~one]) for one in after.T])[:, joints]
    if len(joints) < 2:
        return [_Difference(-np.inf)] * len(doubted)
    evidence = ChangeEvidence.of(rows, joints, path, body, after.astype(np.float64), informative)
    speeds, others = (
        np.array([rows.qd[some].std(axis=0) for some in which])[:, joints] for which in (after.T, ~after.T)
    )
    alike = (speeds < SPEEDS * others) & (others < SPEEDS * speeds)
    return [_difference(evidence, i, alike[i]) for i in range(len(doubted))]


def _difference(evidence: ChangeEvidence, which: int, alike: Mask) -> _Difference:
    """The difference in one change. alike: (k,) joints with comparable speeds: friction depends on them."""
    (load, kg), masses = evidence.load(which), evidence.masses(which)
    odds, factor = evidence.friction(which)
    differ = alike & (odds >= LIKELY) & ((factor > FACTOR) | (factor < 1.0 / FACTOR))
    friction_odds, difference = float(odds[differ].sum()), _Difference(-np.inf)
    if load >= LOADED or masses >= OTHER:
        difference = _Difference(max(load, masses), kg if load >= MOST_OF * masses else None)
    if friction_odds >= FRICTION_ODDS and differ.sum() >= MOST_FRICTION * evidence.informative[which].sum():
        largest = max(friction_odds, difference.odds)
        difference = replace(difference, odds=largest, factor=_in_common(factor[differ]))
    return difference


def _in_common(factor: Array) -> float:
    """The median of factors (k,); 0 where they differ."""
    middle = float(np.median(factor))
    return middle if (np.abs(factor - middle) < ALIKE * middle).all() else 0.0


def contradicting(sources: Sequence[str], odd: int, numbers: Sequence[int], fact: str, why: str) -> Finding:
    """The finding that the log `odd` contradicts the others of `numbers`."""
    who = f"{sources[odd]} contradicts the other logs"
    if len(numbers) == 2:
        who = f"{' and '.join(sources[i] for i in numbers)} contradict each other"
    return Finding(
        CONTRADICTS,
        "yellow",
        f"{who}: {fact}. {why}.",
        "Ingest logs of one robot with one load; another robot needs a separate campaign. "
        f"{accepted(CONTRADICTS).capitalize()}.",
        flag=CONTRADICTS,
    )


def contradiction_without_file(logs: Sequence[Log], path: Channel, sources: Sequence[str]) -> Finding | None:
    """The finding that logs are not of one robot; None if one model explains them."""
    outlier = odd_log(logs, path)
    if outlier is None:
        return None
    odd, gains = outlier
    joints = f"{int((gains >= LIKELY).sum())} of {len(gains)} joints"
    fact = f"a separate model explains the commands of {joints} better (log odds {gains.sum():.0f})"
    return contradicting(sources, odd, range(len(logs)), fact, "No sign, order or delay explains it")


CUTS = 8  # times at which a log is cut in two; the rows about it, up to midway to the next, are left out
LOAD_CUTS = 16  # times at which a load may be taken up
CUT_ROWS = 150  # that are looked at: a change that is told by fewer only is silent
PRIOR = float(np.log(0.002))  # that a log changes anywhere, in any way
GRIPS = float(np.log(0.01))  # that a load is taken up or put down in it
TAKEN_UP = 6.0  # log odds of that: right logs had 4.9 at most, loads of 0.2 kg 6 to 130
LEAST_LOAD = 0.05  # of one that moves commands as the file does: right logs had 0.034, loads of 0.2 kg 0.069
TURNS = 30.0  # log odds of a sign that turns: right logs had 17 at most, turned ones 38 to 480
ROWS_APART = 0.2  # s, of rows of several logs
MOST_OF = 0.8  # of what other masses gain, by a load: then it is a load
SPEEDS = 3.0  # ratio of speeds, up to which friction compares
ALIKE = 0.4  # of a factor of friction, by which joints may differ from it
SOME_TRAVEL = 0.5  # of a joint's range, before a load is taken up and after
SOME_JOINTS = 0.5  # of those that have a say: a load shows in some of them only
Kind = Literal["sign", "load", "robot"]


@dataclass(frozen=True, eq=False)
class Change:
    """What changes within a log.

    Attributes:
        joints: (k,) in whose commands it shows; none of a load. span: s between which it happens.
        odds: log odds to no change. kg: of a load that is taken up, or put down.
    """

    kind: Kind
    joints: Mask
    span: tuple[float, float]
    odds: float
    kg: float = 0.0


@dataclass(frozen=True, eq=False)
class _Cut:
    """A log's rows without those about a time, and which of them come after it.

    Attributes:
        joint_indices: (m,) joints that go far before and after it.
        covariance: of a point of the grid: that of all rows, of which these are some.
    """

    rows: FilteredRows
    after: Mask
    span: tuple[float, float]
    joint_indices: Index
    covariance: Callable[[Point], Array]


def change_within(log: Log, path: Channel, body: Mean | None) -> Change | None:
    """The likeliest change within a log, whatever its signs, order and delay; None without a change.

    Args:
        log: with positions `path` and commands on them.
        body: the model file's prediction of the commands; None without a file.
    """
    rows = rows_of([log], path, body)
    if rows is None or len(rows.t) < 2 * LEAST_ROWS:
        return None
    rows = rows.take(np.arange(0, len(rows.t), -(-len(rows.t) // CUT_ROWS)))
    cuts = list(_cuts(rows))
    if not cuts:
        return None
    turned, apart = zip(*(_gains(cut) for cut in cuts), strict=True)
    changes = [_sign_change(cuts, turned), _load_change(rows, path, body)]
    likeliest = max((one for one in changes if one is not None), key=lambda one: one.odds, default=None)
    return likeliest or _change_of_all(cuts, apart)


def _spans(rows: FilteredRows, count: int) -> list[tuple[float, float]]:
    """Intervals (s) around the times at which a log is cut; the first and the last part are twice as long."""
    start, step = float(rows.t[0]), float(np.ptp(rows.t)) / (count + 1)
    return [(start + (k - 0.5) * step, start + (k + 0.5) * step) for k in range(1, count + 1)]


def _cuts(rows: FilteredRows) -> Iterator[_Cut]:
    whole = cache(covariances(rows))
    for span in _spans(rows, CUTS):
        out = slice(int(np.searchsorted(rows.t, span[0])), int(np.searchsorted(rows.t, span[1], "right")))
        part = rows.take(np.r_[: out.start, out.stop : len(rows.t)])
        after = part.t > span[1]
        if min(after.sum(), (~after).sum()) < 2:
            continue
        far = (
            goes_far(part.q[after])
            & goes_far(part.q[~after])
            & (np.ptp(part.command[..., AS_LOGGED], axis=0) > 0)
        )
        if far.any():
            yield _Cut(part, after, span, np.flatnonzero(far), partial(_submatrix, whole, out))


def _submatrix(whole: Callable[[Point], Array], out: slice, point: Point) -> Array:
    """The covariance without the consecutive rows `out`; whole blocks are copied."""
    K = whole(point)
    n, m = len(K), len(K) - (out.stop - out.start)
    blocks = ((slice(0, out.start), slice(0, out.start)), (slice(out.stop, n), slice(out.start, m)))
    covariance = np.empty((m, m), order="F")  # the order that factors want
    for from_row, row in blocks:
        for from_column, column in blocks:
            covariance[row, column] = K[from_row, from_column]
    return covariance


def _gains(cut: _Cut) -> tuple[Array, Array]:
    """(k,) each: log odds of negated commands after the cut, and of a separate model there; 0 for joints that
    do not count.
    """
    rows, joints, covariance = cut.rows, cut.joint_indices, cut.covariance
    turned = np.where(cut.after[:, None], -1.0, 1.0) * rows.command[..., AS_LOGGED]
    both = np.concatenate([rows.command, turned[..., None]], axis=2)
    as_is, negated = (
        WhitenedMotion(rows, joints, FEW, covariance=covariance).free(both, (AS_LOGGED, both.shape[2] - 1)).T
    )
    apart = WhitenedMotion(rows, joints, FEW, cut.after, covariance).free(rows.command)[:, 0]
    gains = np.zeros((2, rows.q.shape[1]))
    # with one reversal in all, friction is a sign that turns there
    turns = _moves_both_ways(rows.qd[cut.after]) & _moves_both_ways(rows.qd[~cut.after])
    gains[:, joints] = np.where(turns[joints], negated - as_is, 0.0), apart - as_is
    return gains[0], gains[1]


def _moves_both_ways(qd: Array) -> Mask:
    """(k,) whether joints move forwards and backwards, beyond a part of their top speed."""
    least = TURN_SPEED * np.abs(qd).max(axis=0)
    return np.asarray((qd.max(axis=0) > least) & (qd.min(axis=0) < -least))


def _sign_change(cuts: Sequence[_Cut], gains: Sequence[Array]) -> Change | None:
    """The change of sign of one joint or several at one time."""
    each = _above_usual(np.array(gains)) - np.log(len(gains[0]))
    total = np.maximum(each, 0.0).sum(axis=1)
    best = int(total.argmax())
    odds = float(total[best]) + PRIOR - float(np.log(len(cuts)))
    span = _span([cut.span for cut in cuts], total)
    return None if odds < TURNS else Change("sign", each[best] >= LIKELY, span, odds)


def _load_change(rows: FilteredRows, path: Channel, body: Mean | None) -> Change | None:
    """A load at the last link, by the model file."""
    if body is None or not isinstance(body, SupportsVariations):
        return None
    joints = np.flatnonzero(rows.moving & (rows.command[..., AS_LOGGED].std(axis=0) > 0.0))
    spans = _spans(rows, LOAD_CUTS)
    after = np.stack([np.clip((rows.t - a) / (b - a), 0.0, 1.0) for a, b in spans], axis=1)
    informative = np.array(
        [_covers_range(rows.q, rows.t < a) & _covers_range(rows.q, rows.t > b) for a, b in spans]
    )
    informative = informative[:, joints]
    # one joint of several may call its friction a load
    informative[informative.sum(axis=1) < min(2, len(joints))] = False
    evidence = ChangeEvidence.of(rows, joints, path, body, after, informative, most=1)
    each, kg = np.array([evidence.load(i) for i in range(len(spans))]).T
    odds = float(log_sum(each)) + GRIPS - float(np.log(len(spans)))
    taken = float(kg[each.argmax()])
    if odds < TAKEN_UP or abs(taken) < LEAST_LOAD * evidence.unit[-1]:
        return None
    none = np.zeros(len(path.parts), dtype=np.bool_)
    return Change("load", none, _span(spans, each), odds, taken)


def _covers_range(q: Array, some: Mask) -> Mask:
    """(k,) whether joints cover a part of their range (n, k) in some rows. A start from rest is another
    motion.
    """
    return np.asarray(np.ptp(q[some], axis=0) > SOME_TRAVEL * np.ptp(q, axis=0))


def _change_of_all(cuts: Sequence[_Cut], gains: Sequence[Array]) -> Change | None:
    """Another robot or load, by motion and commands alone."""
    total = _above_usual(np.array([float(one.sum()) for one in gains]))
    best = int(total.argmax())
    likely = np.asarray(gains[best] >= LIKELY)
    odds = float(total[best]) + PRIOR - float(np.log(len(cuts)))
    if odds < ODDS or likely[cuts[best].joint_indices].mean() < SOME_JOINTS:
        return None
    return Change("robot", likely, _span([cut.span for cut in cuts], total), odds)


def _above_usual(gains: Array) -> Array:
    """Gains (c, ...) of the cuts above the median of all: a gain of every cut is an error of the model."""
    return np.asarray(gains - np.maximum(np.median(gains, axis=0), 0.0))


def _span(spans: Sequence[tuple[float, float]], total: Array) -> tuple[float, float]:
    """Interval (s) of the change: the cuts with at least half of the largest gain."""
    near = np.flatnonzero(total >= 0.5 * total.max())
    return spans[int(near[0])][0], spans[int(near[-1])][1]


def change_finding(change: Change, log: Log, parts: Sequence[str]) -> Finding:
    """The question that a change within a log raises."""
    a, b = (time - float(log.t[0]) for time in change.span)
    when, names = f"between {a:.3g} s and {b:.3g} s of {log.source}", named(parts, change.joints)
    if change.kind == "sign":
        fact = f"The sign of the commands of {names} turns {when}"
    elif change.kind == "load":
        direction = "more" if change.kg > 0.0 else "less"
        fact = f"From a time {when} on, the last link carries {abs(change.kg):.2g} kg {direction}"
    else:
        fact = f"From a time {when} on, a model of another robot or load explains the commands of {names}"
    return Doubt(
        CONTRADICTS,
        "yellow",
        f"{fact} (log odds {change.odds:.0f}).",
        f"Record again, or ingest a file with only the rows before {a:.3g} s or after {b:.3g} s; "
        f"{accepted(CONTRADICTS)}.",
        flag=CONTRADICTS,
        spans=(change.span,),
        by=(*change.span, *np.flatnonzero(change.joints).astype(np.float64).tolist()),
    )
