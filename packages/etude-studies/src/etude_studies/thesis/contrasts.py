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

from etude.types import Array
from etude_studies.thesis.ledger_items import Part
from etude_studies.thesis.parts import check, parts_read, run_of, sources

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
        stored: by source, how many of its seeds have anything here.
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
    planned: Mapping[str, int] | None = None,
    seeds: int = 0,
    block: int = 0,
) -> tuple[Contrast, ...]:
    """x_s of `part`: one contrast, or one at each k of "ratio_each".

    Args:
        part: what is claimed.
        results: what was measured.
        planned: seeds by run; those beyond are left out. seeds: planned of runs that are not in it.
        block: the number of seeds in the place of both; 0: as planned.

    Raises:
        UsageError: an unknown statistic or claim, or a part without what its statistic needs.
    """
    check(part)
    cells = _Cells(part, results)
    seeds_by_run = {} if block else planned or {}
    plan = min(seeds_by_run.get(run_of(source), block or seeds) for source in cells.stored)
    most = [count for source in cells.stored if (count := seeds_by_run.get(run_of(source), block))]
    counted = sorted(set.intersection(*cells.stored.values()))[: min(most, default=None)]
    if part.statistic == EACH:
        return tuple(_contrast(cells, counted, plan, (k,), k) for k in part.at)
    return (_contrast(cells, counted, plan, tuple(part.at), None),)


class _Cells:
    """The numbers of one part, each read once; `stored`: the seeds of each source."""

    def __init__(self, part: Part, results: Values) -> None:
        self.part = part
        self._results = results
        self._read: dict[tuple[str, int, str], Mapping[int, float]] = {}
        self.stored = {source: self._seeds(source) for source in sources(part)}

    def of(self, source: str, k: int, name: str) -> Mapping[int, float]:
        """By seed, in joint or command `name`."""
        key = (source, k, name)
        if key not in self._read:
            part = self.part
            self._read[key] = self._results.values(source, part.measure, k, part.test, name)
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
        part_name = self.part.part if name is None else name
        return self.cells.of(source, k, part_name).get(self.seed, math.nan)

    def log(self, source: str, k: int, name: str | None = None) -> float:
        return _log(self.m(source, k, name))

    def ratio(self, a: str, b: str, at: Sequence[int]) -> float:
        return _mean(self.log(a, k) - self.log(b, k) for k in at)


def _contrast(cells: _Cells, seeds: Sequence[int], plan: int, at: Sequence[int], k: int | None) -> Contrast:
    readers = [_Seed(cells, seed) for seed in seeds]
    together = _TOGETHER.get(cells.part.statistic)
    if together is not None:
        x = together(readers, at) if readers else np.empty(0)
    else:
        x = np.array([_STATISTICS[cells.part.statistic](one, at) for one in readers])
    finite = {seed: float(value) for seed, value in zip(seeds, x, strict=True) if math.isfinite(value)}
    stored = {source: len(seeds_stored) for source, seeds_stored in cells.stored.items()}
    return Contrast(finite, max(plan, len(seeds)), stored, k)


def _ratio(seed: _Seed, at: Sequence[int]) -> float:
    return seed.ratio(seed.part.a, seed.part.b or "", at)


def _rises(seed: _Seed, at: Sequence[int]) -> float:
    steps = [(k, after) for k, after in pairwise(at) if after == k + 1]

    def share(source: str) -> float:
        logs = [seed.log(source, after) - seed.log(source, k) for k, after in steps]
        return _mean(float(rise > math.log(RISE)) if math.isfinite(rise) else math.nan for rise in logs)

    return share(seed.part.a) - (share(seed.part.b) if seed.part.b else 0.0)


def _slope(seed: _Seed, at: Sequence[int]) -> float:
    part = seed.part

    def decrease(source: str, ends: Sequence[int]) -> float:
        first, last = ends[0], ends[-1]
        return (seed.log(source, first) - seed.log(source, last)) / (last - first)

    if not part.b and not part.against:
        return decrease(part.a, at)
    return decrease(part.a, at) - decrease(part.b or part.a, part.against or at)


def _value(seed: _Seed, at: Sequence[int]) -> float:
    part = seed.part
    if part.log:
        return _mean(seed.log(part.a, k) for k in at) - _log_bound(part)
    return _mean(seed.m(part.a, k) for k in at) - (part.bound or 0.0)


def _gap(seeds: Sequence[_Seed], at: Sequence[int]) -> Array:
    part = seeds[0].part
    first = np.array([_ratio(seed, at) for seed in seeds])
    if not part.c:
        return _sizes(first)[0] - _log_bound(part)
    second = np.array([seed.ratio(part.c, part.d or "", at) for seed in seeds])
    return np.subtract(*_sizes(first, second))


def _shrinks(seeds: Sequence[_Seed], at: Sequence[int]) -> Array:
    return np.subtract(
        *_sizes(*(np.array([_ratio(seed, ends) for seed in seeds]) for ends in (at[:1], at[-1:])))
    )


def _sizes(*effects: Array) -> list[Array]:
    """The same (n,) with the sign of their means over the seeds that have all of them: sizes, in the mean.

    The mean of single seeds' sizes would grow with the noise.
    """
    whole = np.isfinite(effects).all(axis=0)
    return [effect * (-1.0 if effect[whole].sum() < 0.0 else 1.0) for effect in effects]


def _rank(seed: _Seed, at: Sequence[int]) -> float:
    among = seed.part.among or ()

    def rank(k: int) -> float:
        mine, all_ = seed.m(seed.part.a, k), np.array([seed.m(source, k) for source in among])
        if not np.isfinite(all_).all():
            return math.nan
        # equals share their ranks
        return 0.5 + float(np.mean([np.count_nonzero(all_ < mine), np.count_nonzero(all_ <= mine)]))

    return _mean(rank(k) for k in at) - (seed.part.bound or 0.0)


def _reach(seed: _Seed, at: Sequence[int]) -> float:
    part = seed.part
    a, b = ([seed.log(source, k) for k in at] for source in (part.a, part.b or ""))
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


def _spread(seeds: Sequence[_Seed], at: Sequence[int]) -> Array:
    part = seeds[0].part
    logs = np.array([[_mean(seed.log(source, k) for k in at) for seed in seeds] for source in part.among])
    means = logs[:, np.isfinite(logs).all(axis=0)].sum(axis=1)
    return np.asarray(logs[means.argmax()] - logs[means.argmin()] + 0.0 * logs.sum(axis=0) - _log_bound(part))


def _extreme(choose: Callable[[list[float]], float]) -> Callable[[_Seed, Sequence[int]], float]:
    def statistic(seed: _Seed, at: Sequence[int]) -> float:
        a, b, mine = seed.part.a, seed.part.b, seed.part.part
        others = [name for name in parts_read(seed.part) if name != mine]

        def log(k: int, name: str) -> float:
            return seed.log(a, k, name) - (seed.log(b, k, name) if b else 0.0)

        def beyond(k: int) -> float:
            other_logs = [log(k, name) for name in others]
            # min and max would pass over a NaN
            return log(k, mine) - choose(other_logs) if np.isfinite(other_logs).all() else math.nan

        return _mean(beyond(k) for k in at)

    return statistic


_STATISTICS: Mapping[str, Callable[[_Seed, Sequence[int]], float]] = {
    "ratio": _ratio,
    EACH: _ratio,
    "rises": _rises,
    "slope": _slope,
    "value": _value,
    "rank": _rank,
    "reach": _reach,
    "largest": _extreme(max),
    "smallest": _extreme(min),
}
_TOGETHER: Mapping[str, Callable[[Sequence[_Seed], Sequence[int]], Array]] = {
    "gap": _gap,
    "shrinks": _shrinks,
    "spread": _spread,
}
"""Statistics whose number of one seed depends on the mean of all."""


def _log_bound(part: Part) -> float:
    return math.log(part.bound or 1.0)


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else math.nan


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
