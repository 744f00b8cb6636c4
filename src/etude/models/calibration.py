"""Calibration: are the predicted variances right on data that the model has not seen?

For each output z^2 = mean of squared error over predicted variance; 1 is right, above 1 overconfident.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError

Array = NDArray[np.float64]
Groups = NDArray[np.int64]

NORMAL_95 = 1.959963984540054  # quantile of the normal distribution


@dataclass(frozen=True)
class Score:
    """How well commands were predicted, per output (dof,), over the samples where that joint moved.

    Attributes:
        nmse: mean squared error over the variance of the command.
        z2: mean of squared error over predicted variance; NaN for a model without variances.
        coverage: fraction of the commands inside the predicted 95 % interval; NaN likewise.
    """

    nmse: Array
    z2: Array
    coverage: Array


def score(tau: Array, mean: Array, variance: Array | None, moving: NDArray[np.bool_]) -> Score:
    """Score of predicted `mean` and `variance` (n, dof) for commands `tau` (n, dof) where `moving` is set.

    Outputs without a moving sample are NaN.
    """
    if not tau.shape == mean.shape == moving.shape:
        raise UsageError(
            "Commands, predictions and mask must have one shape",
            where=f"{tau.shape}, {mean.shape}, {moving.shape}",
        )
    rows = [
        _score_output(tau[use, j], mean[use, j], None if variance is None else variance[use, j])
        for j, use in enumerate(moving.T)
    ]
    nmse, z2, coverage = np.array(rows).T
    return Score(nmse, z2, coverage)


def _score_output(tau: Array, mean: Array, variance: Array | None) -> tuple[float, float, float]:
    if not len(tau):
        return np.nan, np.nan, np.nan
    error = tau - mean
    spread = float(np.var(tau))
    nmse = float(np.mean(error**2)) / spread if spread > 0 else np.nan
    if variance is None:
        return nmse, np.nan, np.nan
    inside = np.abs(error) <= NORMAL_95 * np.sqrt(variance)
    return nmse, float(np.mean(error**2 / variance)), float(np.mean(inside))


def standardised_log_loss(
    tau: Array, mean: Array, variance: Array, moving: NDArray[np.bool_], trivial: Array
) -> Array:
    """MSLL (dof,): mean of -log p(tau), less that of a normal distribution fitted to the training commands.

    Rasmussen and Williams 2006, 2.5. 0 is what predicting the mean is worth, lower is better; unlike nMSE and
    z² it cannot be good with wrong variances or with wide ones. `tau`, `mean`, `variance` and `moving`
    (n, dof) as for `score`, variances with noise; `trivial` (2, dof) is mean and variance of the training
    commands. NaN for outputs without a moving sample.
    """
    trivial_mean, trivial_variance = trivial
    loss = 0.5 * (np.log(variance) + (tau - mean) ** 2 / variance)
    least = 0.5 * (np.log(trivial_variance) + (tau - trivial_mean) ** 2 / trivial_variance)
    gain = np.where(moving, loss - least, 0.0).sum(axis=0)
    counts = np.count_nonzero(moving, axis=0)
    return np.asarray(np.where(counts > 0, gain / np.maximum(counts, 1), np.nan))


def inflation(z2: float) -> float:
    """Factor on the variance: held-out z^2, but never below 1; 1 where it is unknown.

    Below 1 it would trust that new motions resemble the old ones as closely as those resemble each other.
    """
    return max(1.0, z2) if np.isfinite(z2) else 1.0


def contiguous_blocks(t: Array, group: Groups, seconds: float) -> Groups:
    """Numbers stretches of about `seconds` within each trajectory: groups to leave out of a single one.

    Neighbouring samples are never split at random: they are nearly equal, and would hide any overfit.
    """
    if not seconds > 0:
        raise UsageError("Blocks must have a positive length", where=f"{seconds} s")
    blocks = np.zeros(len(t), dtype=np.int64)
    next_number = 0
    for number in np.unique(group):
        own = group == number
        span = float(np.ptp(t[own]))
        count = max(1, round(span / seconds))
        inside = np.minimum(((t[own] - t[own].min()) / max(span, 1e-12) * count).astype(np.int64), count - 1)
        blocks[own] = next_number + inside
        next_number += count
    return blocks
