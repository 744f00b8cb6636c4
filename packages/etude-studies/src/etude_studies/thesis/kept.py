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
from etude_studies.thesis.catalogue import Run
from etude_studies.thesis.choosing import ledger
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
    """Verdicts on every claim from as many seeds as there are."""
    return judge(ledger(), results, planned=planned_seeds(results))


def planned_seeds(results: Results) -> dict[str, int]:
    """Seeds by run: as many as are there; how many there should be says the catalogue."""
    counts = {run: len(results.seeds(run)) for run in results.runs}
    return {run: count for run, count in counts.items() if count > 1}


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
                own = results.tables[run.name].filter(pl.col("seed") == seed).drop("seed")
                write_result(path, own, spec, _made(results, run.name, seed))
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
    found = Results.load(folder)
    (folder / VERDICTS).write_text(to_json(verdicts_of(found)), encoding="utf-8")
    return {name: len(specs) for name, specs in present.items()}


def so_far(runs: Sequence[Run], store: Path) -> Results:
    """The committed results; of runs that the store has seeds of, those instead."""
    present = {run.name: _there(run, store) for run in runs}
    with TemporaryDirectory() as folder:
        collect(store, {name: specs for name, specs in present.items() if specs}, Path(folder))
        return kept_results().replaced_by(Results.load(Path(folder)))


def _there(run: Run, store: Path) -> list[Spec]:
    """Seeds in a row from 0 on, as far as the store has them, and not beyond what was planned."""
    return [spec for spec in run.specs(range(run.seeds)) if result_path(store, spec).exists()]


def _made(results: Results, run: str, seed: int) -> Made:
    whole = results.made(run)
    own = next(batch for batch in whole["batches"] if seed in batch["seeds"])
    count = len(results.seeds(run))
    return Made(
        commit=own["commit"],
        versions=own["versions"],
        machine=own["machine"],
        cpu_s=round(whole["cpu_s"] / count, 1),
        wall_s=round(whole["wall_s"] / count, 1),
        date=whole["date"],
    )
