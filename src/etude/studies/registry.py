"""Which benches and studies there are: one row each."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from etude.errors import UsageError

# name -> "module:function"; the function takes json and seed (a bench perhaps quick, a study also seeds and
# folder), and prints a table or the line of `rows_json`
BENCHES = {
    "gp": "etude.studies.bench_gp:run",
    "models": "etude.studies.bench_models:run",
    "quadrotor": "etude.studies.bench_quadrotor:run",
}
STUDIES = {
    "arm": "etude.studies.arm:run",
    "quadrotor": "etude.studies.flight_orders:run",
    "quadrotor_loop": "etude.studies.flight_loop:run",
}


def run_bench(name: str, *, json: bool, seed: int, quick: bool = False) -> None:
    """Runs the bench of that name, which prints its rows. UsageError if there is none.

    `quick` goes to benches that know a shorter form.
    """
    _run("bench", BENCHES, name, json=json, seed=seed, quick=quick)


def run_study(name: str, *, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs the study of that name, which prints its rows. UsageError if there is none."""
    _run("study", STUDIES, name, json=json, seed=seed, seeds=seeds, folder=folder / name)


def _run(kind: str, registry: Mapping[str, str], name: str, **options: Any) -> None:
    if name not in registry:
        known = ", ".join(sorted(registry)) or "none yet"
        raise UsageError(f"there is no {kind} {name!r}", next_step=f"Known: {known}.")
    call(registry[name], **options)


def call(place: str, *arguments: Any, quick: bool = False, **options: Any) -> Any:
    """Calls "module:function"; `quick` is passed on only to a function that takes it."""
    module, name = place.split(":")
    function = getattr(importlib.import_module(module), name)
    if "quick" in inspect.signature(function).parameters:
        options["quick"] = quick
    return function(*arguments, **options)
