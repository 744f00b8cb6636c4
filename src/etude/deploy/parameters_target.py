"""`etude export --to parameters`: physical constants that logs tell, each with its interval, as tables."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from etude._runtime.options import taken
from etude.abilities import SupportsParameters
from etude.errors import UsageError
from etude.logs.readers.cells import text_cell
from etude.protocols import Kind
from etude.types import Delivered, Log, PhysicalParameter, Samples

TABLE, FACTS = "parameters.csv", "parameters.json"
HEADER = "parameter,unit,value,lower,upper,known,set"


@dataclass(frozen=True)
class ParametersOptions:
    """What the campaign supplies."""

    samples: Samples
    logs: Sequence[Log]
    config: Any
    model_hash: str = ""


class Parameters:
    """The target (`protocols.Target`); the robot's kind knows its constants (`SupportsParameters`)."""

    needs = ("samples", "logs", "config")

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:  # noqa: ARG002
        """Both tables. UsageError: the kind tells no constants, or unknown options."""
        if not isinstance(kind, SupportsParameters):
            raise UsageError(
                f"robots of the kind '{kind.name}' have no parameters to report",
                next_step="Export the model itself: --to c.",
            )
        given = taken(options, ParametersOptions, "parameters")
        found = kind.parameters(spec, given.config, given.samples, given.logs)
        rows = [_facts(own) for own in found]
        files = {TABLE: _table(found).encode(), FACTS: (json.dumps(rows, indent=1) + "\n").encode()}
        return Delivered(files, tuple(map(_sentence, found)), {"parameters": rows})


PARAMETERS = Parameters()


def _facts(own: PhysicalParameter) -> dict[str, Any]:
    """With None for what logs do not tell: JSON has no NaN."""
    return {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in asdict(own).items()}


def _settings(own: PhysicalParameter) -> str:
    return "; ".join(f"{name} = {value}" for name, value in own.settings.items())


def _sentence(own: PhysicalParameter) -> str:
    if math.isnan(own.value):
        return f"{own.name}: {own.known}."
    unit = "" if own.unit == "1" else f" {own.unit}"
    settings = f": {_settings(own)}" if own.settings else ""
    known = "" if own.known == "measured" else f" ({own.known})"
    return f"{own.name} {own.value:.4g}{unit} [{own.lower:.4g}, {own.upper:.4g}]{known}{settings}."


def _table(found: Sequence[PhysicalParameter]) -> str:
    lines = [HEADER]
    for own in found:
        numbers = ["" if math.isnan(v) else repr(v) for v in (own.value, own.lower, own.upper)]
        texts = [own.name, own.unit, *numbers, own.known, _settings(own)]
        lines.append(",".join(map(text_cell, texts)))
    return "\n".join(lines) + "\n"
