"""Dataset: the samples a model learns from, made from logs by `models.preprocess`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dataset:
    """Kinematics and commands of one or several logs, at the model's own sampling rate.

    Attributes:
        t: (n,) s, time inside its own trajectory.
        q, qd, qdd: (n, dof) model inputs (measured and smoothed, or desired), rad and s.
        tau: (n, dof) command, smoothed with the same filter, in the command unit.
        stuck: (n, dof) True where that joint stood still, so that its command says nothing (mask).
        group: (n,) int, number of the trajectory each sample belongs to.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    stuck: NDArray[np.bool_]
    group: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t)

    @property
    def dof(self) -> int:
        return int(self.q.shape[1])

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Dataset:
        """The samples at `index` (integer positions or a boolean mask)."""
        return Dataset(*(getattr(self, f)[index] for f in self.__dataclass_fields__))


def concatenate(parts: list[Dataset]) -> Dataset:
    """One data set from several; groups are kept as they are."""
    return Dataset(*(np.concatenate([getattr(p, f) for p in parts]) for f in Dataset.__dataclass_fields__))
