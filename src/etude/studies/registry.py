"""Which benches and studies there are: one row each."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from etude.errors import UsageError

# name -> "module:function"; the function takes json and seed (a bench perhaps quick and pythons, a study
# also seeds and folder), and prints a table or the line of `rows_json`
BENCHES = {"gp": "etude.studies.bench_gp:run", "models": "etude.studies.bench_models:run"}
STUDIES = {"arm": "etude.studies.arm:run", "online": "etude.studies.online:run"}


def run_bench(name: str, *, json: bool, seed: int, quick: bool = False, pythons: Sequence[Path] = ()) -> None:
    """Runs the bench of that name, which prints its rows. UsageError if there is none.

    `quick` goes to benches that know a shorter form, `pythons`, other interpreters, to those that use them;
    UsageError to one that does not.
    """
    _run("bench", BENCHES, name, json=json, seed=seed, quick=quick, pythons=pythons)


def run_study(name: str, *, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs the study of that name, which prints its rows. UsageError if there is none."""
    _run("study", STUDIES, name, json=json, seed=seed, seeds=seeds, folder=folder / name)


def _run(kind: str, registry: Mapping[str, str], name: str, **options: Any) -> None:
    if name not in registry:
        known = ", ".join(sorted(registry)) or "none yet"
        raise UsageError(f"there is no {kind} {name!r}", next_step=f"Known: {known}.")
    call(registry[name], **options)


def call(
    place: str, *arguments: Any, quick: bool = False, pythons: Sequence[Path] = (), **options: Any
) -> Any:
    """Calls "module:function"; `quick` and `pythons` are passed on only to a function that takes them."""
    module, name = place.split(":")
    function = getattr(importlib.import_module(module), name)
    taken = inspect.signature(function).parameters
    if "quick" in taken:
        options["quick"] = quick
    if "pythons" in taken:
        options["pythons"] = pythons
    elif pythons:
        raise UsageError("only `etude bench gp` looks into other interpreters", where="--python")
    return function(*arguments, **options)
