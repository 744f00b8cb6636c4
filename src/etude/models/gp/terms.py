"""Matrices added and multiplied entry by entry, whole or their lower halves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from etude.models.gp.lower_half import combined
from etude.types import Array

Of = Callable[[Array], Array]


def multiplied(factors: list[Of]) -> Of:
    """Functions whose values are matrices, as one whose value is their product."""
    first, *others = factors

    def valued(X: Array) -> Array:
        out = first(X)
        for other in others:
            out *= other(X)
        return out

    return valued


def total(terms: list[Array]) -> Array:
    """The sum, in memory of its own."""
    out = terms[0].copy(order="K")
    for term in terms[1:]:
        out += term
    return out


def product(factors: list[Array], without: int = -1) -> Array:
    """The product of all factors but one."""
    kept = [factor for i, factor in enumerate(factors) if i != without]
    if len(kept) == 1 < len(factors):
        return kept[0]  # only read
    out = kept[0].copy(order="K")
    for factor in kept[1:]:
        out *= factor
    return out


def joined_lower(operation: np.ufunc, terms: list[Array]) -> Array:
    """The lower halves of the terms joined, or the only one."""
    return combined(operation, terms, np.empty_like(terms[0], order="F")) if len(terms) > 1 else terms[0]


def weighted_lower(G: Array, factors: list[Array], without: int) -> Array:
    """G times all factors but one, zero above the diagonal as G is."""
    kept = [factor for i, factor in enumerate(factors) if i != without]
    return combined(np.multiply, [G, *kept], np.zeros_like(G, order="F")) if kept else G
