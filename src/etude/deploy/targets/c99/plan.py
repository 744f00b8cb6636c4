"""The plan of a C export, made once: the states that a model reads, their ranges, its parts with names in
C.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.abilities import SupportsStateText
from etude.deploy.model_states import IN_PYTHON, LEARN_OTHERWISE, WITHOUT_PHYSICS, labels, training_ranges
from etude.errors import UsageError
from etude.models.gp.c99 import UnwritableError
from etude.models.learned_model import LearnedModel
from etude.protocols import Candidate, Kind, Mean
from etude.types import Array, Channel, Code

WIDENED = 0.5
"""Fraction of the training range by which an input must leave it to be far outside, without deviations."""
UNBOUNDED = 1e6
"""Bound of states that no model input uses, whose range is unknown."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Parts of a model for export to C.

    Attributes:
        name: prefix in C. model, candidates: those in use. channels: what is read, in order.
        inputs: code of the feature map. means, processes: code by its function, each once.
        mean_of, process_of: the function of each candidate, "" of no mean. safe_of: of the physics that each
            fades to, "" of none.
        low, high: (N,) of the states, that the model was trained on. limit: (J,) how far commands reach.
        least, most: (J,) of commands.
        still: (N,) whether a state is the rate of another. units: (J,) of commands.
        state_text: the kind's own on its states: axes, signs.
    """

    name: str
    model: LearnedModel
    candidates: tuple[Candidate, ...]
    channels: tuple[Channel, ...]
    inputs: Code
    means: Mapping[str, Code]
    processes: Mapping[str, Code]
    mean_of: tuple[str, ...]
    process_of: tuple[str, ...]
    safe_of: tuple[str, ...]
    low: Array
    high: Array
    limit: Array
    least: Array
    most: Array
    still: tuple[bool, ...]
    units: tuple[str, ...]
    state_text: str = ""

    @property
    def parts(self) -> list[tuple[Channel, int]]:
        """Each number that is read: its channel and part."""
        return [(channel, i) for channel in self.channels for i in range(len(channel.parts))]

    @property
    def labels(self) -> list[str]:
        """Names of these numbers, as columns of logs are named."""
        return labels(self.channels)

    @property
    def memory(self) -> int:
        """Words of it: that of the inputs first, then of each mean."""
        return self.inputs.memory + sum(code.memory for code in self.means.values())

    @property
    def rate(self) -> float:
        """Hz at which it must be called, as it remembers; 0: anyhow."""
        remembered = self.model.inputs.rate if self.inputs.memory else 0.0
        return max([remembered, *(code.rate for code in self.means.values())])

    @property
    def codes(self) -> list[Code]:
        return [self.inputs, *self.means.values(), *self.processes.values()]

    @property
    def averages(self) -> bool:
        """Whether some command is an average over several candidates."""
        return any(bool(((c.weights > 0.0) & (c.weights < 1.0)).any()) for c in self.candidates)

    def operations(self, variance: bool, fade: bool = False) -> int:
        """Worst-case number of operations in one call; with fading, a call may evaluate the model twice."""
        counts = [sum(pair) if variance else pair[0] for pair in (code.operations for code in self.codes)]
        return sum(counts) * (2 if fade else 1)


C = """auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef union unsigned
void volatile
while bool main"""
CPP = """catch class delete explicit friend mutable namespace new operator private protected public
template this throw try typename using virtual"""
KEYWORDS = frozenset([*C.split(), *CPP.split()])


def identifier(name: str) -> str:
    """Valid identifier of C and C++: characters other than letters, digits and _ become _."""
    cleaned = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match(r"[A-Za-z]", cleaned):
        cleaned = f"n{cleaned}" if cleaned.startswith("_") else f"n_{cleaned}"
    return f"{cleaned}_" if cleaned.lower() in KEYWORDS else cleaned


def identifiers(names: Sequence[str]) -> list[str]:
    """Distinct identifiers of several names: equal ones get a number."""
    unique: list[str] = []
    for name in names:
        candidate, number = identifier(name), 2
        base = candidate
        while candidate.lower() in (earlier.lower() for earlier in unique):
            candidate, number = f"{base}_{number}", number + 1
        unique.append(candidate)
    return unique


def renamed(names: Sequence[str], c_names: Sequence[str]) -> list[str]:
    """A line for each name that was changed."""
    return [f"{old!r} is {new} in C" for old, new in zip(names, c_names, strict=True) if old != new]


def planned(model: LearnedModel, kind: Kind, spec: Any, name: str) -> Plan:
    """The parts of the model for export to C.

    Raises:
        UsageError: a part of it has no C, named.
    """
    prefix = identifier(name or spec.name)
    used = tuple(c for c in model.candidates if c.weights.any())
    inputs = _written(model.inputs.c(f"{prefix}_inputs"), "the inputs of this kind of robot", IN_PYTHON)
    means: dict[str, Code] = {}
    processes: dict[str, Code] = {}
    names: dict[int, str] = {}
    mean_of, process_of, safe_of = [], [], []
    for candidate in used:
        mean_of.append("" if candidate.mean is None else _mean(candidate.mean, prefix, means, names))
        process_of.append(_process(candidate, prefix, processes, names))
        behind = model.behind(candidate)
        safe_of.append("" if behind is None else _mean(behind, prefix, means, names))
    available = {channel.name: channel for channel in kind.channels(spec)}
    reads = dict.fromkeys([*inputs.reads, *(read for code in means.values() for read in code.reads)])
    channels = tuple(available[read] for read in reads)
    low, high = training_ranges(model, channels, UNBOUNDED)
    command = next(c for c in available.values() if c.role == "command")
    limit = np.asarray(kind.limit(spec), dtype=float)
    command_range = kind.expected(spec).limits.get(command.name)
    least, most = (
        (-limit, limit)
        if command_range is None
        else (np.asarray(side, dtype=float) for side in command_range)
    )
    still = tuple(bool(c.derivative_of) and c.role in ("state", "plan") for c in channels for _ in c.parts)
    return Plan(
        prefix,
        model,
        used,
        channels,
        inputs,
        means,
        processes,
        tuple(mean_of),
        tuple(process_of),
        tuple(safe_of),
        low,
        high,
        limit,
        least,
        most,
        still,
        command.units,
        kind.states_in_words if isinstance(kind, SupportsStateText) else "",
    )


def _written(code: Code | None, what: str, next_step: str) -> Code:
    if code is None:
        raise UsageError(f"{what} cannot be exported to C: it has no C code", next_step=next_step)
    return code


def _mean(mean: Mean, prefix: str, means: dict[str, Code], names: dict[int, str]) -> str:
    if id(mean) not in names:
        name = f"{prefix}_mean{len(means)}"
        means[name] = _written(mean.c(name), f"the physics {type(mean).__name__}", WITHOUT_PHYSICS)
        names[id(mean)] = name
    return names[id(mean)]


def _process(candidate: Candidate, prefix: str, processes: dict[str, Code], names: dict[int, str]) -> str:
    process = candidate.process
    if id(process) not in names:
        name = f"{prefix}_process{len(processes)}"
        processes[name] = process_code(candidate, name)
        names[id(process)] = name
    return names[id(process)]


def process_code(candidate: Candidate, name: str) -> Code:
    """C code of a candidate's process. UsageError: a posterior or kernel cannot be written in C."""
    process = candidate.process
    assert process is not None
    try:
        code = process.c(name)
    except UnwritableError as error:
        raise UsageError(
            f"{error} cannot be exported to C: it has no C code",
            where=f"structure {candidate.structure} of {', '.join(map(str, candidate.commands))}",
            next_step=LEARN_OTHERWISE,
        ) from error
    return _written(code, f"the process {type(process).__name__}", LEARN_OTHERWISE)


def parts_in_c(plan: Plan) -> tuple[list[str], list[str]]:
    """Names of what is read and of the commands, for C."""
    return identifiers(plan.labels), identifiers(list(plan.model.commands))
