"""Samples of the training data, each predicted from the trajectories that it is not part of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.models.calibration import contiguous_blocks, inflation
from etude.models.contracts import Posterior
from etude.models.dataset import Dataset
from etude.models.processes import Lesson, Trained

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK_S = 8.0
"""With a single trajectory, stretches of this length are held out instead of whole trajectories."""
LEAST_BLOCKS = 4
"""Of a single trajectory at least so many stretches, however short it is."""


@dataclass(frozen=True)
class HeldOut:
    """Predictions of samples from the other trajectories; none where there was nothing to leave out.

    Attributes:
        rows: (m,) positions of the samples in the data set.
        error, variance: (m,) of y, noise included.
    """

    rows: Index
    error: Array
    variance: Array

    @classmethod
    def none(cls) -> HeldOut:
        """Nothing could be, or was to be, held out."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))

    def scale(self) -> float:
        """Factor on the variances that makes them right here, but never below 1."""
        return inflation(float(np.mean(self.error**2 / self.variance))) if len(self.error) else 1.0

    def density(self, scale: float) -> float:
        """Mean log density with the variances in use."""
        if not len(self.error):
            return 0.0
        used = scale * self.variance
        return -0.5 * float(np.mean(np.log(used) + self.error**2 / used))


def held_out_groups(dataset: Dataset) -> Index:
    """(n,) what is left out together: trajectories, or stretches of a single one."""
    if len(np.unique(dataset.group)) > 1:
        return dataset.group
    span = float(np.ptp(dataset.t)) or 1.0
    return contiguous_blocks(dataset.t, dataset.group, min(BLOCK_S, span / LEAST_BLOCKS))


def hold_out(trained: Trained, posterior: Posterior, lesson: Lesson, groups: Index) -> HeldOut:
    """In closed form if the posterior keeps what it was taught, else by conditioning without each group.

    The second predicts the evenly spread samples alone: among them, none was picked for its error.
    `groups` (n,) are those of all samples of the lesson.
    """
    taught = trained.taught
    X, y, own_groups = lesson.X[taught], lesson.y[taught], groups[taught]
    if len(np.unique(own_groups)) < 2:
        return HeldOut.none()
    leave = getattr(posterior, "leave_group_out", None)
    if leave is not None and np.array_equal(getattr(posterior, "X", X[:0]), X):
        mean, variance = leave(own_groups)
        return HeldOut(taught, y - mean, variance)
    spread = np.isin(taught, lesson.kept)
    rows, errors, variances = [], [], []
    for number in np.unique(own_groups[spread]):
        at = taught[(own_groups == number) & spread]
        mean, variance = predict_without(trained, lesson.X, lesson.y, groups, int(number), at)
        rows.append(at)
        errors.append(lesson.y[at] - mean)
        variances.append(variance)
    return HeldOut(np.concatenate(rows), np.concatenate(errors), np.concatenate(variances))


def predict_without(
    trained: Trained, X: Array, y: Array, groups: Index, number: int, at: Index
) -> tuple[Array, Array]:
    """Mean and variance, noise included, at the samples `at` from those taught that are of other groups."""
    other = trained.taught[groups[trained.taught] != number]
    without = trained.condition(X[other], y[other])
    mean, variance = without.predict(X[at])
    return mean, variance + without.noise_variance
