"""Prediction of LWPR: a blend of local linear models, its gradient, and the confidence bound of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from etude.errors import UsageError
from etude.types import Array

BACKGROUND = 1e-5
"""Weight of the background: far from all fields the mean returns to 0, the variance to the signal's."""
BLOCK = 1_000_000
"""Numbers in the largest array of a prediction: inputs are dealt with in blocks."""


class _Local(NamedTuple):
    """The fields at a block of inputs: w, y, h (K, T) and the differences x - c, x - x0 (K, T, D)."""

    w: Array
    y: Array
    h: Array
    from_centre: Array
    from_mean: Array
    scores: Array


@dataclass(frozen=True, eq=False)
class LWPRPosterior:
    """K receptive fields, frozen (keeps `protocols.Posterior`, but has no covariance between inputs).

    Field k weighs an input by w = exp(-|F (x - c)|²/2) and predicts level + slope·(x - x0).

    Attributes:
        noise_variance: mean squared leave-one-out error of the fields, squared output units.
        signal_variance: variance of the outputs.
        c, x0: (K, D) centres of the weights and of the local models.
        F: (K, D, D) upper triangular factors of the metrics.
        level: (K,). slope: (K, D).
        spread: (K, R, D) the directions, so that h = |spread (x - x0)|² is sᵀ P s of the paper.
        residual: (K,) variance s² of each field's residuals.
    """

    form: ClassVar[str] = "lwpr"
    noise_variance: float
    signal_variance: float
    c: Array
    x0: Array
    F: Array
    level: Array
    slope: Array
    spread: Array
    residual: Array

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,), sum w y / sum w, and variance (T,) at X (T, D).

        The variance is the paper's confidence bound (section 2.3)
        sum w ((y - mean)² + s² (1 + w h)) / (sum w)², limited smoothly to the signal variance.
        """
        X = self._inputs(X)
        mean, variance = np.empty(len(X)), np.empty(len(X))
        for part in self._blocks(X):
            local = self._local(X[part])
            total, mean[part] = self._blend(local)
            variance[part] = self._limited(self._weighted_residuals(local, mean[part]) / total**2)
        return mean, variance

    def mean(self, X: Array) -> Array:
        """Mean (T,) alone."""
        X = self._inputs(X)
        return np.concatenate([np.zeros(0), *(self._blend(self._local(X[p]))[1] for p in self._blocks(X))])

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X."""
        X = self._inputs(X)
        gradient = np.empty_like(X)
        for part in self._blocks(X):
            local = self._local(X[part])
            total, mean = self._blend(local)
            gradient[part] = self._mean_slope(local, total, mean)
        return gradient

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        X = self._inputs(X)
        gradient = np.empty_like(X)
        for part in self._blocks(X):
            gradient[part] = np.asarray(g)[part, None] * self._variance_slope(X[part])
        return gradient

    def covariance(self, X: Array, Z: Array) -> Array:  # noqa: ARG002
        """Not defined for LWPR: UsageError."""
        raise no_covariance()

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:  # noqa: ARG002
        """Not defined for LWPR: UsageError."""
        raise no_covariance()

    def _local(self, X: Array) -> _Local:
        from_centre = X - self.c[:, None]
        from_mean = X - self.x0[:, None]
        w = np.exp(-0.5 * np.square(from_centre @ self.F.transpose(0, 2, 1)).sum(axis=2))
        y = self.level[:, None] + np.einsum("ktd,kd->kt", from_mean, self.slope)
        scores = from_mean @ self.spread.transpose(0, 2, 1)
        return _Local(w, y, np.square(scores).sum(axis=2), from_centre, from_mean, scores)

    def _blend(self, local: _Local) -> tuple[Array, Array]:
        """Sum of the weights and mean (T,)."""
        total = local.w.sum(axis=0) + BACKGROUND
        return total, np.einsum("kt,kt->t", local.w, local.y) / total

    def _weighted_residuals(self, local: _Local, mean: Array) -> Array:
        """Sum of w ((y - mean)² + s² (1 + w h)), the background's share included."""
        squares = (local.y - mean) ** 2 + self.residual[:, None] * (1.0 + local.w * local.h)
        of_fields: Array = np.einsum("kt,kt->t", local.w, squares)
        return of_fields + BACKGROUND * (mean**2 + self.signal_variance)

    def _limited(self, bound: Array) -> Array:
        return bound * self.signal_variance / (bound + self.signal_variance)

    def _mean_slope(self, local: _Local, total: Array, mean: Array) -> Array:
        vjp = self._weight_slope(local, local.w * (local.y - mean))
        return np.asarray((vjp + np.einsum("kt,kd->td", local.w, self.slope)) / total[:, None])

    def _weight_slope(self, local: _Local, G: Array) -> Array:
        """sum_k G_k d log w_k / dx, (T, D)."""
        along = (local.from_centre @ self.F.transpose(0, 2, 1)) @ self.F
        return -np.asarray(np.einsum("kt,ktd->td", G, along))

    def _variance_slope(self, X: Array) -> Array:
        local = self._local(X)
        total, mean = self._blend(local)
        of_mean = self._mean_slope(local, total, mean)
        doubt, s2, apart = self._weighted_residuals(local, mean), self.residual[:, None], local.y - mean
        slope = self._weight_slope(local, local.w * (apart**2 + s2 * (1.0 + 2.0 * local.w * local.h)))
        slope += 2.0 * np.einsum("kt,kd->td", local.w * apart, self.slope)
        pulled = local.scores @ self.spread
        slope += 2.0 * np.einsum("kt,ktd->td", s2 * local.w**2, pulled)
        to_mean = 2.0 * (BACKGROUND * mean - np.einsum("kt,kt->t", local.w, apart))
        slope += to_mean[:, None] * of_mean
        bound = doubt / total**2
        of_total = self._weight_slope(local, local.w)
        in_bound = slope / total[:, None] ** 2 - (2.0 * bound / total)[:, None] * of_total
        return in_bound * ((self.signal_variance / (bound + self.signal_variance)) ** 2)[:, None]

    def _blocks(self, X: Array) -> list[slice]:
        size = max(1, BLOCK // self.F[:, 0].size)
        return [slice(first, first + size) for first in range(0, len(X), size)]

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.c.shape[1]:
            raise UsageError(f"expected inputs of shape (T, {self.c.shape[1]}), got {X.shape}")
        return X


def no_covariance() -> UsageError:
    """The error of a covariance asked for."""
    return UsageError(
        "LWPR has no covariance between two inputs",
        next_step="Design with an exact process, a dictionary or inducing points.",
    )
