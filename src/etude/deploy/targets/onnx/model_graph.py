"""A whole model in operators of ONNX: inputs, candidates, their average and its variance.

In kernels differences are taken before squares: in float the shorter |u|² + |v|² - 2 u v loses what tells
close points apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from etude._runtime.operators import Piece, Value, joined
from etude.abilities import SupportsOnnx
from etude.deploy.model_states import IN_PYTHON, LEARN_OTHERWISE, WITHOUT_PHYSICS
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, RestNoise, SquaredExponential
from etude.models.gp.plugin_kernel import PluginKernel, in_parts
from etude.models.learned_model import LearnedModel
from etude.models.process import Posteriors, Silent
from etude.models.process_abilities import SupportsOnnxMoments
from etude.models.selection.member_prediction import level_of, rests_of
from etude.models.trust import ROUNDING, thresholds
from etude.protocols import Candidate, Inputs, Process
from etude.types import Array

OPSET = 17
"""Of the operators: ReduceSum takes its axes as an input since 13."""
FORMAT = 8
"""Version of the file format, as of ONNX 1.10 to 1.13, whose releases brought opsets up to 17 and 18."""


@dataclass(frozen=True)
class Graph:
    """Operators of numbers of one type.

    Attributes:
        dtype: np.float64 or np.float32.
    """

    dtype: Any
    nodes: list[Any] = field(default_factory=list)
    constants: dict[tuple[bytes, tuple[int, ...], str], str] = field(default_factory=dict)
    values: list[Any] = field(default_factory=list)

    def op(self, name: str, *inputs: Any, **attributes: Any) -> str:
        """The name of what an operator makes of these: names of values, or arrays, which become constants."""
        from onnx import helper

        names = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        out = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(name, names, [out], name=f"n{len(self.nodes)}", **attributes))
        return out

    def constant(self, value: Any) -> str:
        """An array or a number; whole numbers stay whole."""
        from onnx import numpy_helper

        array = np.asarray(value)
        array = np.ascontiguousarray(array, dtype=np.int64 if array.dtype.kind in "iu" else self.dtype)
        array = array.reshape(np.shape(value))
        key = (array.tobytes(), array.shape, str(array.dtype))
        if key not in self.constants:
            self.constants[key] = f"c{len(self.constants)}"
            self.values.append(numpy_helper.from_array(array, self.constants[key]))
        return self.constants[key]

    def total(self, value: str, axis: int) -> str:
        """Sum along an axis, which is removed."""
        return Value(self, value).sum(axis).name

    def columns(self, value: str, which: Sequence[int]) -> str:
        """Selected columns of a table (n, D)."""
        return Value(self, value).at(which, axis=1).name

    def model(
        self,
        inputs: Mapping[str, int],
        outputs: Mapping[str, tuple[str, int]],
        properties: Mapping[str, str],
        text: str,
    ) -> bytes:
        """The file: inputs (n, width) by name; outputs by name, (n, columns) of a value.

        Args:
            properties: kept in the file beside the graph. text: what people read of it.
        """
        import onnx
        from onnx import TensorProto, helper

        kind = TensorProto.DOUBLE if self.dtype == np.float64 else TensorProto.FLOAT
        for name, (value, _) in outputs.items():
            self.nodes.append(helper.make_node("Identity", [value], [name]))
        graph = helper.make_graph(
            self.nodes,
            "model",
            [helper.make_tensor_value_info(name, kind, ["n", size]) for name, size in inputs.items()],
            [helper.make_tensor_value_info(name, kind, ["n", size]) for name, (_, size) in outputs.items()],
            self.values,
            doc_string=text,
        )
        made = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=FORMAT, producer_name="etude"
        )
        helper.set_model_props(made, dict(properties))
        onnx.checker.check_model(made, full_check=True)
        return bytes(made.SerializeToString())


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


Moments = tuple[str, str]
"""Mean and variance (n, m); the variance "" where it was not asked for."""


def no_operators_error(what: str, next_step: str = LEARN_OTHERWISE) -> UsageError:
    """The error of something that has no operators."""
    return UsageError(f"{what} cannot be exported to ONNX: it has no ONNX operators", next_step=next_step)


def parts(kernel: Kernel, theta: Array) -> list[tuple[Kernel, Array]]:
    """The summands or factors with rows (m, P) of their hyperparameters."""
    assert isinstance(kernel, Sum | Product)
    return [(part, theta[:, columns]) for part, columns in zip(kernel.parts, kernel.places, strict=True)]


def reads(kernel: Kernel) -> set[int]:
    """Columns of the inputs that its covariances look at. UsageError for a kernel without operators."""
    if isinstance(kernel, Sum | Product):
        return {column for part in kernel.parts for column in reads(part)}
    if isinstance(kernel, SquaredExponential | Linear):
        return set(kernel.dims)
    if isinstance(kernel, RestNoise):
        return {kernel.column}
    name = kernel.plugin if isinstance(kernel, PluginKernel) else type(kernel).__name__
    raise no_operators_error(f"the kernel {name!r}")


def covariance(graph: Graph, x: str, kernel: Kernel, theta: Array, Z: Array) -> str:
    """(m, n, N) between inputs x (n, D) and points Z (m, N, D); theta (m, P)."""
    if isinstance(kernel, Sum | Product):
        sign = "Add" if isinstance(kernel, Sum) else "Mul"
        # what is zero between different points is left out of sums
        terms = [(k, t) for k, t in parts(kernel, theta) if not (sign == "Add" and isinstance(k, RestNoise))]
        values = [covariance(graph, x, k, t, Z) for k, t in terms]
        return _fold(graph, sign, values)
    if isinstance(kernel, SquaredExponential):
        scale, lengths = _split(kernel, theta)
        inverse = np.sqrt(0.5) / lengths[:, None, None, :]
        own_x = graph.op("Mul", _rows(graph, x, kernel.dims, Z.shape[2]), inverse)
        own_z = Z[:, None, :, list(kernel.dims)] * inverse
        apart = graph.op("Sub", own_x, own_z)
        squares = graph.total(graph.op("Mul", apart, apart), -1)
        return graph.op("Exp", graph.op("Sub", np.log(scale)[:, None, None], squares))
    if isinstance(kernel, Linear):
        weighted = Z[:, :, list(kernel.dims)] * np.exp(2.0 * theta)[:, None, :]
        return graph.op("MatMul", graph.columns(x, kernel.dims), np.swapaxes(weighted, 1, 2))
    if isinstance(kernel, RestNoise):
        return graph.constant(np.zeros((len(Z), 1, Z.shape[1])))
    raise no_operators_error(f"the kernel {type(kernel).__name__!r}")


def prior(graph: Graph, x: str, kernel: Kernel, theta: Array) -> str:
    """(n, m), or (1, m) where it is the same everywhere: k(x, x) at x (n, D)."""
    if isinstance(kernel, Sum | Product):
        sign = "Add" if isinstance(kernel, Sum) else "Mul"
        return _fold(graph, sign, [prior(graph, x, k, t) for k, t in parts(kernel, theta)])
    if isinstance(kernel, SquaredExponential):
        return graph.constant(_split(kernel, theta)[0][None, :])
    dims = kernel.dims if isinstance(kernel, Linear) else (kernel.column,)  # type: ignore[attr-defined]
    columns = graph.columns(x, dims)
    return graph.op("MatMul", graph.op("Mul", columns, columns), np.exp(2.0 * theta).T)


def _split(kernel: SquaredExponential, theta: Array) -> tuple[Array, Array]:
    """(m,) s0² and (m, d) lengths."""
    if kernel.unit:
        return np.ones(len(theta)), np.exp(theta)
    return np.exp(2.0 * theta[:, 0]), np.exp(theta[:, 1:])


def _rows(graph: Graph, x: str, dims: Sequence[int], width: int) -> str:
    """(n, 1, d) columns of x (n, D), to be held against points."""
    columns = x if list(dims) == list(range(width)) else graph.columns(x, dims)
    return graph.op("Unsqueeze", columns, np.array([1]))


def _fold(graph: Graph, sign: str, values: Sequence[str]) -> str:
    out = values[0]
    for value in values[1:]:
        out = graph.op(sign, out, value)
    return out


def used_columns(process: Process) -> set[int]:
    """Input columns that the process uses. UsageError: a part of it has no operators."""
    if isinstance(process, Silent):
        return used_columns(process.own) if process.grows and process.own is not None else set()
    if not isinstance(process, Posteriors):
        raise no_operators_error(f"the process {type(process).__name__}")
    return {column for posterior in process.own for column in _columns(posterior)}


def _columns(posterior: Any) -> set[int]:
    if isinstance(posterior, SupportsOnnxMoments):
        return set(posterior.columns_read)
    if isinstance(posterior, ExactPosterior | BasisPosterior):
        return reads(in_parts(posterior.kernel))
    raise no_operators_error(f"a process of the form {type(posterior).__name__}")


def moments(graph: Graph, x: str, process: Process, variance: bool) -> Moments:
    """Mean and variance of any process that `used_columns` accepts."""
    if isinstance(process, Silent):
        return _silent(graph, x, process, variance)
    assert isinstance(process, Posteriors)
    groups: dict[Any, list[int]] = {}
    for place, posterior in enumerate(process.own):
        groups.setdefault(_group_key(posterior), []).append(place)
    results = [
        _group_moments(graph, x, [process.own[p] for p in places], variance) for places in groups.values()
    ]
    order = np.argsort([place for places in groups.values() for place in places])
    means, variances = [m for m, _ in results], [v for _, v in results]
    return reordered_columns(graph, means, order), reordered_columns(graph, variances, order)


def _group_key(posterior: Any) -> Any:
    """Key of posteriors that are evaluated together: equal kernel and number of points or frequencies."""
    if isinstance(posterior, SupportsOnnxMoments):
        return type(posterior), posterior.alike
    return posterior.kernel, _points(posterior).shape


def _points(posterior: Any) -> Any:
    return posterior.X if isinstance(posterior, ExactPosterior) else posterior.basis


def reordered_columns(graph: Graph, values: Sequence[str], order: Any) -> str:
    """Columns of several tables as one, in that order; "" where there are none."""
    if not values[0]:
        return ""
    whole = values[0] if len(values) == 1 else graph.op("Concat", *values, axis=1)
    return whole if (order == np.arange(len(order))).all() else graph.columns(whole, order.tolist())


def _group_moments(graph: Graph, x: str, posteriors: Sequence[Any], variance: bool) -> Moments:
    if isinstance(posteriors[0], SupportsOnnxMoments):
        return posteriors[0].onnx_moments(graph, x, posteriors, variance)
    theta, Z = np.stack([p.theta for p in posteriors]), np.stack([_points(p) for p in posteriors])
    k = covariance(graph, x, in_parts(posteriors[0].kernel), theta, Z)
    weights = np.stack([p.alpha if isinstance(p, ExactPosterior) else p.weights for p in posteriors])
    mean = _mean(graph, k, weights)
    if not variance:
        return mean, ""
    factors = np.stack([p.L_inverse if isinstance(p, ExactPosterior) else p.half for p in posteriors])
    explained = _explained_variance(graph, k, np.swapaxes(factors, 1, 2))
    left = graph.op("Sub", prior(graph, x, in_parts(posteriors[0].kernel), theta), explained)
    return mean, graph.op("Max", left, np.array(0.0))


def _mean(graph: Graph, k: str, weights: Any) -> str:
    """(n, m) from (m, n, N) and weights (m, N)."""
    columns = graph.total(graph.op("Mul", k, weights[:, None, :]), -1)
    return graph.op("Transpose", columns, perm=[1, 0])


def _explained_variance(graph: Graph, k: str, factors: Any) -> str:
    """(n, m) squares |k A|² from (m, n, N) and A (m, N, N)."""
    half = graph.op("MatMul", k, factors)
    return graph.op("Transpose", graph.total(graph.op("Mul", half, half), -1), perm=[1, 0])


def _silent(graph: Graph, x: str, process: Silent, variance: bool) -> Moments:
    zero = graph.op("Mul", graph.columns(x, [0]), np.zeros((1, len(process.least))))
    if not variance:
        return zero, ""
    if not process.grows or process.own is None:
        return zero, graph.op("Add", zero, process.least[None, :])
    _, latent = moments(graph, x, process.own, True)
    noisy = graph.op("Add", latent, process.own.noise_variance[None, :])
    scaled = graph.op("Mul", noisy, process.calibration[None, :])
    return zero, graph.op("Max", scaled, process.least[None, :])


def parts_of(model: LearnedModel) -> Parts:
    """The model taken apart. UsageError: a part of it has no operators, named."""
    used = tuple(candidate for candidate in model.candidates if candidate.weights.any())
    looked: set[int] = set()
    means: dict[int, Piece] = {}
    for candidate in used:
        assert candidate.process is not None
        looked |= used_columns(candidate.process)
        for mean in (candidate.mean, model.behind(candidate)):
            if mean is None or id(mean) in means:
                continue
            if not isinstance(mean, SupportsOnnx):
                raise no_operators_error(f"the physics {type(mean).__name__}", WITHOUT_PHYSICS)
            means[id(mean)] = mean.onnx()
    held = {i for i, column in enumerate(model.inputs.columns) if column[3] == REMEMBERED}
    inputs = _inputs(model.inputs)
    return Parts(model, used, inputs if held & looked else replace(inputs, memory=0, rate=0.0), means)


def _inputs(inputs: Inputs) -> Piece:
    """By themselves, or channel by channel where all columns are such."""
    if isinstance(inputs, SupportsOnnx):
        return inputs.onnx()
    other = [column for column in inputs.columns if column[3]]
    if other:
        raise no_operators_error(f"the input {other[0][3]!r} of {other[0][0]} {other[0][1]}", IN_PYTHON)
    reads = tuple(dict.fromkeys(channel for channel, *_ in inputs.columns))
    return Piece(reads, lambda states, _: (joined([states[name] for name in reads]), None))


def written(
    parts: Parts,
    widths: Mapping[str, int],
    dtype: Any,
    variance: bool,
    properties: Mapping[str, str] | None = None,
    *,
    fade: bool = True,
    beyond: bool = False,
) -> bytes:
    """The file of a model; `properties` are kept in it.

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
    x, physics, after = _draw_pieces(graph, parts, states)
    second_moments = variance or fade or beyond
    terms = [_term(graph, x, candidate, physics, second_moments) for candidate in parts.used]
    command = _sum(graph, [_weighted_columns(graph, mean, c, J) for c, mean, _ in terms])
    spread = _variance(graph, parts.model, terms, command) if second_moments else ""
    unknown = _unknown(graph, parts.model, x, terms, spread) if fade or beyond else None
    if fade and unknown is not None:
        command = _blend(Value(graph, command), unknown, parts, physics).name
    outputs = {"command": (command, J)}
    if variance:
        width = parts.model.width
        outputs["variance"] = (spread if width is None else graph.op("Mul", spread, width[None, :]), J)
    if beyond and unknown is not None:
        outputs["outside"] = (_outside(graph, unknown, parts.model).name, J)
    inputs = {"states": sum(widths[name] for name in parts.reads)}
    if after:
        inputs[REMEMBERED] = parts.memory
        outputs[AFTER] = (joined(after).name, parts.memory)
    text = "States, in the order of `states`, to commands, in the order of `commands`; see the properties."
    return graph.model(inputs, outputs, properties or {}, text)


def _channels(graph: Graph, parts: Parts, widths: Mapping[str, int]) -> dict[str, Value]:
    whole, at, channels = Value(graph, "states"), 0, {}
    for name in parts.reads:
        channels[name] = whole.at(range(at, at + widths[name]))
        at += widths[name]
    return channels


def _draw_pieces(
    graph: Graph, parts: Parts, states: Mapping[str, Value]
) -> tuple[str, dict[int, Value], list[Value]]:
    """x (n, D), commands (n, J) of each mean, and the memory after of all that remember."""
    memory, at, left = Value(graph, REMEMBERED), 0, []
    values = []
    for piece in parts.pieces:
        piece_memory = memory.at(range(at, at + piece.memory)) if piece.memory else None
        at += piece.memory
        value, after = piece.draw(states, piece_memory)
        values.append(value)
        left += [] if after is None else [after]
    return values[0].name, dict(zip(parts.means, values[1:], strict=True)), left


def _term(graph: Graph, x: str, candidate: Candidate, physics: Mapping[int, Value], variance: bool) -> Term:
    assert candidate.process is not None
    mean, latent = moments(graph, x, candidate.process, variance)
    offset, factor = candidate.units
    command = graph.op("Mul", mean, factor[None, :])
    command = graph.op("Add", command, offset[None, :]) if offset.any() else command
    if candidate.mean is not None:
        line = physics[id(candidate.mean)].at(candidate.commands).name
        command = graph.op("Add", command, line)
    return candidate, command, latent


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


def _blend(command: Value, unknown: Value, parts: Parts, physics: Mapping[int, Value]) -> Value:
    """(n, J) as `trust.trusted`, blended with physics where they are used, else with a level."""
    J, safe = len(parts.model.commands), command * 0.0
    for candidate in parts.used:
        behind = parts.model.behind(candidate)
        if behind is not None:
            physical = physics[id(behind)].at(candidate.commands)
            safe = safe + Value(
                physical.graph, _weighted_columns(cast("Graph", physical.graph), physical.name, candidate, J)
            )
        else:
            level = np.zeros(J)
            level[list(candidate.commands)] = candidate.weights * level_of(candidate)
            safe = safe + level[None]
    full, none = thresholds(parts.model.signal_deviation, parts.model.known)
    s = (unknown - full[None]) * (1.0 / (none - full))[None]
    s = s.most(np.array(0.0)).least(np.array(1.0))
    # `models.trust.smoothstep`, in the same order of operations
    part = 1.0 - s * s * s * (10.0 - 15.0 * s + 6.0 * (s * s))
    believed = s.made("Less", s, np.array(1.0))
    return believed.made("Where", believed, safe + part * (command - safe), safe)


def _outside(graph: Graph, unknown: Value, model: LearnedModel) -> Value:
    """(n, J) 1 where `trust.outside`, else 0."""
    most = np.minimum(model.known * (1.0 + ROUNDING), float(np.finfo(graph.dtype).max))
    beyond = unknown.made("Greater", unknown, most[None])
    return beyond.made("Where", beyond, unknown * 0.0 + 1.0, unknown * 0.0)


def _weighted_columns(graph: Graph, value: str, candidate: Candidate, J: int) -> str:
    """(n, J) weighted values of a candidate's commands, zero elsewhere."""
    if candidate.commands == tuple(range(J)) and (candidate.weights == 1.0).all():
        return value
    places = np.zeros((len(candidate.commands), J))
    places[np.arange(len(candidate.commands)), list(candidate.commands)] = candidate.weights
    return graph.op("MatMul", value, places)


def _sum(graph: Graph, values: Sequence[str]) -> str:
    out = values[0]
    for value in values[1:]:
        out = graph.op("Add", out, value)
    return out


def _variance(graph: Graph, model: LearnedModel, terms: Sequence[Term], command: str) -> str:
    """(n, J) of the average: sum w (v + (m - average)²)."""
    parts = []
    for candidate, mean, latent in terms:
        assert candidate.process is not None
        factor = candidate.calibration * candidate.units[1] ** 2
        noisy = graph.op("Add", latent, candidate.process.noise_variance[None, :])
        spread = graph.op("Mul", noisy, factor[None, :])
        apart = graph.op("Sub", mean, graph.columns(command, candidate.commands))
        whole = graph.op("Add", spread, graph.op("Mul", apart, apart))
        parts.append(_weighted_columns(graph, whole, candidate, len(model.commands)))
    variance = _sum(graph, parts)
    if model.least is None:
        return variance
    doubted = model.least > 0.0
    squares = graph.op("Mul", graph.op("Mul", command, command), doubted.astype(float)[None, :])
    return graph.op("Max", variance, graph.op("Add", squares, np.where(doubted, model.least, 0.0)[None, :]))
