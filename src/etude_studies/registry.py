"""Which benches and studies there are: one row each."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from etude.errors import UsageError

# name -> "module:function"; the function takes json and seed (a bench perhaps one of OPTIONAL, a study also
# seeds and folder), and prints a table or the line of `rows_json`
BENCHES = {
    "crazyflie": "etude_studies.crazyflie:run",
    "gp": "etude_studies.bench_gp:run",
    "models": "etude_studies.bench_models:run",
    "quadrotor": "etude_studies.bench_quadrotor:run",
}
STUDIES = {
    "arm": "etude_studies.arm:run",
    "online": "etude_studies.online:run",
    "quadrotor": "etude_studies.flight_orders:run",
    "quadrotor_loop": "etude_studies.flight_loop:run",
}


def run_bench(
    name: str,
    *,
    json: bool,
    seed: int,
    quick: bool = False,
    pythons: Sequence[Path] = (),
    logs: Path | None = None,
) -> None:
    """Runs the bench of that name, which prints its rows. UsageError if there is none.

    `quick` goes to benches that know a shorter form, `pythons`, other interpreters, and `logs`, a folder of
    recordings, to those that use them; UsageError to one that does not.
    """
    known = _parameters(BENCHES[name]) if name in BENCHES else {}
    for option, given in (("pythons", pythons), ("logs", logs)):
        if given and name in BENCHES and option not in known:
            flag = "--python" if option == "pythons" else "--logs"
            raise UsageError(f"bench {name!r} has no use for {flag}", where=flag, next_step="Leave it out.")
    _run("bench", BENCHES, name, json=json, seed=seed, quick=quick, pythons=pythons, logs=logs)


def run_study(name: str, *, json: bool, seed: int, seeds: int, folder: Path) -> None:
    """Runs the study of that name, which prints its rows. UsageError if there is none."""
    _run("study", STUDIES, name, json=json, seed=seed, seeds=seeds, folder=folder / name)


def _run(kind: str, registry: Mapping[str, str], name: str, **options: Any) -> None:
    if name not in registry:
        known = ", ".join(sorted(registry)) or "none yet"
        raise UsageError(f"there is no {kind} {name!r}", next_step=f"Known: {known}.")
    call(registry[name], **options)


OPTIONAL = ("quick", "pythons", "logs")


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
