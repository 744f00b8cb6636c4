"""Results that nobody measured, of every run that claims and tables name, from formulas."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache

import numpy as np
import polars as pl

from etude_studies.collected import Results
from etude_studies.site.numbers import figure_of
from etude_studies.thesis.ledger import Ledger, load_ledger
from etude_studies.thesis.parts import parts_read
from etude_studies.thesis.verdicts import Verdict, judge

JOINTS = ("waist", "shoulder", "elbow", "wrist")
SEEDS = 8
MISSING = ("O1", "L1", "Y2", "Y3", "Y4", "X11", "DP4")
"""Runs left out, so that pages show what is not run yet."""
LEVELS = {
    "B0": 3.2,
    "B1": 0.07,
    "B2": 1.3,
    "A5": 1.1,
    "A7": 0.95,
    "S1": 1.5,
    "S2": 1.2,
    "Q4": 1.3,
    "DP3": 0.4,
}
TRACED = {"A1t": (6,), "A7t": (6,), "S1t": (4, 6), "S2t": (4,), "S9t": (6,), "P2t": (2, 5)}
Figure = tuple[str, str, str, str, int]
"""Source, measure, test, part, k."""


def made_up_results(ledger: Ledger, seeds: int = 20, *, without: Iterable[str] = MISSING) -> Results:
    """Everything that the ledger asks for, but for the runs `without`."""
    left_out, by_run = set(without), dict[str, list[tuple[object, ...]]]()
    for figure in sorted(_asked(ledger)):
        run, _, model = figure[0].partition(":")
        if run not in left_out:
            by_run.setdefault(run, []).extend(_rows(model, figure, seeds))
    for name, after in TRACED.items():
        by_run.setdefault(name, []).extend(_traces(name, after))
    tables = {run: _table(rows) for run, rows in by_run.items()}
    return Results(tables, {run: _made(run, seeds) for run in tables})


def level(source: str, part: str, k: int) -> float:
    """What the numbers of a source lie about."""
    run = source.partition(":")[0]
    learned = 1.0 if run.startswith("B") else 0.9 + 1.4 * 0.6**k
    joint = {"wrist": 1.5, "waist": 0.8}.get(part, 1.0)
    beside = {"linear": 1.1, "identified": 0.9, "identified_measured": 0.1, "nominal": 1.6, "faded": 1.05}
    return LEVELS.get(run, 1.0) * learned * joint * beside.get(source.partition(":")[2], 1.0)


def _asked(ledger: Ledger) -> set[Figure]:
    found: set[Figure] = set()
    for entry in ledger.entries:
        for source in entry.sources:
            rows = [row for row in entry.rows if row.run == source]
            at = {k for row in rows for k in row.at} | set(entry.at) | ({4} if source == "A1" else set())
            tests = {entry.test} | ({"common", "moves"} if entry.test == "fourier" else set())
            for column in entry.columns:
                measure, part = figure_of(entry, column)
                counts = range(1, max(at) + 1) if entry.kind == "table" and measure == "error" else at
                found |= {(source, measure, test, part, k) for k in counts for test in tests}
    for claim in ledger.claims:
        for part in claim.parts:
            for source in part.sources:
                for name in parts_read(part):
                    counts = {*part.at, *part.against}
                    found |= {(source, part.measure, part.test, name, k) for k in counts}
    return found


def _rows(model: str, figure: Figure, seeds: int) -> Iterator[tuple[object, ...]]:
    source, measure, test, part, k = figure
    rng = np.random.default_rng([zlib.crc32("|".join(map(str, figure)).encode()), 1])
    shared = np.random.default_rng(zlib.crc32(f"{measure}{test}{part}{k}".encode())).normal(size=seeds)
    values = level(source, part, k) * np.exp(0.2 * shared + 0.15 * rng.normal(size=seeds))
    for seed, value in enumerate(values):
        yield seed, k, test, model, part, measure, float(value)


def _traces(name: str, counts: Iterable[int]) -> Iterator[tuple[object, ...]]:
    """A sine and a late one at 10 Hz."""
    t = np.arange(600) / 10.0
    curves = {
        "q_des": 30.0 * np.sin(0.3 * t),
        "q": 29.0 * np.sin(0.3 * t - 0.05),
        "u": 40.0 * np.cos(0.3 * t),
        "u_ff": 38.0 * np.cos(0.3 * t),
    }
    for after in counts:
        for k, time in enumerate(t):
            yield 0, k, f"after {after}", "", "mean", "t", float(time)
            for measure, values in curves.items():
                for joint in JOINTS:
                    yield 0, k, f"after {after}", "", joint, measure, float(values[k])


def _table(rows: list[tuple[object, ...]]) -> pl.DataFrame:
    names = ("seed", "k", "test", "model", "part", "measure", "value")
    kinds = (pl.Int32, pl.Int32, pl.String, pl.String, pl.String, pl.String, pl.Float32)
    return pl.DataFrame(rows, schema=dict(zip(names, kinds, strict=True)), orient="row")


def _made(run: str, seeds: int) -> Mapping[str, object]:
    return {
        "function": "made_up:run",
        "settings": {"run": run, "model": {"steps": 25, "name": "<b>"}},
        "hashes": {str(seed): f"{zlib.crc32(f'{run}{seed}'.encode()):020x}" for seed in range(seeds)},
        "commit": "0" * 40,
        "versions": {"etude": "0.1.0", "numpy": "2.0"},
        "machine": {"cpu": "made up", "cores": "2", "system": "Linux"},
        "cpu_s": 12.5,
        "wall_s": 13.0,
        "date": "2025-01-01T00:00:00+00:00",
    }


SHOWN = (
    "figure-2.3",
    "figure-5.1",
    "table-6.2",
    "table-6.9",
    "figure-6.10",
    "table-6.10",
    "table-6.11",
    "figure-6.11",
    "figure-6.13",
    "beyond-methods-arm",
)


def small_ledger() -> Ledger:
    """Some entries of the real one, claims that rest on them alone, and two that no run answers."""
    whole = load_ledger()
    entries = tuple(entry for entry in whole.entries if entry.id in SHOWN)
    claims = [claim for claim in whole.claims if claim.rests_on and {*claim.rests_on} <= {*SHOWN}]
    claims += [claim for claim in whole.claims if claim.untestable and claim not in claims]
    known = {claim.id for claim in claims}
    kept = tuple(claim for claim in whole.claims if claim in claims and {*claim.alias_of} <= known)
    return Ledger(kept, entries, whole.ambiguities)


@cache
def small_study() -> tuple[Ledger, Results, dict[str, Verdict]]:
    """A ledger, results of eight seeds, and the verdicts on them."""
    own = small_ledger()
    results = made_up_results(own, SEEDS)
    return own, results, judge(own, results, planned=dict.fromkeys(results.runs, SEEDS))
