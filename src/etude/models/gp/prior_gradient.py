"""Derivatives of the prior covariances of a sparse model, from what every kernel offers."""

from __future__ import annotations

import numpy as np

from etude.models.gp.kernels import Kernel
from etude.types import Array

LEAST_BLOCK = 64


def prior_gradient(
    kernel: Kernel, theta: Array, Z: Array, X: Array, on_uu: Array, on_uf: Array, on_diagonal: Array
) -> tuple[Array, Array]:
    """Gradient of sum(on_uu * k(Z, Z)) + sum(on_uf * k(Z, X)) + sum(on_diagonal * diag k(X, X)).

    Args:
        Z: (u, D) inducing inputs. X: (n, D) data.
        on_uu: (u, u), symmetric. on_uf: (u, n). on_diagonal: (n,).

    Returns:
        gradient in theta (P,) and in Z (u, D).
    """
    on_Z = 2.0 * kernel.input_gradient(theta, Z, Z, on_uu) + kernel.input_gradient(theta, Z, X, on_uf)
    return _theta_gradient(kernel, theta, Z, X, on_uu, on_uf, on_diagonal), on_Z


def _theta_gradient(
    kernel: Kernel, theta: Array, Z: Array, X: Array, on_uu: Array, on_uf: Array, on_diagonal: Array
) -> Array:
    """A kernel pulls weights back to theta from a Gram matrix only, so Z is stacked on about u rows of X at a
    time: 4 n u covariances in all, and no n x n matrix.
    """
    u, total = len(Z), np.zeros(kernel.size)
    size = max(u, LEAST_BLOCK)
    for first in range(0, len(X), size):
        block = slice(first, first + size)
        points = np.vstack([Z, X[block]])
        weights = np.zeros((len(points), len(points)), order="F")
        weights[u:, :u] = on_uf[:, block].T
        weights[np.arange(u, len(points)), np.arange(u, len(points))] = on_diagonal[block]
        if first == 0:
            weights[:u, :u] = on_uu
        total += kernel.theta_gradient(theta, points, weights)
    return total
