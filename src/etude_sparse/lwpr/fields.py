"""Receptive fields of LWPR during learning: scales, allocation of new ones, copies for prediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.gp.exact import checked_data
from etude.types import Array
from etude_sparse.lwpr import updates
from etude_sparse.lwpr.posterior import LWPRPosterior

FIRST_FIELDS = 64
"""Fields that there is room for at first; doubled when full."""
NEIGHBOURS, NEIGHBOUR_SHARE = 15, 0.01
"""Samples that a new field weighs by half or more: so many, or this share of the data if that is more."""
SOME = 300
"""Samples whose neighbours are looked for."""
LEAST_REACH = 1e-6
"""Squared distance, in input variances, below which samples repeat each other."""
LEAST_NOISE = 1e-9
"""Least noise variance as a part of the signal variance."""


@dataclass(frozen=True)
class Scales:
    """Units in which fields learn.

    Attributes:
        centre, spread: (D,) means and deviations of the inputs; 1 where an input never changes.
        output: deviation of the outputs; 1 if they never change.
        metric: D of a new field, times the identity, for inputs in these units.
    """

    centre: Array
    spread: Array
    output: float
    metric: float

    @classmethod
    def of(cls, X: Array, y: Array, metric: float | None) -> Scales:
        """From inputs X (n, D) and outputs y (n,)."""
        centre, spread = X.mean(axis=0), X.std(axis=0)
        # the deviation of a constant is rounding: it is left in its own unit
        spread = np.where(spread > 1e-12 * np.abs(X).max(axis=0, initial=0.0), spread, 1.0)
        output = float(y.std())
        # as above: a constant is left in its own unit
        if not output > 1e-12 * float(np.abs(y).max()):
            output = 1.0
        first = initial_metric((X - centre) / spread) if metric is None else metric
        return cls(centre, spread, output, first)


def initial_metric(U: Array) -> float:
    """D of a new field, times the identity, so that it weighs its `NEIGHBOURS` nearest samples by half.

    U (n, D) are scaled inputs; the median over samples evenly spread through them. 1 if all coincide.
    """
    some = U[np.unique(np.linspace(0, len(U) - 1, SOME).astype(int))]
    count = min(max(NEIGHBOURS, int(NEIGHBOUR_SHARE * len(U))), len(U) - 1)
    squared = np.square(some).sum(axis=1)[:, None] - 2.0 * some @ U.T + np.square(U).sum(axis=1)
    reach = float(np.median(np.partition(squared, count, axis=1)[:, count]))
    return 2.0 * float(np.log(2.0)) / reach if reach > LEAST_REACH else 1.0


class ReceptiveFields:
    """What LWPR has learned so far; `observe` changes it, everything else leaves it as it is.

    Attributes:
        samples: number absorbed.

    Args:
        rule: numbers of the algorithm. directions: most directions of a field.
        noise_floor: least noise deviation, output units.
    """

    def __init__(self, rule: updates.Rule, scales: Scales, directions: int, noise_floor: float) -> None:
        D = len(scales.centre)
        self.scales, self.noise_floor, self.samples = scales, noise_floor, 0
        self._rule = rule
        self._fields = _room(FIRST_FIELDS, min(D, directions), D)
        self._first = np.sqrt(scales.metric) * np.eye(D)
        self._work = np.zeros((2 * D + 2, D))

    def __len__(self) -> int:
        return int(self._fields.used[0])

    @property
    def directions(self) -> NDArray[np.int64]:
        """(K,) directions in use."""
        return self._fields.r[: len(self)].copy()

    @property
    def metrics(self) -> Array:
        """(K, D, D) metrics, for inputs of unit variance."""
        M = self._fields.M[: len(self)]
        return np.asarray(M.transpose(0, 2, 1) @ M)

    def observe(self, X: Array, y: Array) -> None:
        """Absorb samples X (n, D), y (n,) in their order, or one sample x (D,), y.

        Raises DataError for NaN or shapes that do not fit, UsageError for another number of inputs; nothing
        is absorbed then.
        """
        X, y = checked_data(np.atleast_2d(X), np.atleast_1d(y))
        if X.shape[1] != len(self.scales.centre):
            raise UsageError(f"expected inputs of shape (n, {len(self.scales.centre)}), got {X.shape}")
        U, target = (X - self.scales.centre) / self.scales.spread, y / self.scales.output
        order, first, status = np.arange(len(y)), 0, updates.FULL
        while status == updates.FULL:
            first, status = updates.absorb(
                self._fields, U, target, order, first, self._first, self._rule, self._work
            )
            if status == updates.FULL:
                self._fields = _doubled(self._fields)
        self.samples += len(y)

    def posterior(self) -> LWPRPosterior:
        """A copy for prediction, in the units of the data. DataError before the first sample."""
        if not self.samples:
            raise DataError("the fields have seen no sample yet")
        used = _part(self._fields, len(self))
        slope, spread = _local_models(used)
        s, out = self.scales, self.scales.output
        # a field with few samples fits all of them: a tenth of its weight is left as freedom at least
        free = np.maximum(used.W - used.freedom, 0.1 * used.W)
        residual = out**2 * used.E / free
        noise = float(np.sum(used.W * residual) / np.sum(used.W))
        return LWPRPosterior(
            noise_variance=max(noise, self.noise_floor**2, LEAST_NOISE * out**2),
            signal_variance=out**2,
            c=s.centre + used.c * s.spread,
            x0=s.centre + used.x0 * s.spread,
            F=used.M / s.spread,
            level=used.y0 * out,
            slope=slope * out / s.spread,
            spread=spread / s.spread,
            residual=residual,
        )


def _local_models(fields: updates.Fields) -> tuple[Array, Array]:
    """Slopes (K, D) and directions (K, R, D) divided by their spread, both from the original inputs."""
    K, R, D = fields.u.shape
    slope, spread = np.zeros((K, D)), np.zeros((K, R, D))
    left = np.broadcast_to(np.eye(D), (K, D, D)).copy()
    for i in range(R):
        length = np.linalg.norm(fields.u[:, i], axis=1)
        used = (i < fields.r) & (length > 0.0) & (fields.seen > 2 * D)
        direction = fields.u[:, i] / np.where(length > 0.0, length, 1.0)[:, None]
        row = np.einsum("kd,kde->ke", direction, left) * used[:, None]
        SS = np.maximum(fields.SS[:, i], updates.TINY)
        slope += (fields.SR[:, i] / SS)[:, None] * row
        spread[:, i] = row / np.sqrt(SS)[:, None]
        left -= np.einsum("kd,ke->kde", fields.SZ[:, i] / SS[:, None], row)
    return slope, spread


def _room(K: int, R: int, D: int) -> updates.Fields:
    def counters() -> NDArray[np.int64]:
        return np.zeros(K, dtype=np.int64)

    return updates.Fields(
        used=np.zeros(1, dtype=np.int64),
        c=np.zeros((K, D)),
        M=np.zeros((K, D, D)),
        seen=counters(),
        added=counters(),
        r=counters(),
        rate=np.zeros(K),
        forget=np.zeros(K),
        W=np.zeros(K),
        x0=np.zeros((K, D)),
        y0=np.zeros(K),
        u=np.zeros((K, R, D)),
        SZ=np.zeros((K, R, D)),
        SS=np.zeros((K, R)),
        SR=np.zeros((K, R)),
        Q=np.zeros((K, R + 1)),
        WQ=np.zeros((K, R + 1)),
        H=np.zeros((K, R)),
        G=np.zeros((K, R)),
        E=np.zeros(K),
        E0=np.zeros(K),
        freedom=np.zeros(K),
    )


def _doubled(fields: updates.Fields) -> updates.Fields:
    """The same fields with twice the room."""
    arrays: list[Any] = list(fields[1:])
    return updates.Fields(fields.used, *(np.concatenate([a, np.zeros_like(a)]) for a in arrays))


def _part(fields: updates.Fields, K: int) -> updates.Fields:
    """Views of the first K fields."""
    arrays: list[Any] = list(fields[1:])
    return updates.Fields(fields.used, *(a[:K] for a in arrays))
