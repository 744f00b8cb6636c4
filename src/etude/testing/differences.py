"""Finite differences, to check exact derivatives against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from etude.types import Array


def central(function: Callable[[Array], float], at: Array, step: float = 1e-4) -> Array:
    """Gradient of `function` at `at` by central differences of fourth order; the shape is that of `at`."""
    out = np.empty_like(at, dtype=float)
    for index in np.ndindex(at.shape):
        shift = np.zeros_like(at, dtype=float)
        shift[index] = step
        near = function(at + shift) - function(at - shift)
        out[index] = (8.0 * near - (function(at + 2 * shift) - function(at - 2 * shift))) / (12.0 * step)
    return out


def close(actual: Array, expected: Array, part: float, what: str) -> None:
    """AssertionError if `actual` leaves `expected` by more than `part` of its largest value."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape, f"{what}: shape {actual.shape}, wanted {expected.shape}"
    size = max(float(np.abs(expected).max(initial=0.0)), 1e-9)
    worst = float(np.abs(actual - expected).max(initial=0.0)) / size
    assert worst <= part, f"{what}: off by {worst:.3g} of its size, allowed {part:.3g}"


def same(actual: Array, expected: Array, what: str) -> None:
    """AssertionError unless both are equal to the bit, NaN in the same places."""
    assert actual.shape == expected.shape, f"{what}: shape {actual.shape}, wanted {expected.shape}"
    equal = np.array_equal(actual, expected, equal_nan=True)
    assert equal, f"{what}: not the same to the bit, off by {np.nanmax(np.abs(actual - expected)):.3g}"
