"""Held-out blocks of one log, and linear regression: the least that a model has to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.dataset import Dataset
from etude.models.guard import linear_fit, linear_inputs

Array = NDArray[np.float64]

COUNT, FIRST, EVERY = 20, 3, 5
"""20 blocks of equally many samples; blocks 3, 8, 13 and 18, counted from 0, are held out."""


def held_out_blocks() -> tuple[int, ...]:
    """Numbers of the blocks that `split_blocks` holds out."""
    return tuple(range(FIRST, COUNT, EVERY))


def split_blocks(dataset: Dataset, gap_s: float = 0.0) -> tuple[Dataset, Dataset]:
    """Training and test samples of one log, split into contiguous blocks.

    Neighbouring samples are nearly equal, so a random split would test memory; whole blocks test prediction.
    With a filter, commands near the border of a block share their noise with the other side: training samples
    within `gap_s` of a test sample are in neither part.

    Raises:
        DataError: a part would be empty.
    """
    train, test = block_masks(dataset.t, gap_s)
    return dataset.take(train), dataset.take(test)


def block_masks(t: Array, gap_s: float = 0.0) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which of the times t (n,) of one log are for training and which for the test; see `split_blocks`."""
    # by rank, not by time, so that a log with pauses, or a part of a split one, still has 20 blocks
    rank = np.argsort(np.argsort(t, kind="stable"))
    test = np.isin(rank * COUNT // len(t), held_out_blocks())
    train = ~test & ~near(t, test, gap_s)
    if not test.any() or not train.any():
        raise DataError("the log is too short to hold out blocks of it", next_step="Record a longer motion.")
    return train, test


def near(t: Array, test: NDArray[np.bool_], gap_s: float) -> NDArray[np.bool_]:
    """Which of t (n,) are less than `gap_s` from a time of the test; rounding decides nothing."""
    if gap_s <= 0.0 or not test.any():
        return np.zeros_like(test)
    times = np.sort(t[test])
    after = np.clip(np.searchsorted(times, t), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(t), int)
    nearest = np.minimum(np.abs(t - times[after - 1]), np.abs(t - times[after]))
    return np.asarray(nearest < gap_s - 1e-9)


def linear_regression(train: Dataset, test: Dataset) -> Array:
    """Commands (n, dof) at the test samples by least squares in q, qd, qdd and a constant."""
    weights = linear_fit(linear_inputs(train.q, train.qd, train.qdd), train.tau)
    return np.asarray(linear_inputs(test.q, test.qd, test.qdd) @ weights)
