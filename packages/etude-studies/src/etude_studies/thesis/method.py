"""Somebody's own model, kernel or criterion in the place of the one in a run, on the same seeds."""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from etude import plugins
from etude.errors import UsageError
from etude_studies.spec import HASH_LENGTH
from etude_studies.thesis.arm_runs import ARM_RUNS, MINIATURE, arm_spec
from etude_studies.thesis.catalogue import Run

Part = Literal["kernel", "model", "criterion"]
TAKE_A_KERNEL = ("thesis_dictionary_error", "thesis_dictionary_variance", "exact")
"""Members that take any kernel; a sparse spectrum stands for the squared exponential alone."""


def part_of(method: str) -> Part:
    """What "module:attribute" names: a member has `restore`, a kernel takes columns and commands, a criterion
    an output, a batch and gains.

    Raises:
        UsageError: it cannot be loaded, or is none of these.
    """
    if not plugins.FULL_NAME.fullmatch(method):
        raise UsageError(
            f"{method!r} is no module:attribute",
            where="--method",
            next_step="Name the function that makes your kernel or model, such as my_kernels:posture.",
        )
    attribute = plugins.named_in_full(method)
    if hasattr(attribute, "restore"):
        return "model"
    takes = len(_arguments(attribute))
    if takes == 3 or hasattr(attribute, "needs"):
        return "criterion"
    if takes == 2:
        return "kernel"
    raise UsageError(
        f"{method} takes {takes} arguments, so it is neither a kernel (columns, commands), nor a criterion "
        "(output, batch, gain), nor a member with restore",
        where="--method",
        next_step="See docs/plugins.md.",
    )


def with_method(run: Run, method: str) -> Run | None:
    """The run with that method in the place of its own; None where it has no such place."""
    runs = {**ARM_RUNS, **MINIATURE}
    if run.name not in runs:
        return None
    settings = _exchanged(runs[run.name][1], method, part_of(method))
    if settings is None:
        return None
    settings["source"] = _digest(method)
    name = f"{run.name}+{method.replace(':', '.')}"
    return replace(run, name=name, what=f"{run.what}; with {method}", spec=partial(arm_spec, settings))


def _exchanged(settings: Mapping[str, Any], method: str, part: Part) -> dict[str, Any] | None:
    model = dict(settings.get("model", {}))
    if part == "criterion":
        if settings.get("motions") != "designed":
            return None
        return {**settings, "design": {**settings.get("design", {}), "criterion": method}}
    if part == "model":
        return {**settings, "model": {**model, "process": method}}
    if model.get("process") not in TAKE_A_KERNEL:
        return None
    return {**settings, "model": {**model, "kernel": method}}


def _digest(method: str) -> str:
    """Of the module that the method stands in, as it is now."""
    path = importlib.import_module(method.partition(":")[0]).__file__
    return "" if path is None else hashlib.sha256(Path(path).read_bytes()).hexdigest()[:HASH_LENGTH]


def _arguments(function: Any) -> list[inspect.Parameter]:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    plain = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [
        parameter
        for parameter in parameters
        if parameter.kind in plain and parameter.default is inspect.Parameter.empty
    ]
