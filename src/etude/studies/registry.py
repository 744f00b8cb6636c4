"""Which benches and studies there are: one row each."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from etude.errors import UsageError

# name -> "module:function"; the function takes json and seed (a bench perhaps quick and logs, a study also
# seeds and folder), and prints a table or the line of `rows_json`
BENCHES = {"gp": "etude.studies.bench_gp:run", "models": "etude.studies.bench_models:run"}
STUDIES = {"arm": "etude.studies.arm:run"}


def run_bench(name: str, *, json: bool, seed: int, quick: bool = False, logs: Path | None = None) -> None:
    """Runs the bench of that name, which prints its rows. UsageError if there is none.

    `quick` goes to benches that know a shorter form, `logs` to those that read recordings from a folder.
    """
    if logs is not None and name in BENCHES and "logs" not in _parameters(BENCHES[name]):
        raise UsageError(f"bench {name!r} reads no recordings", next_step="Leave --logs out.")
    _run("bench", BENCHES, name, json=json, seed=seed, quick=quick, logs=logs)


def run_study(name: str, *, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs the study of that name, which prints its rows. UsageError if there is none."""
    _run("study", STUDIES, name, json=json, seed=seed, seeds=seeds, folder=folder / name)


def _run(kind: str, registry: Mapping[str, str], name: str, **options: Any) -> None:
    if name not in registry:
        known = ", ".join(sorted(registry)) or "none yet"
        raise UsageError(f"there is no {kind} {name!r}", next_step=f"Known: {known}.")
    call(registry[name], **options)


OPTIONAL = ("quick", "logs")


def call(place: str, *arguments: Any, **options: Any) -> Any:
    """Calls "module:function"; `OPTIONAL` ones are passed on only to a function that takes them."""
    known = _parameters(place)
    taken = {key: value for key, value in options.items() if key not in OPTIONAL or key in known}
    return _function(place)(*arguments, **taken)


def _function(place: str) -> Any:
    module, name = place.split(":")
    return getattr(importlib.import_module(module), name)


def _parameters(place: str) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(_function(place)).parameters
