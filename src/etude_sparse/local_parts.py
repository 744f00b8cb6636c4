"""How inputs fall into local models: distances, the order of arrival, and parts that fit a size."""

from __future__ import annotations

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, SquaredExponential
from etude.types import Array, Index

OVERFLOW = 0.1
"""Share of the samples that may find their part full."""
MOST_TRIED, HALVINGS = 1000, 12
"""Samples and steps of the search for parts that fit."""
EVERYTHING = 4.0
"""Squared reach, in largest squared distances from the mean, with which one part holds all."""


def kernel_lengths(kernel: Kernel, theta: Array) -> Array:
    """Lengths (D,) of the kernel's squared exponential of most inputs, by input.

    Raises:
        UsageError: no part of the kernel is a squared exponential of all its inputs.
    """
    found = {part.dims: own for part, own in _parts(kernel, theta) if isinstance(part, SquaredExponential)}
    width = 1 + max(max(part.dims) for part, _ in _parts(kernel, theta))
    for dims, own in found.items():
        if set(dims) == set(range(width)):
            lengths = np.empty(width)
            lengths[list(dims)] = np.exp(own[-width:])
            return lengths
    raise UsageError(
        "the kernel has no squared exponential of all inputs to measure distances by",
        next_step="Pass lengths, one per input.",
    )


def _parts(kernel: Kernel, theta: Array) -> list[tuple[SquaredExponential | Linear, Array]]:
    """The kernels that others are made of, each with its share of theta."""
    if not isinstance(kernel, Sum | Product):
        return [(kernel, theta)] if isinstance(kernel, SquaredExponential | Linear) else []
    ends = np.cumsum([part.size for part in kernel.parts])[:-1]
    shares = zip(kernel.parts, np.split(theta, ends), strict=True)
    return [found for part, own in shares for found in _parts(part, own)]


def joined(u: Array, C: Array, reach: float) -> int:
    """The nearest of the centres C (K, D) within reach of u (D,), or K for a new one."""
    if not len(C):
        return 0
    squared = np.square(C - u).sum(axis=1)
    k = int(squared.argmin())
    return k if squared[k] < reach else len(C)


def partition(U: Array, reach: float) -> Index:
    """The part (n,) that each of U (n, D), inputs in lengths, joins, one after the other."""
    own = np.zeros(len(U), dtype=np.int64)
    C, counts = np.zeros_like(U), np.zeros(len(U))
    K = 0
    for i, u in enumerate(U):
        k = joined(u, C[:K], reach)
        K = max(K, k + 1)
        counts[k] += 1.0
        C[k] += (u - C[k]) / counts[k]
        own[i] = k
    return own


def fitting_reach(U: Array, capacity: int) -> float:
    """The largest squared reach with which parts lose at most `OVERFLOW` of the samples to their capacity.

    U (n, D) are inputs in lengths. With no more samples than capacity, one part holds all.
    """
    step = -(-len(U) // MOST_TRIED)
    some, room = U[::step], max(1.0, capacity / step)
    widest = float(np.square(U - U.mean(axis=0)).sum(axis=1).max())
    low, high = 0.0, EVERYTHING * widest if widest > 0.0 else 1.0
    if len(U) <= capacity:
        return 4.0 * high
    for _ in range(HALVINGS):
        reach = 0.5 * (low + high)
        counts = np.bincount(partition(some, reach))
        fits = np.maximum(counts - room, 0.0).sum() <= OVERFLOW * len(some)
        low, high = (reach, high) if fits else (low, reach)
    return low or high
