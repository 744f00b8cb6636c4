"""A whole model in operators of ONNX: inputs, candidates, their average and its variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from etude._runtime.operators import Piece, Value, joined
from etude.deploy.onnx.graph import Graph
from etude.deploy.onnx.kernels import unwritable
from etude.deploy.onnx.processes import looked_at, moments
from etude.logs.readers.extras import needed
from etude.models.model import LearnedModel
from etude.models.selection.member_prediction import level_of, physics_behind, rests_of
from etude.models.trust import ROUNDING, thresholds
from etude.protocols import Candidate, Inputs

Term = tuple[Candidate, str, str]
"""A candidate, its commands and the latent variances of its process."""
REMEMBERED = "memory"
"""The op of columns that remember, and the graph's input of what they do."""
WRITING = "writing ONNX (--to onnx)"
AFTER = "memory_after"
"""The graph's output of what is to be given in the next call."""


@dataclass(frozen=True, eq=False)
class Parts:
    """A model taken apart.

    Attributes:
        model, used: and its candidates in use. inputs: the feature map, which remembers nothing where nobody
            looks at that. means: physics, each once, by id.
    """

    model: LearnedModel
    used: tuple[Candidate, ...]
    inputs: Piece
    means: Mapping[int, Piece]

    @property
    def pieces(self) -> list[Piece]:
        """In the order of their words of memory."""
        return [self.inputs, *self.means.values()]

    @property
    def reads(self) -> tuple[str, ...]:
        """Channels that the graph takes, in order."""
        return tuple(dict.fromkeys(name for piece in self.pieces for name in piece.reads))

    @property
    def memory(self) -> int:
        """Words of it."""
        return sum(piece.memory for piece in self.pieces)

    @property
    def rate(self) -> float:
        """Hz at which the graph must be asked, as it remembers; 0: anyhow."""
        return max(piece.rate for piece in self.pieces)


def parts_of(model: LearnedModel) -> Parts:
    """The model taken apart. UsageError: a part of it has no operators, named."""
    used = tuple(candidate for candidate in model.candidates if candidate.weights.any())
    looked: set[int] = set()
    means: dict[int, Piece] = {}
    for candidate in used:
        assert candidate.process is not None
        looked |= looked_at(candidate.process)
        for mean in (candidate.mean, physics_behind(candidate, model.candidates)):
            if mean is None or id(mean) in means:
                continue
            draw = getattr(mean, "onnx", None)
            if draw is None:
                raise unwritable(f"the physics {type(mean).__name__}")
            means[id(mean)] = draw()
    held = {i for i, column in enumerate(model.inputs.columns) if column[3] == REMEMBERED}
    inputs = _inputs(model.inputs)
    return Parts(model, used, inputs if held & looked else replace(inputs, memory=0, rate=0.0), means)


def _inputs(inputs: Inputs) -> Piece:
    """By themselves, or channel by channel where all columns are such."""
    draw = getattr(inputs, "onnx", None)
    if draw is not None:
        own: Piece = draw()
        return own
    other = [column for column in inputs.columns if column[3]]
    if other:
        raise unwritable(f"the input {other[0][3]!r} of {other[0][0]} {other[0][1]}")
    reads = tuple(dict.fromkeys(channel for channel, *_ in inputs.columns))
    return Piece(reads, lambda states, _: (joined([states[name] for name in reads]), None))


def written(
    parts: Parts,
    widths: Mapping[str, int],
    dtype: Any,
    variance: bool,
    words: Mapping[str, str] | None = None,
    *,
    fade: bool = True,
    beyond: bool = False,
) -> bytes:
    """The file of a model; words are kept in it.

    Args:
        widths: parts of each channel that it reads. variance: with an output of them. fade: commands are
            those of
            `LearnedModel.predict`, else the mean of its posterior. beyond: with an output of where a row
            lies outside.

    Raises:
        UsageError: ONNX is not installed.
    """
    needed("onnx", WRITING)
    graph, J = Graph(dtype), len(parts.model.commands)
    states = _channels(graph, parts, widths)
    x, physics, after = _drawn(graph, parts, states)
    told = variance or fade or beyond
    terms = [_term(graph, x, candidate, physics, told) for candidate in parts.used]
    command = _sum(graph, [_placed(graph, own, c, J) for c, own, _ in terms])
    spread = _variance(graph, parts.model, terms, command) if told else ""
    unknown = _unknown(graph, parts.model, x, terms, spread) if fade or beyond else None
    if fade and unknown is not None:
        command = _trusted(Value(graph, command), unknown, parts, physics).name
    outputs = {"command": (command, J)} | ({"variance": (spread, J)} if variance else {})
    if beyond and unknown is not None:
        outputs["outside"] = (_outside(graph, unknown, parts.model).name, J)
    inputs = {"states": sum(widths[name] for name in parts.reads)}
    if after:
        inputs[REMEMBERED] = parts.memory
        outputs[AFTER] = (joined(after).name, parts.memory)
    text = "States, in the order of `states`, to commands, in the order of `commands`; see the properties."
    return graph.model(inputs, outputs, words or {}, text)


def _channels(graph: Graph, parts: Parts, widths: Mapping[str, int]) -> dict[str, Value]:
    whole, at, found = Value(graph, "states"), 0, {}
    for name in parts.reads:
        found[name] = whole.at(range(at, at + widths[name]))
        at += widths[name]
    return found


def _drawn(
    graph: Graph, parts: Parts, states: Mapping[str, Value]
) -> tuple[str, dict[int, Value], list[Value]]:
    """x (n, D), commands (n, J) of each mean, and the memory after of all that remember."""
    memory, at, left = Value(graph, REMEMBERED), 0, []
    values = []
    for piece in parts.pieces:
        own = memory.at(range(at, at + piece.memory)) if piece.memory else None
        at += piece.memory
        value, after = piece.draw(states, own)
        values.append(value)
        left += [] if after is None else [after]
    return values[0].name, dict(zip(parts.means, values[1:], strict=True)), left


def _term(graph: Graph, x: str, candidate: Candidate, physics: Mapping[int, Value], variance: bool) -> Term:
    assert candidate.process is not None
    mean, latent = moments(graph, x, candidate.process, variance)
    offset, factor = candidate.units
    own = graph.op("Mul", mean, factor[None, :])
    own = graph.op("Add", own, offset[None, :]) if offset.any() else own
    if candidate.mean is not None:
        line = physics[id(candidate.mean)].at(candidate.commands).name
        own = graph.op("Add", own, line)
    return candidate, own, latent


def _unknown(graph: Graph, model: LearnedModel, x: str, terms: Sequence[Term], variance: str) -> Value:
    """(n, J) the variance without noise, at rest too; all of it where a command is not believed."""
    J = len(model.commands)
    doubted = np.zeros(J, dtype=np.bool_) if model.least is None else model.least > 0.0
    squares = Value(graph, x) * Value(graph, x)
    white, held = np.zeros(J), np.zeros((len(model.inputs.columns), J))
    for candidate, _, _ in terms:
        assert candidate.process is not None
        factor = candidate.weights * candidate.calibration * candidate.units[1] ** 2
        for place, (j, pairs) in enumerate(zip(candidate.commands, rests_of(candidate), strict=True)):
            white[j] += factor[place] * candidate.process.noise_variance[place]
            for column, s in pairs:
                held[column, j] += factor[place] * s
    white, held = np.where(doubted, 0.0, white), np.where(doubted, 0.0, held)
    noise = squares @ held + white[None] if held.any() else white[None]
    return Value(graph, variance) - noise


def _trusted(command: Value, unknown: Value, parts: Parts, physics: Mapping[int, Value]) -> Value:
    """(n, J) as `trust.trusted`, blended with physics where they are used, else with a level."""
    J, safe = len(parts.model.commands), command * 0.0
    for candidate in parts.used:
        behind = physics_behind(candidate, parts.model.candidates)
        if behind is not None:
            own = physics[id(behind)].at(candidate.commands)
            safe = safe + Value(own.graph, _placed(cast("Graph", own.graph), own.name, candidate, J))
        else:
            level = np.zeros(J)
            level[list(candidate.commands)] = candidate.weights * level_of(candidate)
            safe = safe + level[None]
    full, none = thresholds(parts.model.signal_deviation, parts.model.known)
    s = (unknown - full[None]) * (1.0 / (none - full))[None]
    s = s.most(np.array(0.0)).least(np.array(1.0))
    part = 1.0 - s * s * s * (10.0 - 15.0 * s + 6.0 * (s * s))
    believed = s.made("Less", s, np.array(1.0))
    return believed.made("Where", believed, safe + part * (command - safe), safe)


def _outside(graph: Graph, unknown: Value, model: LearnedModel) -> Value:
    """(n, J) 1 where `trust.outside`, else 0."""
    most = np.minimum(model.known * (1.0 + ROUNDING), float(np.finfo(graph.dtype).max))
    beyond = unknown.made("Greater", unknown, most[None])
    return beyond.made("Where", beyond, unknown * 0.0 + 1.0, unknown * 0.0)


def _placed(graph: Graph, value: str, candidate: Candidate, J: int) -> str:
    """(n, J) weighted values of a candidate's commands, zero elsewhere."""
    if candidate.commands == tuple(range(J)) and (candidate.weights == 1.0).all():
        return value
    places = np.zeros((len(candidate.commands), J))
    places[np.arange(len(candidate.commands)), list(candidate.commands)] = candidate.weights
    return graph.op("MatMul", value, places)


def _sum(graph: Graph, values: Sequence[str]) -> str:
    out = values[0]
    for own in values[1:]:
        out = graph.op("Add", out, own)
    return out


def _variance(graph: Graph, model: LearnedModel, terms: Sequence[Term], command: str) -> str:
    """(n, J) of the average: sum w (v + (m - average)²)."""
    parts = []
    for candidate, own, latent in terms:
        assert candidate.process is not None
        factor = candidate.calibration * candidate.units[1] ** 2
        noisy = graph.op("Add", latent, candidate.process.noise_variance[None, :])
        spread = graph.op("Mul", noisy, factor[None, :])
        apart = graph.op("Sub", own, graph.columns(command, candidate.commands))
        whole = graph.op("Add", spread, graph.op("Mul", apart, apart))
        parts.append(_placed(graph, whole, candidate, len(model.commands)))
    found = _sum(graph, parts)
    if model.least is None:
        return found
    doubted = model.least > 0.0
    squares = graph.op("Mul", graph.op("Mul", command, command), doubted.astype(float)[None, :])
    return graph.op("Max", found, graph.op("Add", squares, np.where(doubted, model.least, 0.0)[None, :]))
