"""The ledger of the thesis: complete, consistent with its own numbers, and refused when it is not."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_studies.thesis.catalogue import catalogue
from etude_studies.thesis.choosing import runs_of
from etude_studies.thesis.ledger import HERE, Ledger, Part, load_ledger

PLANNED = {
    *(f"A{i}" for i in range(8)),
    *(f"S{i}" for i in range(1, 10)),
    *(f"X{i}" for i in ("1", "2", "3", "4", "5a", "5b", "6a", "6b", "7", "8", "9", "11", "13", "14")),
    *(f"Q{i}" for i in (1, 2, 3, 4, 5, "6u", "6d", "7u", "7d", "8u", "8d")),
    *(f"P{i}" for i in (1, 2, 3, 4, "5u", "5d", "6u", "6d")),
    *("B0", "B1", "B2", "DP1", "DP2", "DP3", "DP4", "Y1", "Y2", "Y3", "Y4", "Y5"),
    *("Y6", "Y7", "W0", "W1", "K1", "T1", "O1", "L1"),
    *("A1t", "A7t", "S1t", "S9t"),
}
SECTIONS = ("5.2", "5.3", "5.4", "6", "6.1", "6.1.1", "6.1.2", "6.2", "6.3.1", "6.3.2", "6.4", "7", "7.1.1")


@pytest.fixture(scope="module")
def ledger() -> Ledger:
    return load_ledger()


def test_every_figure_and_table_of_the_lists_in_front_stands_there_once(ledger: Ledger) -> None:
    figures = ["2.3", *(f"5.{i}" for i in range(1, 9)), *(f"6.{i}" for i in range(1, 19))]
    wanted = [f"figure-{i}" for i in figures] + [f"table-6.{i}" for i in range(1, 13)]
    found = [entry.id for entry in ledger.entries if not entry.id.startswith("beyond-")]
    assert sorted(found) == sorted(wanted)
    assert len(wanted) == 39


def test_every_section_with_results_has_claims_and_each_has_one_answer(ledger: Ledger) -> None:
    assert set(SECTIONS) <= {claim.section for claim in ledger.claims}
    for claim in ledger.claims:
        assert sum((bool(claim.parts), bool(claim.alias_of), bool(claim.untestable))) == 1, claim.id
        assert claim.seeds == 60 or not claim.section.startswith("5"), claim.id


def test_what_is_corrected_together_is_as_small_as_a_table(ledger: Ledger) -> None:
    """So small that sign flips of ten seeds (1 in 512) can decide each of them."""
    sizes = Counter[str]()
    for claim in (own for own in ledger.claims if own.kind == "own"):
        asked = [
            len(part.at) if part.statistic == "ratio_each" else 1
            for part in claim.parts
            if part.claim != "equal"
        ]
        sizes[next(iter(claim.rests_on), claim.id)] += sum(asked)
    assert max(sizes.values()) <= 25, sizes.most_common(3)


def test_aliases_lead_to_claims_that_are_tested(ledger: Ledger) -> None:
    aliases = [claim for claim in ledger.claims if claim.kind == "alias"]
    assert aliases
    for claim in aliases:
        for other in claim.alias_of:
            assert ledger.claim(other).parts, claim.id
            assert claim.id in ledger.aliases_of(other)
    assert ledger.aliases_of("C6.2-3") == ("C6.4-1", "C7-4")


def test_claims_are_found_by_their_figure_or_table(ledger: Ledger) -> None:
    on_table = {claim.id for claim in ledger.claims_of("table-6.9")}
    assert {"C6.2-2", "C6.2-3", "C6.2-4"} <= on_table
    assert "C5.2-1a" not in on_table
    without = [entry.id for entry in ledger.entries if not ledger.claims_of(entry.id)]
    assert [id for id in without if not id.startswith("beyond-")] == [
        "figure-5.3"
    ]  # one flight, of which nothing is claimed


def test_printed_tables_are_whole(ledger: Ledger) -> None:
    for entry in ledger.entries:
        columns = len([column for column in entry.columns if column != "mean"])
        for row in entry.rows:
            assert len(row.printed) == (columns if entry.id.startswith("table") else 0), entry.id


@pytest.mark.parametrize(
    ("first", "again"),
    [
        (("table-6.4", "5 steps"), ("table-6.5", "Reinit")),
        (("table-6.4", "5 steps"), ("table-6.8", "Learning")),
        (("table-6.6", "5 steps"), ("table-6.7", "Reinit")),
        (("table-6.6", "5 steps"), ("table-6.8", "Fixed")),
        (("table-6.3", "25 steps"), ("table-6.9", "Dictionary (error)")),
    ],
)
def test_what_the_thesis_prints_twice_is_the_same_run(
    ledger: Ledger, first: tuple[str, str], again: tuple[str, str]
) -> None:
    one, other = (_row(ledger, *place) for place in (first, again))
    assert one == other


def test_two_tables_print_one_condition_with_different_numbers(ledger: Ledger) -> None:
    error, random = _row(ledger, "table-6.9", "Dictionary (error)"), _row(ledger, "table-6.10", "Random")
    assert error[0] == random[0] == "A1"
    assert round(float(np.mean(error[1])), 3) == 1.808
    assert round(float(np.mean(random[1])), 3) == 1.030
    assert ledger.claim("C6.2-2").contradicts


def test_printed_ratios_are_those_of_the_printed_tables_and_none_is_left_out(ledger: Ledger) -> None:
    counted = 0
    for claim in ledger.claims:
        for part in claim.parts:
            own = _printed_ratios(ledger, claim.rests_on, part)
            found = own or _printed_ratios(ledger, tuple(entry.id for entry in ledger.entries), part)
            if found:
                assert any(part.printed == pytest.approx(ratio, abs=6e-4) for ratio in found), claim.id
                counted += 1
            elif part.measure != "length_change":
                assert part.printed is None, claim.id
    assert counted == 31


def test_the_lengths_printed_lie_as_far_apart_as_claimed(ledger: Ledger) -> None:
    original, updated, again = (np.log(row.printed) for row in ledger.entry("table-6.2").rows)
    near, far = (float(np.sqrt(np.mean((other - original) ** 2))) for other in (updated, again))
    part = ledger.claim("C6.1.1-3").parts[0]
    assert part.printed == pytest.approx(near / far, abs=6e-4)
    assert (round(near, 3), round(far, 2)) == (0.072, 1.93)


def test_ambiguities_are_all_there_and_each_matters_somewhere(ledger: Ledger) -> None:
    assert [one.id for one in ledger.ambiguities] == [f"R{i}" for i in range(1, 14)]
    assert {id for entry in ledger.entries for id in entry.ambiguous} == {
        one.id for one in ledger.ambiguities
    }


def test_only_planned_runs_are_named(ledger: Ledger) -> None:
    beyond = {name for name in ledger.runs() if name.startswith(("DA_", "DC_", "DE_", "DU_", "R1", "M"))}
    assert set(ledger.runs()) - beyond == PLANNED
    assert {"A1:linear", "A1:identified_measured", "Q4:nominal"} <= set(ledger.sources())


def test_every_arm_table_carries_the_lines_that_say_what_its_numbers_mean(ledger: Ledger) -> None:
    lines = {"B0", "B1", "B2", "A1:linear", "A1:identified", "A1:identified_measured"}
    errors = [entry for entry in ledger.entries if entry.id.startswith("table") and entry.measure == "error"]
    assert len(errors) == 10
    for entry in errors:
        assert lines <= set(entry.lines), entry.id
        assert {"DP1", "DP3"} <= set(entry.beside), entry.id


def test_unknown_ids_are_answered_with_the_nearest(ledger: Ledger) -> None:
    with pytest.raises(UsageError, match=r"no claim C6\.2-33.*Did you mean .*C6\.2-3"):
        ledger.claim("C6.2-33")
    with pytest.raises(UsageError, match=r"no figure or table table-6\.13.*table-6\.1"):
        ledger.entry("table-6.13")


PAIR = 'a = "A1", b = "A5"'
"""Of the only part of C6.2-2."""
ALIAS = 'alias_of = ["C6.4-5"]'
"""Of C7-7."""
RISES = '{ statistic = "rises", claim = "less", measure = "error", a = "A1", at = [1, 2] }'
BROKEN_CLAIMS = [
    ('id = "C6.2-2"', 'id = "C6.2-2"\ncolour = "red"', "unknown field `colour`.*C6.2-2"),
    (PAIR, f'{PAIR}, colour = "red"', "unknown field `colour`.*C6.2-2"),
    (f'"ratio", claim = "less", measure = "error", {PAIR}', f'"ratios", {PAIR}', "'ratios'.*C6.2-2"),
    (f'"ratio", claim = "less", measure = "error", {PAIR}', f'"spread", {PAIR}', "`claim`.*C6.2-2"),
    (PAIR, 'a = "A1"', "b missing.*C6.2-2, part 1"),
    (PAIR, f"{PAIR}, bound = 2.0", "has bound, which ratio does not use.*C6.2-2"),
    (PAIR, 'a = "A1", b = "a five"', "'a five', which is no run.*C6.2-2"),
    (f'measure = "error", {PAIR}', f'measure = "eror", {PAIR}', "'eror'.*C6.2-2.*mean error"),
    ('id = "C6.2-3"', 'id = "C6.2-2"', "C6.2-2 stands there 2 times"),
    (ALIAS, 'alias_of = ["C6.4-6"]', "alias of C6.4-6, itself an alias.*C7-7"),
    (ALIAS, 'alias_of = ["C6.4-55"]', "no claim C6.4-55.*C7-7.*C6.4-5"),
    (ALIAS, "", "alias of nothing.*C7-7"),
    (ALIAS, f"{ALIAS}\npart = [{RISES}]", "one of parts, alias_of and untestable.*C7-7"),
    ('rests_on = ["figure-5.2"]', 'rests_on = ["figure-5.9"]', "no figure or table figure-5.9.*C5.2-1b"),
    ("[[claim]]", "[[claims]]", "'claims' is missing, or not expected here"),
    ('id = "CA-1"', "id = CA-1", "cannot be read"),
]
BROKEN_TABLES = [
    ('id = "figure-6.18"', 'id = "figure-6.17"', "figure-6.17 stands there 2 times"),
    ('id = "figure-6.18"', 'id = "figure-6.19"', "no figure or table figure-6.19"),
    ("[0.9650, 1.8155,", "[1.8155,", "3 numbers for 4 columns in 'Downsampling'.*table-6.9"),
    ('"R13"]', '"R14"]', "no ambiguity R14.*table-6.9"),
    ('kind = "table"', 'kind = "tableau"', "'tableau'.*table-6.1"),
]


@pytest.mark.parametrize(("old", "new", "message"), BROKEN_CLAIMS)
def test_wrong_claims_are_refused_with_file_and_id(tmp_path: Path, old: str, new: str, message: str) -> None:
    _broken(tmp_path, "claims.toml", old, new)
    with pytest.raises(UsageError, match=message) as refused:
        load_ledger(tmp_path)
    assert refused.value.where.startswith("claims.toml")
    assert refused.value.next_step


@pytest.mark.parametrize(("old", "new", "message"), BROKEN_TABLES)
def test_wrong_tables_are_refused_with_file_and_id(tmp_path: Path, old: str, new: str, message: str) -> None:
    _broken(tmp_path, "tables.toml", old, new)
    with pytest.raises(UsageError, match=message) as refused:
        load_ledger(tmp_path)
    assert refused.value.where.startswith("tables.toml")


def test_a_missing_entry_and_a_missing_file_are_said(tmp_path: Path) -> None:
    tables = (HERE / "tables.toml").read_text(encoding="utf-8").split("[[entry]]")
    kept = "[[entry]]".join(block for block in tables if 'id = "table-6.7"' not in block)
    (tmp_path / "claims.toml").write_bytes((HERE / "claims.toml").read_bytes())
    (tmp_path / "tables.toml").write_text(kept, encoding="utf-8")
    (tmp_path / "beyond.toml").write_bytes((HERE / "beyond.toml").read_bytes())
    with pytest.raises(UsageError, match=r"no entry for table-6\.7.*tables\.toml"):
        load_ledger(tmp_path)
    (tmp_path / "claims.toml").unlink()
    with pytest.raises(UsageError, match=r"cannot be read.*claims\.toml"):
        load_ledger(tmp_path)


def _broken(folder: Path, file: str, old: str, new: str) -> None:
    """Both files in `folder`, with the first `old` of one of them replaced."""
    for name in ("claims.toml", "tables.toml", "beyond.toml"):
        text = (HERE / name).read_text(encoding="utf-8")
        if name == file:
            assert old in text
            text = text.replace(old, new, 1)
        (folder / name).write_text(text, encoding="utf-8")


def _row(ledger: Ledger, entry: str, label: str) -> tuple[str, tuple[float, ...]]:
    """Run and printed numbers of the row whose label begins so."""
    (row,) = (row for row in ledger.entry(entry).rows if row.label.startswith(label))
    return row.run, row.printed


def _printed_ratios(ledger: Ledger, entries: tuple[str, ...], part: Part) -> list[float]:
    """M_a / M_b where the part ends, of every pair of rows that tables print of them."""
    if part.statistic not in ("ratio", "ratio_each"):
        return []
    last = part.at[-1:] if part.statistic == "ratio_each" else part.at
    printed: dict[str, list[float]] = {part.a: [], part.b: []}
    for table in map(ledger.entry, entries):
        if (table.measure, table.at) == (part.measure, last):
            for row in table.rows:
                if row.printed and row.run in printed:
                    numbers = dict(zip(table.columns, row.printed, strict=False))
                    numbers["mean"] = float(np.mean(row.printed))
                    printed[row.run].append(numbers[part.part])
    return [a / b for a in printed[part.a] for b in printed[part.b]]


def test_claims_plan_as_many_seeds_as_the_run_with_the_fewest(ledger: Ledger) -> None:
    for claim in ledger.claims:
        if not claim.untestable:
            assert claim.seeds == min(catalogue()[run].seeds for run in runs_of(claim.id)), claim.id
