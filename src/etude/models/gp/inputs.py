"""Columns of inputs that a kernel looks at."""

from __future__ import annotations

from functools import cache

import numpy as np

from etude.errors import UsageError
from etude.types import Array


def active(X: Array, dims: tuple[int, ...]) -> Array:
    """The columns `dims` of X (n, D); UsageError if there are fewer."""
    own = places(dims)
    if X.ndim != 2 or X.shape[1] <= (max(dims) if isinstance(own, list) else dims[-1]):
        raise UsageError(f"a kernel on column {max(dims)} needs more than inputs of shape {X.shape}")
    return X[:, own]


@cache
def places(dims: tuple[int, ...]) -> slice | list[int]:
    """The columns as an index: consecutive ones as a slice, whose columns are a view, and no copy."""
    first, count = dims[0], len(dims)
    return slice(first, first + count) if dims == tuple(range(first, first + count)) else list(dims)


def with_ones(U: Array) -> Array:
    """[U, 1], (n, D + 1)."""
    out = np.empty((len(U), U.shape[1] + 1))
    out[:, :-1], out[:, -1] = U, 1.0
    return out


def check_dims(dims: tuple[int, ...]) -> None:
    """UsageError if these cannot be columns."""
    if not dims or len(set(dims)) != len(dims) or min(dims) < 0:
        raise UsageError(f"active dimensions must be distinct and not negative, got {dims}")
