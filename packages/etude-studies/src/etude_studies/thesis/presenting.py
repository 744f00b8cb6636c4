"""Figures, tables and claims as text: the thesis's layout, its numbers beside ours with intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rich.box import SIMPLE_HEAD
from rich.table import Table

from etude_studies.method_comparison import compared_rows
from etude_studies.site.mathematics import plain
from etude_studies.thesis.ledger import Claim, Entry, Row
from etude_studies.thesis.part_verdicts import NOT_RUN, PartVerdict
from etude_studies.thesis.statistics import interval
from etude_studies.thesis.verdicts import Verdict

MOST_ROUNDS = 10


class Values(Protocol):
    """Where measured values are looked up: `collected.Results`."""

    def values(
        self, source: str, measure: str, k: int, test: str = "", part: str = "mean"
    ) -> Mapping[int, float]: ...


@dataclass(frozen=True)
class Cell:
    """One number of ours.

    Attributes:
        mean: over seeds. low, high: its 95 % t interval; NaN of one seed. seeds: how many.
        asked: how many have the figure, those that never reached what it counts among them.
        logs: whether the mean is geometric.
    """

    mean: float
    low: float
    high: float
    seeds: int
    asked: int
    logs: bool = False

    @classmethod
    def of(cls, values: Mapping[int, float], *, logs: bool = False) -> Cell:
        """Of values by seed; those that are not finite are counted, and else left out.

        Args:
            logs: the geometric mean and its interval.
        """
        finite = [value for value in values.values() if math.isfinite(value)]
        if not finite:
            return cls(math.nan, math.nan, math.nan, 0, len(values), logs)
        finite = [math.log(value) for value in finite] if logs else finite
        low, high = interval(finite) if len(finite) > 1 else (math.nan, math.nan)
        mean, low, high = (math.exp(v) if logs else v for v in (sum(finite) / len(finite), low, high))
        return cls(mean, low, high, len(finite), len(values), logs)

    @property
    def text(self) -> str:
        """The mean and the half width of its interval; of how many seeds, where not all have one."""
        if not self.seeds:
            return f"none of {self.asked}" if self.asked else "-"
        half = (
            f" ({self.low:.3g} to {self.high:.3g})" if self.logs else f" ± {(self.high - self.low) / 2:.2g}"
        )
        some = f" ({self.seeds} of {self.asked})" if self.seeds < self.asked else ""
        return f"{self.mean:.4g}" + ("" if math.isnan(self.high) else half) + some


def cell(results: Values, entry: Entry, source: str, column: str, k: int) -> Cell:
    """What an entry shows of a source in a column after k trajectories."""
    measure, part = entry.measure, column
    if entry.part:  # columns are inputs, and the measure is one number for each of them
        measure, part = f"{entry.measure}_{column}", entry.part
    return Cell.of(results.values(source, measure, k, entry.test, part), logs=entry.in_logs)


def entry_table(entry: Entry, results: Values, more: Sequence[Row] = (), narrow: bool = False) -> Table:
    """Rows and lines of an entry after its last k; the thesis's own numbers in brackets.

    Args:
        more: rows of methods that are not the thesis's.
        narrow: without frames, the parts of a cell below each other.
    """
    style: dict[str, Any] = (
        {"box": SIMPLE_HEAD, "padding": (0, 1, 0, 0), "show_edge": False} if narrow else {}
    )
    shown = Table(title=f"{entry.id}: {entry.title} ({entry.unit})", title_justify="left", **style)
    for heading in ("", "after", *entry.columns, "seeds"):
        shown.add_column(heading, justify="left" if not heading else "right", overflow="fold")
    rows = [*entry.rows, *more, *(Row(label=line, run=line) for line in entry.lines)]
    for row in rows:
        for k in (row.at or entry.at)[-1:] if entry.kind == "table" else entry.at:
            _add(shown, entry, row, results, k, narrow)
    return shown


def _add(shown: Table, entry: Entry, row: Row, results: Values, k: int, narrow: bool) -> None:
    cells = [cell(results, entry, row.run, column, k) for column in entry.columns]
    if not any(item.asked for item in cells):
        return
    printed = [rf" \[{value:g}]" for value in row.printed] if entry.kind == "table" else []
    printed += [""] * (len(cells) - len(printed))
    texts = [item.text + text for item, text in zip(cells, printed, strict=True)]
    if narrow:
        texts = [text.replace(" ± ", "\n± ").replace(r" \[", "\n" + r"\[") for text in texts]
    shown.add_row(row.label, str(k), *texts, str(max(item.asked for item in cells)))


def comparison_lines(entry: Entry, results: Values) -> list[str]:
    """A line for every row over the one that the entry names; none without."""
    names = {row.run: row.label for row in entry.rows}
    lines = []
    for run, part in compared_rows(entry, results).items():
        whole = part.seeds >= entry.seeds
        word = part.word if whole else f"{NOT_RUN}: {part.seeds} of {entry.seeds} seeds"
        lines.append(f"{names[run]}: {word}, {_numbers_of(part)}")
    return [f'"Less than {names[entry.against]}"', *lines] if lines else []


HEADLINES = (("error", "fourier", "deg"), ("mae", "uniform", "command unit"))
"""Measure, test and unit by which a run is known, where no figure or table is asked for."""


def run_line(run: str, results: Values) -> str:
    """The run's headline after its last trajectory; "" if it has none."""
    for measure, test, unit in HEADLINES:
        for k in range(MOST_ROUNDS, 0, -1):
            figure = Cell.of(results.values(run, measure, k, test))
            if figure.seeds:
                return (
                    f"{run:24} {figure.text} {unit} after {k} ({measure}, test {test}, {figure.seeds} seeds)"
                )
    return ""


def verdict_sentence(claim: Claim, verdict: Verdict) -> str:
    """The claim and its verdict, in two lines."""
    reason = f" ({verdict.reason})" if verdict.reason else ""
    marks = [
        word
        for word, holds in (("simulated", verdict.simulated), ("exploratory", verdict.exploratory))
        if holds
    ]
    tail = f" [{', '.join(marks)}]" if marks else ""
    return f'{claim.id}: "{plain(" ... ".join(claim.quote))}"\n  {verdict.word}{reason}{tail}'


def numbers(verdict: Verdict) -> list[str]:
    """A line for each part of a verdict: estimate, interval, wins, seeds, p."""
    lines = []
    for part in verdict.parts:
        at = "" if part.k is None else f" at {part.k}"
        if part.estimate is None or part.low is None or part.high is None:
            lines.append(f"part {part.part + 1}{at}: {part.word} ({part.reason})")
            continue
        lines.append(f"part {part.part + 1}{at}: {part.word}, {_numbers_of(part)}")
    return lines


def _numbers_of(part: PartVerdict) -> str:
    """Estimate, interval, wins, p, power and seeds needed, as far as they are there."""
    if part.estimate is None:
        return part.reason
    p = "" if part.p_adjusted is None else f", adjusted p {part.p_adjusted:.2g}"
    power = "" if part.power is None else f", power {part.power:.2g}"
    needed = "" if part.needed is None else f"; {part.needed} seeds would decide"
    interval = f"{part.estimate:.3g} [{part.low:.3g}, {part.high:.3g}]"
    return f"{interval}, {part.wins} of {part.seeds} seeds{p}{power}{needed}"
