"""Covariances as operators of ONNX, for m outputs of one kernel at once, each with its own hyperparameters.

Differences are taken before squares: in float the shorter |u|² + |v|² - 2 u v loses what tells close points
apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.deploy.onnx.graph import Graph
from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, RestNoise, SquaredExponential
from etude.types import Array

OTHER = "Choose process and kernel in [model] of campaign.toml and train again, or export --to c."


def unwritable(what: str) -> UsageError:
    """The error of something that has no operators."""
    return UsageError(f"{what} cannot be exported to ONNX: nobody wrote it in its operators", next_step=OTHER)


def parts(kernel: Kernel, theta: Array) -> list[tuple[Kernel, Array]]:
    """The summands or factors with rows (m, P) of their hyperparameters."""
    assert isinstance(kernel, Sum | Product)
    return [(part, theta[:, own]) for part, own in zip(kernel.parts, kernel.places, strict=True)]


def reads(kernel: Kernel) -> set[int]:
    """Columns of the inputs that its covariances look at. UsageError for a kernel without operators."""
    if isinstance(kernel, Sum | Product):
        return {column for part in kernel.parts for column in reads(part)}
    if isinstance(kernel, SquaredExponential | Linear):
        return set(kernel.dims)
    if isinstance(kernel, RestNoise):
        return {kernel.column}
    raise unwritable(f"the kernel {getattr(kernel, 'plugin', '') or type(kernel).__name__!r}")


def covariance(graph: Graph, x: str, kernel: Kernel, theta: Array, Z: Array) -> str:
    """(m, n, N) between inputs x (n, D) and points Z (m, N, D); theta (m, P)."""
    if isinstance(kernel, Sum | Product):
        sign = "Add" if isinstance(kernel, Sum) else "Mul"
        # what is zero between different points is left out of sums
        own = [(k, t) for k, t in parts(kernel, theta) if not (sign == "Add" and isinstance(k, RestNoise))]
        found = [covariance(graph, x, k, t, Z) for k, t in own]
        return _folded(graph, sign, found)
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
    raise unwritable(f"the kernel {type(kernel).__name__!r}")


def prior(graph: Graph, x: str, kernel: Kernel, theta: Array) -> str:
    """(n, m), or (1, m) where it is the same everywhere: k(x, x) at x (n, D)."""
    if isinstance(kernel, Sum | Product):
        sign = "Add" if isinstance(kernel, Sum) else "Mul"
        return _folded(graph, sign, [prior(graph, x, k, t) for k, t in parts(kernel, theta)])
    if isinstance(kernel, SquaredExponential):
        return graph.constant(_split(kernel, theta)[0][None, :])
    dims = kernel.dims if isinstance(kernel, Linear) else (kernel.column,)  # type: ignore[attr-defined]
    own = graph.columns(x, dims)
    return graph.op("MatMul", graph.op("Mul", own, own), np.exp(2.0 * theta).T)


def _split(kernel: SquaredExponential, theta: Array) -> tuple[Array, Array]:
    """(m,) s0² and (m, d) lengths."""
    if kernel.unit:
        return np.ones(len(theta)), np.exp(theta)
    return np.exp(2.0 * theta[:, 0]), np.exp(theta[:, 1:])


def _rows(graph: Graph, x: str, dims: Sequence[int], width: int) -> str:
    """(n, 1, d) columns of x (n, D), to be held against points."""
    own = x if list(dims) == list(range(width)) else graph.columns(x, dims)
    return graph.op("Unsqueeze", own, np.array([1]))


def _folded(graph: Graph, sign: str, found: Sequence[str]) -> str:
    out = found[0]
    for own in found[1:]:
        out = graph.op(sign, out, own)
    return out
