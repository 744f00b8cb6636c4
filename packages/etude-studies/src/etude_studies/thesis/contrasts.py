"""One number a seed from one part of a claim: x_s, whose sign or size is what the part claims.

All logarithms are natural, and an average over several counts of trajectories is taken after them. A number
that is missing, not finite, or not above 0 where a logarithm is taken leaves its seed without x_s: that seed
has failed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from etude_studies.thesis.ledger_items import Part
from etude_studies.thesis.parts import check, exchanged, parts_read, run_of, sources

RISE = 1.02
"""A step by less counts as none."""
EACH = "ratio_each"


class Values(Protocol):
    """What has been measured."""

    def values(self, source: str, measure: str, k: int, test: str, part: str) -> Mapping[int, float]:
        """Number by seed; empty where nothing is stored. A seed that crashed is absent or NaN."""
        ...


@dataclass(frozen=True)
class Contrast:
    """x_s of one part; of one count of trajectories where each has to hold by itself.

    Attributes:
        x: finite numbers by seed.
        planned: seeds that there should be, failed ones included.
        stored: by source, after the exchange, how many of its seeds have anything here.
        k: the count of trajectories of "ratio_each", else None.
    """

    x: Mapping[int, float]
    planned: int
    stored: Mapping[str, int]
    k: int | None = None

    @property
    def failed(self) -> int:
        """Planned seeds without a number."""
        return self.planned - len(self.x)


def contrasts(
    part: Part,
    results: Values,
    *,
    replace: Mapping[str, str] | None = None,
    planned: Mapping[str, int] | None = None,
    seeds: int = 0,
) -> tuple[Contrast, ...]:
    """x_s of `part`: one contrast, or one at each k of "ratio_each".

    Args:
        part: what is claimed.
        results: what was measured.
        replace: run or source by the one that takes its place.
        planned: seeds by run. seeds: the same for runs that are not in it.

    Raises:
        UsageError: an unknown statistic or claim, or a part without what its statistic needs.
    """
    check(part)
    cells = _Cells(part, results, replace or {})
    plan = min((planned or {}).get(run_of(source), seeds) for source in cells.stored)
    if part.statistic == EACH:
        return tuple(_contrast(cells, plan, (k,), k) for k in part.at)
    return (_contrast(cells, plan, tuple(part.at), None),)


class _Cells:
    """The numbers of one part, each read once; `stored`: the seeds of each source after the exchange."""

    def __init__(self, part: Part, results: Values, replace: Mapping[str, str]) -> None:
        self.part = part
        self._results, self._replace = results, replace
        self._read: dict[tuple[str, int, str], Mapping[int, float]] = {}
        self.stored = {exchanged(source, replace): self._seeds(source) for source in sources(part)}

    def of(self, source: str, k: int, name: str) -> Mapping[int, float]:
        """By seed, in joint or command `name`."""
        key = (source, k, name)
        if key not in self._read:
            where = exchanged(source, self._replace)
            own = self.part
            self._read[key] = self._results.values(where, own.measure, k, own.test, name)
        return self._read[key]

    def _seeds(self, source: str) -> set[int]:
        counts = dict.fromkeys((*self.part.at, *(self.part.against or ())))
        return {seed for k in counts for name in parts_read(self.part) for seed in self.of(source, k, name)}


@dataclass(frozen=True)
class _Seed:
    """The numbers of one seed; NaN where there is none."""

    cells: _Cells
    seed: int

    @property
    def part(self) -> Part:
        return self.cells.part

    def m(self, source: str, k: int, name: str | None = None) -> float:
        own = self.part.part if name is None else name
        return self.cells.of(source, k, own).get(self.seed, math.nan)

    def log(self, source: str, k: int, name: str | None = None) -> float:
        return _log(self.m(source, k, name))

    def ratio(self, a: str, b: str, at: Sequence[int]) -> float:
        return _mean(self.log(a, k) - self.log(b, k) for k in at)


def _contrast(cells: _Cells, plan: int, at: Sequence[int], k: int | None) -> Contrast:
    common = set.intersection(*cells.stored.values())
    statistic = _STATISTICS[cells.part.statistic]
    x = {seed: statistic(_Seed(cells, seed), at) for seed in sorted(common)}
    finite = {seed: value for seed, value in x.items() if math.isfinite(value)}
    stored = {source: len(seeds) for source, seeds in cells.stored.items()}
    return Contrast(finite, max(plan, len(common)), stored, k)


def _ratio(own: _Seed, at: Sequence[int]) -> float:
    return own.ratio(own.part.a, own.part.b or "", at)


def _rises(own: _Seed, at: Sequence[int]) -> float:
    steps = [(k, after) for k, after in pairwise(at) if after == k + 1]

    def share(source: str) -> float:
        logs = [own.log(source, after) - own.log(source, k) for k, after in steps]
        return _mean(float(rise > math.log(RISE)) if math.isfinite(rise) else math.nan for rise in logs)

    return share(own.part.a) - (share(own.part.b) if own.part.b else 0.0)


def _slope(own: _Seed, at: Sequence[int]) -> float:
    part = own.part

    def decrease(source: str, ends: Sequence[int]) -> float:
        first, last = ends[0], ends[-1]
        return (own.log(source, first) - own.log(source, last)) / (last - first)

    if not part.b and not part.against:
        return decrease(part.a, at)
    return decrease(part.a, at) - decrease(part.b or part.a, part.against or at)


def _value(own: _Seed, at: Sequence[int]) -> float:
    part = own.part
    if part.log:
        return _mean(own.log(part.a, k) for k in at) - _log_bound(part)
    return _mean(own.m(part.a, k) for k in at) - (part.bound or 0.0)


def _gap(own: _Seed, at: Sequence[int]) -> float:
    part = own.part
    other = abs(own.ratio(part.c, part.d or "", at)) if part.c else _log_bound(part)
    return abs(_ratio(own, at)) - other


def _shrinks(own: _Seed, at: Sequence[int]) -> float:
    return abs(_ratio(own, at[:1])) - abs(_ratio(own, at[-1:]))


def _rank(own: _Seed, at: Sequence[int]) -> float:
    among = own.part.among or ()

    def rank(k: int) -> float:
        mine, all_ = own.m(own.part.a, k), np.array([own.m(source, k) for source in among])
        if not np.isfinite(all_).all():
            return math.nan
        # equals share their ranks
        return 0.5 + float(np.mean([np.count_nonzero(all_ < mine), np.count_nonzero(all_ <= mine)]))

    return _mean(rank(k) for k in at) - (own.part.bound or 0.0)


def _reach(own: _Seed, at: Sequence[int]) -> float:
    part = own.part
    a, b = ([own.log(source, k) for k in at] for source in (part.a, part.b or ""))
    if not np.isfinite([a, b]).all():
        return math.nan
    # what b needs for a's last value is the other side of the scale: a's own need against the last count is
    # below 0 for equals too, since errors that go up and down pass the last value early
    return math.log(_needed(a, b[-1], at)) - math.log(_needed(b, a[-1], at))


def _needed(logs: Sequence[float], level: float, at: Sequence[int]) -> float:
    """Trajectories until `logs` is at or below `level`, interpolated; the last count where it never is."""
    if logs[0] <= level:
        return float(at[0])
    for (k, high), (after, low) in pairwise(zip(at, logs, strict=True)):
        if low <= level:
            return k + (after - k) * (high - level) / (high - low)
    return float(at[-1])


def _spread(own: _Seed, at: Sequence[int]) -> float:
    def spread(k: int) -> float:
        logs = np.array([own.log(source, k) for source in own.part.among or ()])
        return float(logs.max() - logs.min())

    return _mean(spread(k) for k in at) - _log_bound(own.part)


def _extreme(choose: Callable[[list[float]], float]) -> Callable[[_Seed, Sequence[int]], float]:
    def statistic(own: _Seed, at: Sequence[int]) -> float:
        a, b, mine = own.part.a, own.part.b, own.part.part
        others = [name for name in parts_read(own.part) if name != mine]

        def log(k: int, name: str) -> float:
            return own.log(a, k, name) - (own.log(b, k, name) if b else 0.0)

        def beyond(k: int) -> float:
            rest = [log(k, name) for name in others]
            # min and max would pass over a NaN
            return log(k, mine) - choose(rest) if np.isfinite(rest).all() else math.nan

        return _mean(beyond(k) for k in at)

    return statistic


_STATISTICS: Mapping[str, Callable[[_Seed, Sequence[int]], float]] = {
    "ratio": _ratio,
    EACH: _ratio,
    "rises": _rises,
    "slope": _slope,
    "value": _value,
    "gap": _gap,
    "shrinks": _shrinks,
    "rank": _rank,
    "reach": _reach,
    "spread": _spread,
    "largest": _extreme(max),
    "smallest": _extreme(min),
}


def _log_bound(part: Part) -> float:
    return math.log(part.bound or 1.0)


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else math.nan


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
