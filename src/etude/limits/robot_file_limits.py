"""The [[limit]] tables of a robot file: limits from plug-ins, by name and parameters.

    [[limit]]
    kind = "my_limits:plane"    # of the group etude.limits, or module:attribute
    normal = [0.0, 0.0, 1.0]    # what the function takes by name

A kind of robot keeps the tables in its description (`read_limits`), and adds `made_limits` to its own.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from etude import plugins
from etude.errors import EtudeError, UsageError
from etude.protocols import Limit, LimitFactory, Model
from etude.toml_tables import converted, refuse_unknown
from etude.types import Margins

GROUP = "etude.limits"
KIND = "kind"
GIVEN = 3  # arguments that every function gets: spec, model, margins


@dataclass(frozen=True)
class LimitTable:
    """One table: the name of the plug-in, its parameters, and the function that makes the limit."""

    kind: str
    parameters: Mapping[str, Any] = field(hash=False)
    make: LimitFactory = field(compare=False, repr=False)

    def table(self) -> dict[str, Any]:
        """As it stands in the file."""
        return {KIND: self.kind, **self.parameters}


def read_limits(tables: Sequence[Mapping[str, Any]], where: str) -> tuple[LimitTable, ...]:
    """The tables of a robot file, checked against what their functions take; where: the file.

    Raises:
        UsageError: no such plug-in, an unknown or a missing key, a value of another type.
    """
    return tuple(_read(table, f"{where}, limit {i}") for i, table in enumerate(tables, start=1))


def made_limits(
    tables: Sequence[LimitTable],
    spec: Any,
    model: Model | None,
    margins: Margins,
    coordinates: Sequence[str] = (),
) -> tuple[Limit, ...]:
    """The limits of one robot. Arguments as of `Kind.limits`; coordinates: names for messages.

    Raises:
        UsageError: a plug-in fails, or the number of slopes is not that of the coordinates.
    """
    return tuple(_make_limit(table, spec, model, margins, tuple(coordinates)) for table in tables)


def _read(table: Mapping[str, Any], where: str) -> LimitTable:
    name = table.get(KIND)
    if not isinstance(name, str):
        raise UsageError(
            f'a limit needs {KIND} = "NAME"',
            where=where,
            next_step=f"Known: {', '.join(plugins.names(GROUP)) or 'none'}; or name it as module:attribute.",
        )
    plugins.require_known(GROUP, name, where)
    make: LimitFactory = plugins.load(GROUP, name)
    arguments = {key: value for key, value in table.items() if key != KIND}
    takes = list(inspect.signature(make).parameters.values())
    keywords = [p for p in takes if p.kind is p.KEYWORD_ONLY]
    _check_named(takes[GIVEN:], name, where)
    refuse_unknown(arguments, [p.name for p in keywords], where)
    missing = [p.name for p in keywords if p.default is p.empty and p.name not in arguments]
    if missing:
        raise UsageError(
            f"missing {', '.join(missing)}", where=where, next_step=f"{name} needs it: state each of them."
        )
    types = typing.get_type_hints(make)
    values = {key: converted(types.get(key, Any), value, key, where) for key, value in arguments.items()}
    return LimitTable(name, values, make)


def _check_named(parameters: Sequence[inspect.Parameter], name: str, where: str) -> None:
    """UsageError: parameters that a table should give stand before the `*` of the function."""
    unnamed = [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD and p.default is p.empty]
    if unnamed:
        raise UsageError(
            f"{name} takes {', '.join(unnamed)} without a * before them",
            where=where,
            next_step="Keys of a table are the arguments after *: "
            f"def limit(spec, model, margins, *, {', '.join(unnamed)}).",
        )


def _make_limit(
    table: LimitTable, spec: Any, model: Model | None, margins: Margins, coordinates: tuple[str, ...]
) -> Limit:
    from etude.limits.lipschitz import LipschitzLimit
    from etude.plugin_values import guarded  # robot files are read without these

    where, names = f"[[limit]] {table.kind}", ", ".join(coordinates)
    mend = f"Correct its table in the robot's file, or the plug-in. This robot has {names or 'no names'}."
    try:
        limit = table.make(spec, model, margins, **table.parameters)
    except EtudeError:
        raise
    except Exception as error:
        fact = f"this limit cannot be made: {type(error).__name__}: {error}"
        raise UsageError(fact, where=where, next_step=mend) from error
    required: Limit = plugins.required(limit, Limit, where)
    if isinstance(required, LipschitzLimit):
        required = replace(required, coordinates=coordinates)
    guard: Limit = guarded(required, "Limit", table.kind)
    return guard
