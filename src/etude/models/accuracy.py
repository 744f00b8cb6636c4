"""Accuracy of predicted commands on unseen motion: error, calibration, density, comparison.

z² = mean of squared error over predicted variance; 1 is right, above 1 overconfident.

The error of a command in a segment is its root mean square. Its ratio to the other model's has no unit, so
the commands of a segment are averaged as logarithms. Between segments the logarithms are taken as normal:
the interval is Student's t of their mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.errors import DataError, UsageError
from etude.models.config import LEAST_SEGMENTS
from etude.models.student_t import StudentT
from etude.types import Array, Index, Mask, Samples

NORMAL_95 = 1.959963984540054  # quantile of the normal distribution
TRANSIENT_S = 5.0
"""A start from rest with a moving target dominates the error of a trajectory's first seconds."""


@dataclass(frozen=True)
class Figures:
    """Per command (J,); NaN where there is no sample.

    Attributes:
        nmse: mean squared error over the variance of the command.
        z2: mean of squared error over predicted variance; NaN for a model without variances.
        coverage: fraction of the commands inside the predicted 95 % interval; NaN likewise.
        msll: mean of -log p(command), less that of a normal distribution fitted to the training commands
            (Rasmussen and Williams 2006, 2.5): 0 is what predicting the mean is worth, lower is better;
            unlike nMSE and z² it cannot be good with wrong variances or with wide ones. NaN without those
            commands.
    """

    nmse: Array
    z2: Array
    coverage: Array
    msll: Array


@dataclass(frozen=True)
class PredictionScore(Figures):
    """Figures over the samples at which the command's joint moved; `usable`: over all that say something, as
    long as any joint moves. Where all stand, nothing is predicted: friction holds what it likes.
    """

    usable: Figures


def prediction_score(
    samples: Samples, mean: Array, variance: Array | None = None, trained: Samples | None = None
) -> PredictionScore:
    """Score of predicted `mean` and `variance` (n, J), with noise, for the commands of `samples`.

    Args:
        trained: what was trained on, for the log loss.
    """
    trivial = None if trained is None else trivial_prediction(trained)
    command = samples.command
    moving = figures(command, mean, variance, samples.usable & samples.moving, trivial)
    return PredictionScore(
        **vars(moving), usable=figures(command, mean, variance, while_any_moves(samples), trivial)
    )


def while_any_moves(samples: Samples) -> Mask:
    """(n, J) which commands say something while any joint moves, those of standing joints too."""
    return np.asarray(samples.usable & samples.moving.any(axis=1, keepdims=True))


def trivial_prediction(trained: Samples) -> Array:
    """(2, J) mean and variance of the usable commands."""
    command = np.where(trained.usable, trained.command, np.nan)
    return np.stack([np.nanmean(command, axis=0), np.nanvar(command, axis=0)])


def figures(
    command: Array, mean: Array, variance: Array | None, use: Mask, trivial: Array | None = None
) -> Figures:
    """Figures of predictions (n, J) of `command` (n, J) where `use` is set.

    Args:
        trivial: (2, J) mean and variance of the training commands, for the log loss.

    Raises:
        UsageError: arrays of different shapes.
    """
    if not command.shape == mean.shape == use.shape or (
        variance is not None and variance.shape != mean.shape
    ):
        raise UsageError(
            "Commands, predictions and mask must have one shape",
            where=f"{command.shape}, {mean.shape}, {use.shape}",
        )
    rows = []
    for j, mask in enumerate(use.T):
        spread = None if variance is None else variance[mask, j]
        basis = None if trivial is None else trivial[:, j]
        rows.append(_figures_of(command[mask, j], mean[mask, j], spread, basis))
    return Figures(*np.array(rows).reshape(-1, 4).T)


def _figures_of(
    command: Array, mean: Array, variance: Array | None, trivial: Array | None
) -> tuple[float, float, float, float]:
    if not len(command):
        return np.nan, np.nan, np.nan, np.nan
    error, spread = command - mean, float(np.var(command))
    nmse = float(np.mean(error**2)) / spread if spread > 0 else np.nan
    if variance is None:
        return nmse, np.nan, np.nan, np.nan
    inside = np.abs(error) <= NORMAL_95 * np.sqrt(variance)
    z2, coverage = float(np.mean(error**2 / variance)), float(np.mean(inside))
    if trivial is None or not trivial[1] > 0.0:
        return nmse, z2, coverage, np.nan
    loss = np.log(variance) + error**2 / variance
    least = np.log(trivial[1]) + (command - trivial[0]) ** 2 / trivial[1]
    return nmse, z2, coverage, 0.5 * float(np.mean(loss - least))


def inflation(z2: float) -> float:
    """Factor on the variance: held-out z^2, but never below 1; 1 where it is unknown.

    Below 1 it would trust that new motions resemble the old ones as closely as those resemble each other.
    """
    return max(1.0, z2) if np.isfinite(z2) else 1.0


@dataclass(frozen=True)
class TrajectoryScores:
    """Figures of each trajectory (F,), means over its usable samples and all commands.

    Attributes:
        number: of the trajectory.
        mae: mean absolute error, command units. mae_after: the same after `TRANSIENT_S`.
        z2: mean of squared error over predicted variance; 1 is right, above 1 overconfident.
        coverage: part of the commands inside the predicted 95 % interval.
        nlpd: mean negative log density, normal, in natural units of the command's unit.
        nlpd_t: the same with the heavier tails of the held-out errors; NaN where none were fitted.
        deviation: mean predicted deviation, command units.
    """

    number: Index
    mae: Array
    mae_after: Array
    z2: Array
    coverage: Array
    nlpd: Array
    nlpd_t: Array
    deviation: Array


def score_trajectories(
    samples: Samples, mean: Array, variance: Array, student: StudentT | None = None
) -> TrajectoryScores:
    """Score of each trajectory of `samples`, predicted by `mean` and `variance` (n, J), with noise.

    Raises:
        DataError: there is no sample.
    """
    if not len(samples):
        raise DataError("there is no sample to score", next_step="Give at least one trajectory.")
    error, deviation = samples.command - mean, np.sqrt(variance)
    ratio = error / deviation
    density = -0.5 * ratio**2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)
    tailed = np.full_like(density, np.nan)
    if student is not None:
        tailed = student.log_density(ratio) - np.log(deviation)
    late = np.broadcast_to((samples.t >= TRANSIENT_S)[:, None], error.shape)
    numbers, rows = np.unique(samples.group), []
    for number in numbers:
        mask = (samples.group == number)[:, None] & samples.usable
        rows.append(
            (
                np.abs(error[mask]).mean() if mask.any() else np.nan,
                np.abs(error[mask & late]).mean() if (mask & late).any() else np.nan,
                (ratio[mask] ** 2).mean() if mask.any() else np.nan,
                (np.abs(ratio[mask]) <= NORMAL_95).mean() if mask.any() else np.nan,
                -density[mask].mean() if mask.any() else np.nan,
                -tailed[mask].mean() if mask.any() else np.nan,
                deviation[mask].mean() if mask.any() else np.nan,
            )
        )
    return TrajectoryScores(numbers, *np.array(rows).T)


NARROW, WIDE = 0.6744897501960817, 1.959963984540054
"""Deviations of the 50 % and the 95 % interval of a normal distribution."""
LEAST_COVERED = 0.85
"""Part of the commands that the 95 % interval has to hold. Intervals that are too wide are no reason against
a model: calibration widens them where held-out errors ask for it, and never narrows them."""
LEVEL = 1.1
"""Errors over those of another model, at the upper end of their interval, up to which one is as good: a
margin of non-inferiority."""
Decision = Literal["better", "level", "not better", "not decided"]


@dataclass(frozen=True)
class ErrorRatio:
    """Errors of a model over those of another; below 1 it is better.

    Attributes:
        against: what it is compared with, in words.
        segments: how many.
        ratio, lower, upper: geometric mean over segments and commands, and its 95 % interval; NaN where
            there are fewer than two segments.
        by_command: (J,) geometric means over segments.
    """

    against: str
    segments: int
    ratio: float
    lower: float
    upper: float
    by_command: tuple[float, ...]

    @property
    def decision(self) -> Decision:
        if self.segments < LEAST_SEGMENTS:
            return "not decided"
        if self.upper < 1.0:
            return "better"
        if self.upper <= LEVEL:
            return "level"
        return "not decided" if self.lower < 1.0 else "not better"


def compared(against: str, errors: Array, other: Array) -> ErrorRatio:
    """The comparison of errors (S, J) by segment and command; NaN where a command has no samples."""
    from scipy.stats import t

    tiny = np.finfo(float).tiny
    logs = np.log(np.maximum(errors, tiny)) - np.log(np.maximum(other, tiny))
    finite = np.isfinite(logs)
    logs = logs[finite.any(axis=1)]
    by_command = tuple(_exp(column[np.isfinite(column)]) for column in logs.T)
    means = np.array([row[np.isfinite(row)].mean() for row in logs])
    count = len(means)
    if count < 2:
        return ErrorRatio(against, count, _exp(means), np.nan, np.nan, by_command)
    # both tails of 95 %, by Student's t: the deviation is estimated from as few means
    half = float(t.ppf(0.975, count - 1) * means.std(ddof=1) / np.sqrt(count))
    lower, upper = np.exp([means.mean() - half, means.mean() + half]).tolist()
    return ErrorRatio(against, count, _exp(means), lower, upper, by_command)


def _exp(logs: Array) -> float:
    """Geometric mean, of logarithms; NaN of none."""
    return float(np.exp(logs.mean())) if len(logs) else float("nan")


def by_segment(error: Array, group: Index, segments: Sequence[int]) -> Array:
    """(S, J) root mean square of errors (n, J) in each segment; NaN where there are none."""
    rows = [np.where(group[:, None] == number, error, np.nan) for number in segments]
    finite = [np.isfinite(row).sum(axis=0) for row in rows]
    sums = [np.nansum(row**2, axis=0) for row in rows]
    shape = (len(rows), error.shape[1])
    counts, squares = np.reshape(finite, shape), np.reshape(sums, shape)
    return np.asarray(np.sqrt(squares / np.where(counts > 0, counts, np.nan)))


def coverage(error: Array, variance: Array) -> tuple[Array, Array]:
    """(J,) parts of the commands inside their 50 % and 95 % intervals; NaN of none."""
    shares = []
    for width in (NARROW, WIDE):
        finite = np.isfinite(error) & np.isfinite(variance)
        inside = finite & (np.abs(error) <= width * np.sqrt(variance))
        counts = finite.sum(axis=0)
        shares.append(inside.sum(axis=0) / np.where(counts > 0, counts, np.nan))
    return shares[0], shares[1]


def uncalibrated(wide: Array) -> list[int]:
    """Commands whose 95 % intervals are too narrow."""
    return [j for j, part in enumerate(wide) if part < LEAST_COVERED]
