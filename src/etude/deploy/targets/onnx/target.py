"""`etude export --to onnx`: mean and variance of the commands as one graph, from states to commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude._runtime.options import taken
from etude.deploy.model_states import labels, log_of, outside_training_sentence, training_ranges
from etude.deploy.targets.c99.plan import identifier
from etude.deploy.targets.onnx.model_graph import AFTER, OPSET, REMEMBERED, WRITING, Parts, parts_of, written
from etude.errors import EtudeError, UsageError
from etude.logs.readers.extras import needed
from etude.models.learned_model import LearnedModel
from etude.models.trust import outside
from etude.protocols import Kind
from etude.types import Array, Channel, Delivered

REALS: Mapping[str, Any] = {"double": np.float64, "float": np.float32}
COUNT, SEED = 100, 20  # rows of the check against Python; any seed
UNKNOWN = 1.0
"""How far a state is tried that only physics reads."""
LEAST_SWING, LARGEST_SWING = 0.1, 2.0
"""Half ranges that the first and the last of these states swing through: processes say something near the
data only.
"""
SMALL: Mapping[str, float] = {"double": 1e-9, "float": 1e-4}
"""Largest difference from Python, a part of each command's limit, inside the range trained on or beyond."""


@dataclass(frozen=True)
class OnnxOptions:
    """See `commands.export`; outside: with an output of where commands lie outside of what was learned."""

    real: str = "double"
    variance: bool = False
    fade: bool = True
    outside: bool = False
    name: str = ""
    model_hash: str = ""


@dataclass(frozen=True, eq=False)
class GraphInputs:
    """What a graph takes: channels in order, and (2, N) the range that each of their parts was trained on."""

    channels: tuple[Channel, ...]
    ranges: Array

    @property
    def widths(self) -> dict[str, int]:
        return {channel.name: len(channel.parts) for channel in self.channels}

    @property
    def labels(self) -> list[str]:
        """Name and unit of each state."""
        units = [unit or "1" for channel in self.channels for unit in channel.units]
        return [f"{name} [{unit}]" for name, unit in zip(labels(self.channels), units, strict=True)]


def ONNX(model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
    """The target (`protocols.Target`).

    Raises:
        UsageError: unknown options, ONNX is not installed, a part of the model has no operators, or float
            would be wrong. EtudeError: the graph is wrong.
    """
    settings = taken(options, OnnxOptions, "onnx")
    if settings.real not in REALS:
        raise UsageError(f"numbers are {' or '.join(REALS)}, not {settings.real!r}")
    parts = parts_of(model)
    takes = graph_inputs(parts, kind.channels(spec))
    properties = _properties(parts, takes, kind, spec, settings)
    limit = np.asarray(kind.limit(spec), dtype=float)

    def graph(dtype: Any) -> tuple[bytes, float]:
        data = written(
            parts,
            takes.widths,
            dtype,
            settings.variance,
            properties,
            fade=settings.fade,
            beyond=settings.outside,
        )
        return data, deviation(parts, takes, data, limit, dtype, fade=settings.fade)

    data, error = graph(REALS[settings.real])
    if not error <= SMALL[settings.real]:
        raise _deviation_error(settings.real, error, graph(np.float64)[1])
    sentences = _describe_graph(parts, takes, settings, len(data), error)
    name = f"{identifier(settings.name or spec.name)}.onnx"
    return Delivered({name: data}, sentences, {"opset": OPSET, "deviation": error, "bytes": len(data)})


def _deviation_error(real: str, error: float, in_double: float) -> EtudeError:
    """Why an export is refused: single precision where double is right, else the graph itself."""
    if real == "float" and in_double <= SMALL["double"]:
        return UsageError(
            "float is not accurate enough for this model: its graph differs from Python by up to "
            f"{error:.1e} of a command's limit, more than {SMALL['float']:g}; in double by "
            f"{in_double:.1e}",
            next_step="Export double: --real double.",
        )
    return EtudeError(
        f"the exported graph differs from Python by {max(error, in_double):.1e} of a command's limit",
        next_step="Nothing was written. Please report it with the model; --to c gives the same commands.",
    )


def graph_inputs(parts: Parts, channels: Sequence[Channel]) -> GraphInputs:
    """What the graph takes, of all channels of a robot."""
    by_name = {channel.name: channel for channel in channels}
    used = tuple(by_name[name] for name in parts.reads)
    return GraphInputs(used, training_ranges(parts.model, used, UNKNOWN))


def session(data: bytes) -> Any:
    """onnxruntime on one thread: states (n, N), memory (n, M) -> outputs. UsageError: it is not installed."""
    runner = _started(data)
    return lambda states, memory=None: runner.run(
        None, {"states": states} | ({} if memory is None else {REMEMBERED: memory})
    )


def _started(data: bytes) -> Any:
    onnxruntime = needed("onnxruntime", WRITING)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def run_rows(data: bytes, parts: Parts, states: Array) -> dict[str, Array]:
    """Outputs by name at states (T, N): at once, or row by row where the graph remembers, from a memory of
    zeros.
    """
    runner = _started(data)
    names = [output.name for output in runner.get_outputs()]
    if not parts.memory:
        return dict(zip(names, runner.run(None, {"states": states}), strict=True))
    memory, rows = np.zeros((1, parts.memory), states.dtype), []
    for row in states:
        rows.append(
            dict(zip(names, runner.run(None, {"states": row[None], REMEMBERED: memory}), strict=True))
        )
        memory = rows[-1].pop(AFTER)
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def deviation(
    parts: Parts, takes: GraphInputs, data: bytes, limit: Array, dtype: Any, *, fade: bool = True
) -> float:
    """Largest difference from Python at states that swing through the range trained on and as far beyond: of
    commands as a part of their limits, of variances of these squared, and by how much a variance must be
    wrong where another row is said to be outside.
    """
    states = _swinging(takes).astype(dtype)
    log = log_of(takes.channels, states.astype(float), "states")
    expected = parts.model.predict(log, fade=fade)
    outputs = run_rows(data, parts, states)
    errors = [float(np.abs((outputs["command"] - expected.mean) / limit).max())]
    if "variance" in outputs:
        errors.append(float(np.abs((outputs["variance"] - expected.variance) / limit**2).max()))
    if "outside" in outputs:
        other = outputs["outside"].astype(np.bool_) != outside(expected.unknown, parts.model.known)
        beside = np.abs(expected.unknown - np.minimum(parts.model.known, np.finfo(dtype).max)) / limit**2
        errors.append(float(beside[other].max(initial=0.0)))
    return max(errors)


def _swinging(takes: GraphInputs) -> Array:
    rng = np.random.default_rng(SEED)
    low, high = takes.ranges
    t, N = np.linspace(0.0, 1.0, COUNT)[:, None], len(low)
    # a few swings within the rows, each input at a pace of its own
    swing = np.sin(2.0 * np.pi * (rng.uniform(1.0, 9.0, N) * t + rng.uniform(size=N)))
    growing = np.linspace(LEAST_SWING, LARGEST_SWING, COUNT)[:, None]
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * growing * swing)


def _describe_graph(
    parts: Parts, takes: GraphInputs, settings: OnnxOptions, size: int, error: float
) -> tuple[str, ...]:
    J, labels = len(parts.model.commands), takes.labels
    outputs = ["command", *["variance"] * settings.variance, *["outside"] * settings.outside]
    sentences = [
        f"Input states (n, {len(labels)}): {', '.join(labels)}.",
        f"Output {' and '.join(outputs)} (n, {J}): {', '.join(parts.model.commands)}.",
    ]
    if parts.memory:
        sentences.append(
            f"Input memory (n, {parts.memory}), zeros at the start of a run, then memory_after of the "
            f"previous call, for friction. Call it at least {parts.rate:g} times a second."
        )
    return (
        *sentences,
        *([f"Outside: {outside_training_sentence(parts.model)}"] if settings.fade else []),
        f"Opset {OPSET}, {settings.real}, {size / 1024:.0f} KB. Nothing is clamped: NaN in, NaN out.",
        f"onnxruntime differs from Python by {error:.1e} of a limit.",
    )


def _properties(
    parts: Parts, takes: GraphInputs, kind: Kind, spec: Any, settings: OnnxOptions
) -> dict[str, str]:
    """Kept in the file: what it takes and gives, and whose it is."""
    model: LearnedModel = parts.model
    units = next(c.units for c in kind.channels(spec) if c.role == "command")
    properties = {
        "robot": str(spec.name),
        "model_sha256": settings.model_hash,
        "states": ", ".join(takes.labels),
        "trained": ", ".join(f"{a:.6g}..{b:.6g}" for a, b in takes.ranges.T),
        "commands": ", ".join(f"{n} [{u or '1'}]" for n, u in zip(model.commands, units, strict=True)),
        "limits": ", ".join(f"{v:.6g}" for v in kind.limit(spec)),
    }
    return properties | ({"least_rate_hz": f"{parts.rate:g}"} if parts.memory else {})
