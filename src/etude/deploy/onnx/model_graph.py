"""A whole model in operators of ONNX: inputs, candidates, their average and its variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from etude.contracts import Array, Candidate, Column
from etude.deploy.onnx.graph import Graph, needed
from etude.deploy.onnx.kernels import unwritable
from etude.deploy.onnx.processes import in_order, looked_at, moments
from etude.models.linear import LinearMean
from etude.models.model import LearnedModel

Term = tuple[Candidate, str, str]
"""A candidate, its commands and the latent variances of its process."""


def written(model: LearnedModel, dtype: Any, variance: bool, words: Mapping[str, str] | None = None) -> bytes:
    """The file of a model; words are kept in it.

    Raises:
        UsageError: ONNX is not installed, or a part of the model has no operators.
    """
    needed("onnx")
    used = [candidate for candidate in model.candidates if candidate.weights.any()]
    graph, J = Graph(dtype), len(model.commands)
    x = _inputs(graph, model, _looked_at(used))
    terms = [_term(graph, x, candidate, variance) for candidate in used]
    command = _sum(graph, [_placed(graph, own, c, J) for c, own, _ in terms])
    outputs = {"command": (command, J)}
    if variance:
        outputs["variance"] = (_variance(graph, model, terms, command), J)
    text = "States, in the order of `states`, to commands, in the order of `commands`; see the properties."
    return graph.model(len(state_columns(model)), outputs, words or {}, text)


def state_columns(model: LearnedModel) -> list[Column]:
    """What the graph takes, in order: the inputs that are channels themselves."""
    return [column for column in model.inputs.columns if not column[3]]


def _looked_at(used: Sequence[Candidate]) -> set[int]:
    """Columns of the inputs that count. UsageError where a part of a candidate has no operators."""
    looked: set[int] = set()
    for candidate in used:
        assert candidate.process is not None
        looked |= looked_at(candidate.process)
        if candidate.mean is not None and not isinstance(candidate.mean, LinearMean):
            raise unwritable(f"the physics {type(candidate.mean).__name__}")
    return looked


def _inputs(graph: Graph, model: LearnedModel, looked: set[int]) -> str:
    """x (n, D); what remembers is 0 where nothing looks at it, and else refused."""
    columns = list(model.inputs.columns)
    if not any(op for *_, op in columns):
        return "states"
    states = {(c[0], c[1]): place for place, c in enumerate(state_columns(model))}
    scales: Array = getattr(model.inputs, "scales", lambda: np.ones(len(columns)))()
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(columns):
        groups.setdefault(column[3], []).append(i)
    parts = []
    for op, own in groups.items():
        raw = graph.columns("states", [states[columns[i][:2]] for i in own])
        parts.append(_mapped(graph, raw, op, scales[own], [columns[i] for i in own if i in looked]))
    order = np.argsort([i for own in groups.values() for i in own])
    return in_order(graph, parts, order)


def _mapped(graph: Graph, raw: str, op: str, scales: Array, looked: Sequence[Column]) -> str:
    """Columns of one op."""
    if not op:
        return raw
    if op == "tanh":
        return graph.op("Tanh", graph.op("Div", raw, scales[None, :]))
    if op == "rest":
        return graph.op("Exp", graph.op("Neg", graph.op("Abs", graph.op("Div", raw, scales[None, :]))))
    if looked:
        channel, part = looked[0][:2]
        raise unwritable(f"the input {op!r} of {channel} {part}, which is a state of the features,")
    return graph.op("Mul", raw, np.zeros((1, len(scales))))


def _term(graph: Graph, x: str, candidate: Candidate, variance: bool) -> Term:
    assert candidate.process is not None
    mean, latent = moments(graph, x, candidate.process, variance)
    offset, factor = candidate.units
    own = graph.op("Mul", mean, factor[None, :])
    own = graph.op("Add", own, offset[None, :]) if offset.any() else own
    if isinstance(candidate.mean, LinearMean):
        weights = candidate.mean.weights[:, list(candidate.commands)]
        line = graph.op("MatMul", "states", weights[:-1])
        own = graph.op("Add", own, graph.op("Add", line, weights[-1][None, :]))
    return candidate, own, latent


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
