"""Figures as the journal keeps them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def numbers(values: Array) -> list[float | None]:
    """Finite values as JSON numbers, the others as null."""
    return [float(v) if np.isfinite(v) else None for v in values]
