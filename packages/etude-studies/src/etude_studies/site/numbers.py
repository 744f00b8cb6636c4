"""Numbers of the pages: all counts of one figure at once, and means with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from etude_studies.collected import Results
from etude_studies.thesis import statistics
from etude_studies.thesis.ledger import Entry, Row

BySeed = Mapping[int, float]


@dataclass(frozen=True)
class Summary:
    """A figure over seeds.

    Attributes:
        mean: over seeds. low, high: its 95 % t interval; equal to the mean for a single seed.
        n: seeds with a finite number.
    """

    mean: float
    low: float
    high: float
    n: int


def summary(values: BySeed, *, logs: bool = False) -> Summary | None:
    """Of the finite numbers; None if there is none.

    Args:
        logs: the geometric mean and its interval, of what spans decades.
    """
    x = np.array([value for value in values.values() if math.isfinite(value)], dtype=float)
    if not len(x):
        return None
    x = np.log(x) if logs else x
    low, high = statistics.interval(x) if len(x) > 1 else (float(x[0]), float(x[0]))
    mean, low, high = (math.exp(v) if logs else v for v in (float(x.mean()), low, high))
    return Summary(mean, low, high, len(x))


@dataclass(frozen=True)
class Numbers:
    """Results, each figure looked up once."""

    results: Results
    _read: dict[tuple[str, ...], Mapping[int, BySeed]] = field(default_factory=dict, repr=False)

    def by_k(self, source: str, measure: str, test: str, part: str) -> Mapping[int, BySeed]:
        """Numbers by seed for every k, rising; empty where nothing is there."""
        run, _, model = source.partition(":")
        if run not in self.results.tables:
            return {}
        if (run,) not in self._read:
            self._read[(run,)] = {}
            self._read.update(_by_figure(run, self.results.tables[run]))
        return self._read.get((run, model, measure, test, part), {})

    def cell(self, entry: Entry, source: str, column: str, k: int, test: str | None = None) -> BySeed:
        """The numbers of one cell of an entry by seed; of another test where it is named."""
        measure, part = figure_of(entry, column)
        return self.by_k(source, measure, entry.test if test is None else test, part).get(k, {})

    def summary(
        self, entry: Entry, source: str, column: str, k: int, test: str | None = None
    ) -> Summary | None:
        """Of one cell of an entry; None if it has no number."""
        return summary(self.cell(entry, source, column, k, test), logs=entry.in_logs)

    def curve(self, entry: Entry, source: str, column: str, at: tuple[int, ...]) -> dict[int, Summary]:
        """Summaries at those counts `at` that are there."""
        results = {k: self.summary(entry, source, column, k) for k in at}
        return {k: result for k, result in results.items() if result is not None}

    def values(self, source: str, measure: str, k: int, test: str, part: str) -> BySeed:
        """One figure of every seed that has it (implements `contrasts.Values`)."""
        return self.by_k(source, measure, test, part).get(k, {})

    def tests(self, entry: Entry, source: str) -> tuple[str, ...]:
        """Names of the tests on which the entry's measure is there, sorted."""
        measure, part = figure_of(entry, entry.columns[-1])
        self.by_k(source, measure, entry.test, part)
        run, _, model = source.partition(":")
        keys = (key for key in self._read if len(key) == 5)
        return tuple(sorted({k[3] for k in keys if k[:3] == (run, model, measure) and k[4] == part}))

    def made(self, source: str) -> Mapping[str, Any]:
        """Where the run's results come from; empty where there are none."""
        return self.results.descriptions.get(source.partition(":")[0], {})


def figure_of(entry: Entry, column: str) -> tuple[str, str]:
    """Measure and part of a column."""
    if entry.part:  # columns are inputs, and the measure is one number for each of them
        return f"{entry.measure}_{column}", entry.part
    return entry.measure, column


def counts(entry: Entry, row: Row | None = None) -> tuple[int, ...]:
    """The counts of trajectories that a row of the entry shows."""
    return (row.at if row is not None else ()) or entry.at


def printed(entry: Entry, row: Row) -> dict[str, float]:
    """The thesis's numbers by column; "mean" is the mean of those of the joints."""
    named = [column for column in entry.columns if column != "mean"]
    if not row.printed:
        return {}
    numbers = dict(zip(named, row.printed, strict=True))
    if "mean" in entry.columns:
        numbers["mean"] = math.fsum(row.printed) / len(row.printed)
    return numbers


def _by_figure(run: str, table: Any) -> Iterator[tuple[tuple[str, ...], Mapping[int, BySeed]]]:
    """Key (run, model, measure, test, part) and its numbers by k and seed."""
    names = ["model", "measure", "test", "part"]
    for key, group in table.sort("k", "seed").partition_by(names, as_dict=True).items():
        by_k: dict[int, dict[int, float]] = {}
        columns = group["k"].to_list(), group["seed"].to_list(), group["value"].to_list()
        for k, seed, value in zip(*columns, strict=True):
            by_k.setdefault(k, {})[seed] = math.nan if value is None else float(value)
        yield (run, *(str(part) for part in key)), by_k
