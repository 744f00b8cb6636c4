"""A sparse spectrum posterior as C99 and in ONNX's operators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from etude.models.gp.c99 import BLOCK, EXPONENTIAL, packed
from etude.operators import QUARTER
from etude.types import Array, Code


def spectrum(name: str, frequencies: Array, weights: Array, factor: Array | None) -> Code:
    """Mean φ(x)ᵀ w and latent variance |A φ(x)|² of cosines and sines.

    Args:
        frequencies: (m, D). weights: (2m,). factor: (2m, 2m) lower triangular A.
    """
    m, D = frequencies.shape
    size = -(-m // BLOCK) * BLOCK
    places = np.concatenate([np.arange(m), size + np.arange(m)])
    spread = np.zeros(2 * size)
    spread[places] = weights
    W = np.zeros((D, size))
    W[:, :m] = frequencies.T
    data = {f"{name}_w{d}": W[d] for d in range(D)} | {f"{name}_weights": spread}
    variance = {}
    if factor is not None:
        whole = np.zeros((2 * size, 2 * size))
        whole[np.ix_(places, places)] = factor
        variance[f"{name}_factor"] = packed(whole)
    phase = " + ".join(f"x[{d}] * {name}_w{d}[i]" for d in range(D))
    body = f"""static void {name}(const real *x, real *mean, real *variance)
{{
    real phi[{2 * size}], sums[BLOCK] = {{R(0.0)}};
    int first, i;
    for (i = 0; i < {size}; ++i)
        phi[i] = {phase};
    cosines_sines(phi, phi + {size}, {size});
    for (first = 0; first < {2 * size}; first += BLOCK)
        for (i = 0; i < BLOCK; ++i)
            sums[i] += {name}_weights[first + i] * phi[first + i];
    mean[0] = total(sums);
#if VARIANCE
    if (variance)
        variance[0] = squared({name}_factor, phi, {2 * size}, R(1.0e30));
#else
    (void)variance;
#endif
}}
"""
    operations = size * (2 * D + 3 * EXPONENTIAL // 2 + 4)
    return Code(body, data, variance, work=2 * size + BLOCK, operations=(operations, 4 * size * size))


def spectral_graph(graph: Any, x: str, own: Sequence[Any], variance: bool) -> tuple[str, str]:
    """Means and latent variances (n, m) of posteriors with as many frequencies each; "" if not asked for.

    Args:
        graph: a `deploy.onnx.graph.Graph`. own: `SparseSpectrumPosterior`s. x: (n, D) inputs in it.
    """
    phases = graph.op("MatMul", x, np.stack([p.frequencies.T for p in own]))
    cosines = graph.op("Sin", graph.op("Add", phases, QUARTER))
    phi = graph.op("Concat", cosines, graph.op("Sin", phases), axis=2)
    weights = np.stack([p.weights for p in own])[:, None, :]
    mean = graph.op("Transpose", graph.total(graph.op("Mul", phi, weights), -1), perm=[1, 0])
    if not variance:
        return mean, ""
    half = graph.op("MatMul", phi, np.stack([p.root for p in own]))
    return mean, graph.op("Transpose", graph.total(graph.op("Mul", half, half), -1), perm=[1, 0])
