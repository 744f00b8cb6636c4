"""Cells, tables and seconds as people read them: closed forms."""

from __future__ import annotations

import math
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import t

from etude_studies.measured import Measured, measured_table
from etude_studies.thesis.choosing import ledger
from etude_studies.thesis.ledger import Row
from etude_studies.thesis.presenting import Cell, cell, entry_table, numbers, run_line
from etude_studies.thesis.reach_runs import METHODS, reach_spec, run, seconds_until
from etude_studies.thesis.verdicts import judge


class MadeUp:
    """Five seeds of every figure: k + seed / 10, ten times as much of run A5."""

    def values(
        self, source: str, measure: str, k: int, test: str = "", part: str = "mean"
    ) -> dict[int, float]:
        factor = 10.0 if source == "A5" else 1.0
        return {} if source == "A6" else {seed: factor * (k + seed / 10.0) for seed in range(5)}


def test_a_cell_is_the_mean_with_its_t_interval() -> None:
    values = {0: 1.0, 1: 2.0, 2: 4.0, 3: math.nan}
    own = Cell.of(values)
    x = np.array([1.0, 2.0, 4.0])
    half = t.ppf(0.975, 2) * x.std(ddof=1) / math.sqrt(3)
    assert (own.mean, own.seeds) == (pytest.approx(x.mean()), 3)
    assert (own.low, own.high) == (pytest.approx(x.mean() - half), pytest.approx(x.mean() + half))
    assert own.text.endswith(" (3 of 4)")
    assert Cell.of({0: 2.0}).text == "2"
    assert Cell.of({0: math.nan, 1: math.nan}).text == "none of 2"
    assert Cell.of({}).text == "-"


def test_a_table_has_the_thesiss_numbers_in_brackets_and_leaves_out_what_was_not_run() -> None:
    console = Console(width=160, record=True, file=StringIO())
    more = [Row(label="Dictionary (error), mine", run="A1+mine")]
    console.print(entry_table(ledger().entry("table-6.9"), MadeUp(), more))
    text = console.export_text()
    assert "[1.1536]" in text
    assert "62 ± " in text  # ten times the mean of 6.0 .. 6.4
    assert "Downsampling" not in text
    assert "mine" in text


def test_the_lengths_of_a_table_are_of_one_joint() -> None:
    entry = ledger().entry("table-6.2")
    asked = []

    class Asked(MadeUp):
        def values(self, source, measure, k, test="", part="mean"):
            asked.append((measure, part))
            return {}

    cell(Asked(), entry, "A1", entry.columns[0], 5)
    assert asked == [(f"length_{entry.columns[0]}", entry.part)]


def test_a_run_is_told_by_its_last_trajectory() -> None:
    assert run_line("A1", MadeUp()).startswith("A1")
    assert "after 10" in run_line("A1", MadeUp())
    assert run_line("A6", MadeUp()) == ""


def test_the_numbers_of_a_verdict_name_what_was_not_run() -> None:
    verdicts = judge(ledger(), MadeUp(), planned={"A1": 5, "A5": 5, "A6": 5, "A7": 5})
    assert any("0." in line and "seeds" in line for line in numbers(verdicts["C6.2-2"]))
    assert any("A6" in line for line in numbers(verdicts["C6.2-3"]))


@pytest.mark.parametrize(
    ("errors", "seconds"),
    [
        ([0.6, 0.4, 0.3], 120.0),
        ([0.4, 0.6, 0.3], 180.0),  # what comes back above was not reached yet
        ([0.4, 0.3, 0.2], 60.0),
        ([0.9, 0.8, 0.7], math.nan),
        ([0.4, 0.3, 0.6], math.nan),
        ([0.4, math.nan, 0.3], 180.0),
    ],
)
def test_seconds_until_an_error_stays_below(errors: list[float], seconds: float) -> None:
    found = seconds_until(dict(enumerate(errors, start=1)), 0.5)
    assert found == pytest.approx(seconds, nan_ok=True)


def test_seconds_of_every_method_come_from_its_own_table() -> None:
    spec = reach_spec(3)
    needs = {}
    for place, own in enumerate(spec.needs):
        rows = [Measured(k, "fourier", "", "mean", "error", 0.45 if k > place else 2.0) for k in range(1, 9)]
        needs[own.hash] = measured_table(rows, "made up")
    found = {(row.model, row.part): row.value for row in run(spec.settings, 3, needs)}
    assert [found[name, "0.5"] for name in METHODS] == [60.0 * (i + 1) for i in range(len(METHODS))]
    assert all(math.isnan(found[name, "0.3"]) for name in METHODS)


def test_on_a_narrow_terminal_the_parts_of_a_cell_stand_below_each_other() -> None:
    out = StringIO()
    Console(file=out, width=80).print(entry_table(ledger().entry("table-6.9"), MadeUp(), narrow=True))
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "Dictionary" in out.getvalue(), "names are broken between words"
    assert not any(line.rstrip().endswith("±") for line in lines)
