"""Results on disk: whole and one's own, or refused; and the collections that claims look figures up in."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from etude.errors import DataError
from etude_studies.collected import Results, collect
from etude_studies.made import Made
from etude_studies.measured import Measured, comparable, measured_table
from etude_studies.run_file import read_made, read_result, result_path, write_result
from etude_studies.spec import Spec

MADE = Made(
    "abc123", {"etude": "0.1.0", "numpy": "2.0"}, {"cpu": "Z80", "cores": "1"}, 1.5, 2.0, "2026-01-01"
)
PARTS = ("waist", "shoulder", "mean")


def spec(seed: int, run: str = "A1") -> Spec:
    return Spec("m:f", {"run": run, "rounds": 2}, seed)


def figures(seed: int) -> list[Measured]:
    """error of k, part and model as one number that tells which it is."""
    found = [
        Measured(k, test, model, part, "error", 1000 * seed + 100 * k + 10 * len(test) + len(model) + i / 8)
        for k in range(3)
        for test in ("fourier", "common")
        for model in ("", "linear")
        for i, part in enumerate(PARTS)
    ]
    return [*found, Measured(2, "", "", "mean", "cpu_train", 0.25 * seed)]


def store_of(folder: Path, seeds: range, run: str = "A1") -> list[Spec]:
    specs = [spec(seed, run) for seed in seeds]
    for own in specs:
        table = measured_table(figures(own.seed), "m:f")
        write_result(result_path(folder, own), table, own, MADE._replace(commit=f"c{own.seed // 2}"))
    return specs


def test_what_is_written_is_read(tmp_path: Path) -> None:
    (own,) = store_of(tmp_path, range(1))
    path = result_path(tmp_path, own)
    table = read_result(path, own)
    assert path.name == f"{own.hash}.parquet"
    assert table.schema == {
        "k": pl.Int32, "test": pl.String, "model": pl.String, "part": pl.String, "measure": pl.String,
        "value": pl.Float32,
    }  # fmt: skip
    assert sorted(table.iter_rows()) == sorted(tuple(row) for row in figures(0))
    assert read_made(path) == MADE._replace(commit="c0")
    kept = pl.read_parquet_metadata(path)
    assert (kept["hash"], kept["spec"]) == (own.hash, own.canonical())
    assert set(comparable(table)["measure"]) == {"error"}


def test_the_order_of_measuring_does_not_matter() -> None:
    assert measured_table(figures(3), "").equals(measured_table(figures(3)[::-1], ""))


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    (own,) = store_of(tmp_path, range(1))
    path = result_path(tmp_path, own)
    whole = path.read_bytes()
    for length in (*range(0, len(whole), 97), len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DataError, match=path.name):
            read_result(path, own)
    path.unlink()
    with pytest.raises(DataError, match=path.name):
        read_result(path, own)


def test_a_result_of_another_run_is_refused(tmp_path: Path) -> None:
    first, second = store_of(tmp_path, range(2))
    with pytest.raises(DataError, match=f"of another run: {first.hash}, not {second.hash}"):
        read_result(result_path(tmp_path, first), second)


def test_figures_are_found_by_seed(tmp_path: Path) -> None:
    runs = {"A1": store_of(tmp_path, range(3)), "Q4": store_of(tmp_path, range(2, 4), "Q4")}
    assert collect(tmp_path, runs, tmp_path / "kept") == {"A1": (), "Q4": ()}
    results = Results.load(tmp_path / "kept")
    assert results.runs == ("A1", "Q4")
    assert (results.seeds("A1"), results.seeds("Q4"), results.seeds("Z9")) == ((0, 1, 2), (2, 3), ())
    assert results.values("A1", "error", 1, "fourier", "mean") == {
        0: 170.25, 1: 1170.25, 2: 2170.25,
    }  # fmt: skip
    assert results.values("Q4:linear", "error", 2, "common", "waist") == {2: 2266.0, 3: 3266.0}
    assert results.values("A1", "cpu_train", 2) == {0: 0.0, 1: 0.25, 2: 0.5}
    for nothing in (("Z9", "error", 1), ("A1:none", "error", 1), ("A1", "none", 1), ("A1", "error", 9)):
        assert results.values(*nothing, test="fourier") == {}


def test_where_they_come_from_is_summed_up(tmp_path: Path) -> None:
    collect(tmp_path, {"A1": store_of(tmp_path, range(3))}, tmp_path / "kept")
    made = Results.load(tmp_path / "kept").made("A1")
    assert (made["commit"], made["cpu_s"], made["wall_s"]) == ("c0, c1", 4.5, 6.0)
    assert made["machine"] == {"cpu": "Z80", "cores": "1"}
    assert [(own["commit"], own["seeds"]) for own in made["batches"]] == [("c0", [0, 1]), ("c1", [2])]
    assert made["hashes"] == {str(seed): spec(seed).hash for seed in range(3)}
    assert made["settings"] == {"run": "A1", "rounds": 2}


def test_what_is_missing_is_said_and_nothing_is_lost(tmp_path: Path) -> None:
    specs = store_of(tmp_path, range(3))
    kept = tmp_path / "kept"
    collect(tmp_path, {"A1": specs}, kept)
    before = (kept / "A1.parquet").read_bytes()
    collect(tmp_path, {"A1": specs[::-1]}, kept)
    assert (kept / "A1.parquet").read_bytes() == before
    assert collect(tmp_path / "nowhere", {"A1": specs}, kept) == {"A1": tuple(specs)}
    assert (kept / "A1.parquet").read_bytes() == before
    path = result_path(tmp_path, specs[1])
    path.write_bytes(path.read_bytes()[:200])
    assert collect(tmp_path, {"A1": specs}, kept) == {"A1": (specs[1],)}
    assert Results.load(kept).seeds("A1") == (0, 2)


def test_one_seed_has_one_result(tmp_path: Path) -> None:
    both = [*store_of(tmp_path, range(2)), *store_of(tmp_path, range(1), "A2")]
    with pytest.raises(DataError, match="a seed of A1 stands there twice"):
        collect(tmp_path, {"A1": both}, tmp_path / "kept")


def test_a_damaged_collection_is_refused(tmp_path: Path) -> None:
    collect(tmp_path, {"A1": store_of(tmp_path, range(2))}, tmp_path)
    path = tmp_path / "A1.parquet"
    whole = path.read_bytes()
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "A1.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"A1\.parquet"):
        Results.load(kept)
    (kept / "A1.parquet").write_bytes(whole)
    assert json.loads(pl.read_parquet_metadata(kept / "A1.parquet")["made"])["function"] == "m:f"
    pl.DataFrame({"a": [1]}).write_parquet(kept / "B1.parquet")
    with pytest.raises(DataError, match="of format unknown"):
        Results.load(kept)


def test_the_same_results_make_the_same_file(tmp_path: Path) -> None:
    specs = store_of(tmp_path, range(2))
    for name in ("one", "two"):
        collect(tmp_path, {"A1": specs}, tmp_path / name)
    assert (tmp_path / "one/A1.parquet").read_bytes() == (tmp_path / "two/A1.parquet").read_bytes()
