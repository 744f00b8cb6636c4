"""`etude export --to onnx`: mean and variance of the commands as one graph, from states to commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.contracts import Array, Column, Delivered, Kind
from etude.deploy.c99.names import identifier
from etude.deploy.onnx.graph import OPSET, needed
from etude.deploy.onnx.model_graph import state_columns, written
from etude.errors import UsageError
from etude.models.model import LearnedModel
from etude.options import taken

REALS: Mapping[str, Any] = {"double": np.float64, "float": np.float32}
COUNT, SEED = 100, 20
SMALL: Mapping[str, float] = {"double": 1e-9, "float": 1e-4}
"""Largest deviation from Python, as a part of each command's limit, inside the range trained on."""


@dataclass(frozen=True)
class Options:
    """See `commands.export`."""

    real: str = "double"
    variance: bool = False
    name: str = ""
    model_hash: str = ""


def ONNX(model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
    """The target (`contracts.Target`).

    Raises:
        UsageError: unknown options, ONNX is not installed, a part of the model has no operators, or float
            would be wrong.
    """
    asked = taken(options, Options, "onnx")
    if asked.real not in REALS:
        raise UsageError(f"numbers are {' or '.join(REALS)}, not {asked.real!r}")
    states = state_columns(model)
    words = _words(model, kind, spec, states, asked)
    dtype, limit = REALS[asked.real], np.asarray(kind.limit(spec), dtype=float)
    data = written(model, dtype, asked.variance, words)
    found = deviation(model, data, limit, dtype)
    if not found <= SMALL[asked.real]:
        raise UsageError(
            f"{asked.real} is wrong for this model: commands differ from Python's by up to {found:.1e} of "
            f"their limit, more than {SMALL[asked.real]:g}",
            next_step="Export double; or learn with more noise (model.noise_floor) or fewer points.",
        )
    said = (
        f"Input states (n, {len(states)}): {', '.join(_label(c) for c in states)}.",
        f"Output command{' and variance' * asked.variance} (n, {len(limit)}): {', '.join(model.commands)}.",
        f"Opset {OPSET}, {asked.real}, {len(data) / 1024:.0f} KB. Nothing is clamped: NaN in, NaN out.",
        f"onnxruntime differs from Python by {found:.1e} of a limit.",
    )
    name = f"{identifier(asked.name or spec.name)}.onnx"
    return Delivered({name: data}, said, {"opset": OPSET, "deviation": found, "bytes": len(data)})


def session(data: bytes) -> Any:
    """onnxruntime on one thread: states (n, N) -> outputs. UsageError if it is not installed."""
    onnxruntime = needed("onnxruntime")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    found = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    return lambda states: found.run(None, {"states": states})


def deviation(model: LearnedModel, data: bytes, limit: Array, dtype: Any) -> float:
    """Largest difference from Python at states drawn inside the range trained on: of commands as a part of
    their limits, of variances of these squared.
    """
    inside = [i for i, column in enumerate(model.inputs.columns) if not column[3]]
    low, high = model.ranges[:, inside]
    states = np.random.default_rng(SEED).uniform(low, high, size=(COUNT, len(inside)))
    states = states.astype(dtype)
    found = session(data)(states)
    wanted = model.predict(as_states(model, states.astype(float)))
    pairs = zip(found, wanted, (limit, limit**2), strict=False)
    return max(float(np.abs((own - told) / size).max()) for own, told, size in pairs)


def as_states(model: LearnedModel, states: Array) -> dict[str, Array]:
    """States (n, N) of the graph as `LearnedModel.predict` takes them, by channel."""
    found: dict[str, list[Array]] = {}
    for column, values in zip(state_columns(model), states.T, strict=True):
        found.setdefault(column[0], []).append(values)
    return {name: np.stack(values, axis=1) for name, values in found.items()}


def _label(column: Column) -> str:
    channel, part, unit, _ = column
    return f"{channel}_{part} [{unit or '1'}]"


def _words(
    model: LearnedModel, kind: Kind, spec: Any, states: list[Column], asked: Options
) -> dict[str, str]:
    """Kept in the file: what it takes and gives, and whose it is."""
    units = next(c.units for c in kind.channels(spec) if c.role == "command")
    inside = [i for i, column in enumerate(model.inputs.columns) if not column[3]]
    ranges = ", ".join(f"{a:.6g}..{b:.6g}" for a, b in model.ranges[:, inside].T)
    return {
        "robot": str(spec.name),
        "model_sha256": asked.model_hash,
        "states": ", ".join(map(_label, states)),
        "trained": ranges,
        "commands": ", ".join(f"{n} [{u or '1'}]" for n, u in zip(model.commands, units, strict=True)),
        "limits": ", ".join(f"{v:.6g}" for v in kind.limit(spec)),
    }
