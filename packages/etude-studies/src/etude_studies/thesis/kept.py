"""The results that come with Étude: where they are, how they become a store again, how they are renewed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl

from etude.errors import UsageError
from etude_studies.collected import Results, collect
from etude_studies.made import Made
from etude_studies.run_file import result_path, write_result
from etude_studies.spec import Spec
from etude_studies.thesis.catalogue import Run, catalogue
from etude_studies.thesis.choosing import ledger, runs_of
from etude_studies.thesis.verdicts import Verdict, from_json, judge, to_json

FOLDER = Path(__file__).parent / "results"
VERDICTS = "verdicts.json"


@cache
def kept_results() -> Results:
    """All runs that are committed."""
    return Results.load(FOLDER)


@cache
def kept_verdicts() -> dict[str, Verdict]:
    """The verdicts on them; none where no run was committed yet."""
    path = FOLDER / VERDICTS
    return from_json(path.read_text(encoding="utf-8")) if path.exists() else {}


def verdicts_of(results: Results) -> dict[str, Verdict]:
    """Verdicts on every claim from as many seeds as there are, up to those that were planned or asked for."""
    from etude_studies.thesis.readings import EQUAL, READINGS, depending, readings

    planned, requested = planned_seeds(results), blocks()
    verdicts = judge(ledger(), results, planned=planned, blocks=requested)
    equal = [reading for reading in READINGS if reading.ambiguity == EQUAL]
    return depending(verdicts, readings(ledger(), results, planned=planned, blocks=requested, among=equal))


def planned_seeds(results: Results) -> dict[str, int]:
    """Seeds by run: as many as are there, and not beyond the catalogue's number."""
    counts = {run: len(results.seeds(run)) for run in results.runs}
    runs_by_name = catalogue()
    return {
        run: min(count, runs_by_name[run].seeds) if run in runs_by_name else count
        for run, count in counts.items()
        if count > 1
    }


def blocks() -> dict[str, int]:
    """Seeds by claim: of its block, or those that its committed verdict asks for."""
    requested = {claim: verdict.block or verdict.asks or 0 for claim, verdict in kept_verdicts().items()}
    return {claim: seeds for claim, seeds in requested.items() if seeds}


def asked_seeds() -> dict[str, int]:
    """The most seeds by run that any claim asks for."""
    most: dict[str, int] = {}
    for claim, seeds in blocks().items():
        for run in runs_of(claim):
            most[run] = max(most.get(run, 0), seeds)
    return most


def price_s(runs: Iterable[str], seeds: int, results: Results, *, more: bool = False) -> float:
    """CPU seconds of so many seeds of each run, by what the present ones took.

    Args:
        more: of those that are not there yet.
    """
    counts = [(run, len(results.seeds(run))) for run in runs]
    return float(sum(max(0, seeds - more * n) * results.made(run)["cpu_s"] / n for run, n in counts if n))


def unpack(runs: Iterable[Run], store: Path, results: Results) -> int:
    """Puts committed results back into a store, so that they are not computed again; how many."""
    done = 0
    for run in runs:
        if run.name not in results.runs:
            continue
        hashes = results.made(run.name)["hashes"]
        for seed in results.seeds(run.name):
            spec = run.spec(seed)
            path = result_path(store, spec)
            if hashes[str(seed)] == spec.hash and not path.exists():
                rows = results.tables[run.name].filter(pl.col("seed") == seed).drop("seed")
                write_result(path, rows, spec, _made(results, run.name, seed))
                done += 1
    return done


def renew(runs: Sequence[Run], store: Path, folder: Path = FOLDER) -> dict[str, int]:
    """Writes the committed results and verdicts anew from a store; seeds of each run.

    Raises:
        UsageError: the package is not a checkout that can be written to.
    """
    if not (folder.parent / "claims.toml").exists():
        raise UsageError("these are not the sources of Étude", where=str(folder), next_step="Clone it.")
    present = {run.name: _there(run, store) for run in runs}
    present = {name: specs for name, specs in present.items() if specs}
    folder.mkdir(exist_ok=True)
    collect(store, present, folder)
    results = Results.load(folder)
    (folder / VERDICTS).write_text(to_json(verdicts_of(results)), encoding="utf-8")
    return {name: len(specs) for name, specs in present.items()}


def so_far(runs: Sequence[Run], store: Path, *, more: bool = False) -> Results:
    """The committed results; of runs that the store has seeds of, those instead.

    Args:
        more: only where the store has more seeds of a run than are committed.
    """
    committed = kept_results()
    least = {run.name: len(committed.seeds(run.name)) if more else 0 for run in runs}
    present = {run.name: _there(run, store) for run in runs}
    with TemporaryDirectory() as folder:
        taken = {name: specs for name, specs in present.items() if len(specs) > least[name]}
        collect(store, taken, Path(folder))
        return committed.replaced_by(Results.load(Path(folder)))


def _there(run: Run, store: Path) -> list[Spec]:
    """Seeds from 0 on that the store has, not beyond what was planned or a claim asks for."""
    seeds = max(run.seeds, asked_seeds().get(run.name, 0))
    return [spec for spec in run.specs(range(seeds)) if result_path(store, spec).exists()]


def _made(results: Results, run: str, seed: int) -> Made:
    whole = results.made(run)
    record = next(batch for batch in whole["batches"] if seed in batch["seeds"])
    count = len(results.seeds(run))
    return Made(
        commit=record["commit"],
        versions=record["versions"],
        machine=record["machine"],
        cpu_s=round(whole["cpu_s"] / count, 1),
        wall_s=round(whole["wall_s"] / count, 1),
        date=whole["date"],
    )
