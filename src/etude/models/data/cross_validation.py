"""Cross-validation: samples predicted from the trajectories that they are not part of."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import partial

import numpy as np

from etude.abilities import SupportsWithout
from etude.errors import DataError, UsageError
from etude.models.accuracy import inflation
from etude.models.data.fit_data import Folds, Rows
from etude.protocols import Mean, Physics, Process
from etude.types import Array, Index, Mask, Samples

LEAST_BLOCKS = 4
"""Of a single trajectory at least so many stretches, however short it is."""
MOST_FOLDS = 12
"""Folds of many trajectories, which take turns: the cost of holding out does not grow with their number."""
COUNT, FIRST, EVERY = 20, 3, 5
"""20 blocks of equally many samples; blocks 3, 8, 13 and 18, counted from 0, are held out of one log."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Predictions of samples from the other folds, NaN where a sample was not predicted.

    Attributes:
        error: (n, J) command less prediction, command units.
        variance: (n, J) predicted, noise included, before calibration.
        fold: (n,) what each sample was held out with.
    """

    error: Array
    variance: Array
    fold: Index

    def scale(self) -> Array:
        """(J,) factors on the variances that make them right here, but never below 1."""
        return np.array([inflation(fold_mean(e**2 / v)) for e, v in self._predicted_pairs()])

    def density(self, scale: Array) -> float:
        """Mean log density, up to a constant, with the variances times `scale` (J,)."""
        terms = [
            np.log(factor * v) + e**2 / (factor * v)
            for factor, (e, v) in zip(scale, self._predicted_pairs(), strict=True)
            if len(e)
        ]
        return -0.5 * float(np.mean(np.concatenate(terms))) if terms else 0.0

    def votes(self, by: str) -> Array:
        """(F, J) mean "squared" or "absolute" error of each fold; NaN where nothing was held out."""
        sizes = np.abs(self.error) if by == "absolute" else self.error**2
        by_fold = [sizes[self.fold == number] for number in np.unique(self.fold)]
        return np.array([[fold_mean(column) for column in rows.T] for rows in by_fold])

    def errors(self, by: str) -> Array:
        """(J,) mean of the folds' `votes`."""
        return np.array([fold_mean(column) for column in self.votes(by).T])

    def at(self, use: Mask) -> HeldOut:
        """Only the entries where `use` (n, J) is set."""
        nothing = np.full_like(self.error, np.nan)
        return HeldOut(np.where(use, self.error, nothing), np.where(use, self.variance, nothing), self.fold)

    def _predicted_pairs(self) -> list[tuple[Array, Array]]:
        pairs = zip(self.error.T, self.variance.T, strict=True)
        return [(e[np.isfinite(e)], v[np.isfinite(e)]) for e, v in pairs]


def fold_mean(values: Array) -> float:
    """Mean of the finite values; NaN of none."""
    finite = values[np.isfinite(values)]
    return float(np.mean(finite)) if len(finite) else np.nan


@dataclass(frozen=True, eq=False)
class Base:
    """A mean function and its predictions of the samples, trained with and without them.

    Attributes:
        mean: of all samples. whole: (n, J) its predictions.
        without: by number of a fold, predictions (n, J) of the mean trained without that fold.
    """

    mean: Mean
    whole: Array
    without: dict[int, Array]

    def held_out(self, folds: Folds) -> HeldOut:
        """Errors of every sample that teaches; their mean square is the variance."""
        samples = folds.samples
        return self.errors_at(folds, samples.command, samples.usable & samples.moving)

    def errors_at(self, folds: Folds, command: Array, use: Mask) -> HeldOut:
        """Errors of those commands (n, J) where `use` (n, J) is set; their mean square is the variance."""
        error = np.full_like(command, np.nan)
        for number, predicted in self.without.items():
            in_fold = folds.fold == number
            error[in_fold] = command[in_fold] - predicted[in_fold]
        error[~use] = np.nan
        squared = np.array([fold_mean(column**2) for column in error.T])
        variance = np.maximum(np.where(np.isfinite(squared), squared, 1.0), np.finfo(float).tiny)
        return HeldOut(error, np.broadcast_to(variance, error.shape), folds.fold)


def fitted_base(folds: Folds, structure: str, physics: Physics) -> Base:
    """The mean of a structure, and the means trained without one fold each.

    Where a fold alone moved an axis, the mean without it is that of all samples.

    Raises:
        UsageError: a mean that answers in the wrong shape, or with no numbers.
    """
    samples = folds.samples
    if structure == "nominal":
        mean = physics(None)
        whole = _checked(structure, mean, samples)
        return Base(mean, whole, dict.fromkeys(folds.numbers, whole))
    mean = physics(samples)
    whole = _checked(structure, mean, samples)
    if len(folds.numbers) == 1:
        return Base(mean, whole, {folds.numbers[0]: whole})
    without_each = physics.without if isinstance(physics, SupportsWithout) else partial(_without, physics)
    predictions = without_each(samples, folds.fold)
    without = {number: _numbers(structure, predicted, samples) for number, predicted in predictions.items()}
    return Base(mean, whole, {number: without.get(number, whole) for number in folds.numbers})


def _without(physics: Physics, samples: Samples, fold: Index) -> dict[int, Array]:
    """As `abilities.SupportsWithout`, of physics without that capability."""
    predictions = {}
    for number in np.unique(fold).tolist():
        with contextlib.suppress(DataError):
            predictions[number] = physics(samples.take(fold != number)).predict(samples.log)
    return predictions


def _checked(structure: str, mean: Mean, samples: Samples) -> Array:
    return _numbers(structure, mean.predict(samples.log), samples)


def _numbers(structure: str, values: Array, samples: Samples) -> Array:
    predicted = np.asarray(values, dtype=float)
    if predicted.shape != samples.command.shape or not np.isfinite(predicted).all():
        raise UsageError(
            f"the {structure} physics returned no numbers, or shape {predicted.shape} for commands of "
            f"shape {samples.command.shape}",
            next_step="Ask the author of this kind of robot.",
        )
    return predicted


def process_held_out(
    folds: Folds, group: tuple[int, ...], rows: Rows, units: Array, process: Process, base: Base | None
) -> HeldOut:
    """The kept samples, each predicted by physics and process trained without its fold."""
    outputs, (offset, factor) = list(group), units
    command = folds.samples.command[:, outputs]
    error, variance = np.full_like(command, np.nan), np.full_like(command, np.nan)
    kept_folds = folds.fold[rows.kept]
    numbers = np.unique(kept_folds)
    for number in numbers if len(numbers) > 1 else numbers[:0]:
        places = rows.kept[kept_folds == number]
        mean = 0.0 if base is None else base.without[int(number)][:, outputs]
        Y = (command - mean - offset) / factor
        held, spread = process.held_out(places, None if base is None else Y)
        if held.shape != (len(places), len(group)) or spread.shape != held.shape:
            raise UsageError(
                f"the model {folds.config.process!r} holds out in shapes {held.shape} and {spread.shape}, "
                f"not {(len(places), len(group))}",
                next_step="Ask the author of the plug-in; etude.testing.ProcessSuite shows the failure.",
            )
        error[places], variance[places] = factor * (Y[places] - held), factor**2 * spread
    return HeldOut(error, variance, folds.fold)


def fold_numbers(samples: Samples, stretch_s: float) -> Index:
    """(n,) what is left out together: trajectories, or stretches of a single one, s.

    More than `MOST_FOLDS` trajectories are dealt out to so many folds, in their order.
    """
    numbers, place = np.unique(samples.group, return_inverse=True)
    if len(numbers) > 1:
        return samples.group if len(numbers) <= MOST_FOLDS else np.asarray(place % MOST_FOLDS, dtype=np.int64)
    span = float(np.ptp(samples.t)) or 1.0
    return contiguous_blocks(samples.t, samples.group, min(stretch_s, span / LEAST_BLOCKS))


def contiguous_blocks(t: Array, group: Index, seconds: float) -> Index:
    """Numbers stretches of about `seconds` within each trajectory: groups to leave out of a single one.

    Neighbouring samples are never split at random: they are nearly equal, and would hide any overfit.
    """
    if not seconds > 0:
        raise UsageError("Blocks must have a positive length", where=f"{seconds} s")
    blocks = np.zeros(len(t), dtype=np.int64)
    next_number = 0
    for number in np.unique(group):
        mask = group == number
        span = float(np.ptp(t[mask]))
        count = max(1, round(span / seconds))
        # 1e-12 s: a group of one row has no span
        inside = np.minimum(
            ((t[mask] - t[mask].min()) / max(span, 1e-12) * count).astype(np.int64), count - 1
        )
        blocks[mask] = next_number + inside
        next_number += count
    return blocks


def held_out_blocks() -> tuple[int, ...]:
    """Numbers of the blocks that `split_blocks` holds out."""
    return tuple(range(FIRST, COUNT, EVERY))


def split_blocks(samples: Samples, gap_s: float = 0.0) -> tuple[Samples, Samples]:
    """Training and test samples of one log, split into contiguous blocks.

    Neighbouring samples are nearly equal, so a random split would test memory; whole blocks test prediction.
    With a filter, commands near the border of a block share their noise with the other side: training samples
    within `gap_s` of a test sample are in neither part.

    Raises:
        DataError: a part would be empty.
    """
    train, test = block_masks(samples.t, gap_s)
    return samples.take(train), samples.take(test)


def block_masks(t: Array, gap_s: float = 0.0) -> tuple[Mask, Mask]:
    """Which of the times t (n,) of one log are for training and which for the test; see `split_blocks`."""
    # by rank, not by time, so that a log with pauses, or a part of a split one, still has 20 blocks
    rank = np.argsort(np.argsort(t, kind="stable"))
    test = np.isin(rank * COUNT // len(t), held_out_blocks())
    train = ~test & ~near_times(t, test, gap_s)
    if not test.any() or not train.any():
        raise DataError("the log is too short to hold out blocks of it", next_step="Record a longer motion.")
    return train, test


def near_times(t: Array, test: Mask, gap_s: float) -> Mask:
    """Which of t (n,) are less than `gap_s` from a time of the test; rounding decides nothing."""
    if gap_s <= 0.0 or not test.any():
        return np.zeros_like(test)
    times = np.sort(t[test])
    after = np.clip(np.searchsorted(times, t), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(t), int)
    nearest = np.minimum(np.abs(t - times[after - 1]), np.abs(t - times[after]))
    # 1 ns: rows of a grid are as far apart as the gap only up to rounding
    return np.asarray(nearest < gap_s - 1e-9)
