"""Baseline structure: linear regression in the inputs and a constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from etude._runtime.operators import Piece, Value, joined
from etude.protocols import Inputs
from etude.types import Array, Code, Index, Log, Mask, Samples


@dataclass(frozen=True, eq=False)
class LinearMean:
    """Commands by least squares in the inputs that are channels themselves (implements `protocols.Mean`).

    Attributes:
        inputs: gives the regressors.
        weights: (F + 1, J) of its F columns without an op, and of the constant.
    """

    inputs: Inputs
    weights: Array

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """None: they are not physical."""
        return {}

    def predict(self, log: Log) -> Array:
        """Commands (n, J)."""
        return np.asarray(linear_inputs(self.inputs, self.inputs.of_log(log)) @ self.weights)

    def static(self, log: Log) -> Array:
        """Commands (n, J) with all rates at zero."""
        return self.predict(at_rest(log))

    def arrays(self) -> Mapping[str, Array]:
        """The weights."""
        return {"weights": self.weights}

    def c(self, name: str) -> Code:
        """C99 of it: a sum for each command."""
        from etude.models.c99 import linear_code

        return linear_code(name, self.inputs.columns, self.weights)

    def onnx(self) -> Piece:
        """In operators of ONNX: a product."""
        reads = tuple(dict.fromkeys(channel for channel, _, _, op in self.inputs.columns if not op))

        def draw(states: Mapping[str, Value], _: Value | None) -> tuple[Value, None]:
            return joined([states[name] for name in reads]) @ self.weights[:-1] + self.weights[-1], None

        return Piece(reads, draw)


@dataclass(frozen=True)
class LinearPhysics:
    """Fits the linear mean (implements `protocols.Physics`)."""

    inputs: Inputs

    def __call__(self, samples: Samples | None) -> LinearMean:
        """Least squares on the usable samples, of least norm where these lack rank."""
        assert samples is not None
        L = linear_inputs(self.inputs, self.inputs.of_log(samples.log))
        return LinearMean(self.inputs, linear_weights(L, samples.command, samples.usable))

    def restore(self, arrays: Mapping[str, Array]) -> LinearMean:
        """The mean whose arrays these are."""
        return LinearMean(self.inputs, np.asarray(arrays["weights"]))


def linear_inputs(inputs: Inputs, X: Array) -> Array:
    """(n, F + 1): the columns of X (n, D) that are channels themselves, and a constant."""
    columns: Index = np.array([i for i, column in enumerate(inputs.columns) if not column[3]], dtype=np.int64)
    return np.hstack([X[:, columns], np.ones((len(X), 1))])


def linear_weights(L: Array, command: Array, usable: Mask) -> Array:
    """(F + 1, J) weights of least squares of each command (n, J) on its usable rows of L (n, F + 1)."""
    if usable.all():
        return np.asarray(np.linalg.lstsq(L, command, rcond=None)[0])
    pairs = zip(command.T, usable.T, strict=True)
    return np.stack([np.linalg.lstsq(L[mask], y[mask], rcond=None)[0] for y, mask in pairs], axis=1)


def at_rest(log: Log) -> Log:
    """The log with every channel that is the rate of another at zero, planned or measured."""
    still = {
        name: np.zeros_like(values)
        for name, values in log.values.items()
        if log.channels[name].role in ("state", "plan") and log.channels[name].derivative_of
    }
    return replace(log, values={**log.values, **still})
