"""`etude export --to parameters`: physical constants from logs, each with its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from etude._runtime.options import taken
from etude.abilities import SupportsParameters
from etude.errors import UsageError
from etude.protocols import Kind
from etude.types import Delivered, Log, Samples


@dataclass(frozen=True)
class ParametersOptions:
    """Options that the campaign supplies."""

    samples: Samples
    logs: Sequence[Log]
    config: Any
    model_hash: str = ""


class Parameters:
    """The target (`protocols.Target`); the robot's kind knows its constants (`SupportsParameters`)."""

    needs = ("samples", "logs", "config")

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:  # noqa: ARG002
        """The kind's constants. UsageError: the kind has none, or an option is unknown."""
        if not isinstance(kind, SupportsParameters):
            raise UsageError(
                f"robots of the kind '{kind.name}' have no parameters to report",
                next_step="Export the model itself: --to c.",
            )
        settings = taken(options, ParametersOptions, "parameters")
        return kind.parameters(spec, settings.config, settings.samples, settings.logs)


PARAMETERS = Parameters()
