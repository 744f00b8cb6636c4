"""Stretches of neighbours that are marked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.types import Mask


def runs(marked: Mask) -> Sequence[tuple[int, int]]:
    """First and one past the last of each stretch of neighbours that are marked."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
