"""Prediction of local Gaussian processes: a blend of means, a product of experts' variance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from etude.errors import UsageError
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.models.gp.kernel_algebra import Kernel
from etude.types import Array, Index

LEAST_VARIANCE = 1e-12
"""Least variance of an expert as a part of the prior variance: it is divided by."""


class Expert(Protocol):
    """What a blend asks of a local model."""

    def predict(self, X: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class Blend:
    """T inputs and the share of each of K local models in their prediction.

    Attributes:
        shares: (T, K) activations of the nearest models divided by their sum, 0 for the others.
    """

    shares: Array

    @classmethod
    def of(cls, X: Array, centres: Array, lengths: Array, nearest: int) -> Blend:
        """Activations exp(-|(x - c)/lengths|²/2), the `nearest`; relative, so far away one has all."""
        U, C = X / lengths, centres / lengths
        squared = np.stack([np.square(U - c).sum(axis=1) for c in C], axis=1)
        if nearest < len(C):
            far = np.argsort(squared, axis=1, kind="stable")[:, nearest:]
            np.put_along_axis(squared, far, np.inf, axis=1)
        weights = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)))
        return cls(weights / weights.sum(axis=1, keepdims=True))

    def fill(self, models: Sequence[Expert], answer: Callable[[Expert, Index, int], None]) -> None:
        """Calls `answer(model, rows, k)` with the inputs in which model k has a share."""
        for k, model in enumerate(models):
            rows = np.flatnonzero(self.shares[:, k])
            if len(rows):
                answer(model, rows, k)


def blended(blend: Blend, models: Sequence[Expert], X: Array, least: float) -> tuple[Array, Array]:
    """Means and variances (T, K) of the local models, 0 and 1 where they have no share."""
    means, variances = np.zeros_like(blend.shares), np.ones_like(blend.shares)

    def answer(model: Expert, rows: Index, k: int) -> None:
        means[rows, k], variances[rows, k] = model.predict(X[rows])

    blend.fill(models, answer)
    return means, np.maximum(variances, least)


def combined(blend: Blend, means: Array, variances: Array) -> tuple[Array, Array]:
    """Mean sum w mu / sum w (eq. 7 of the paper) and variance 1 / (sum w / v / sum w)."""
    mean = np.einsum("tk,tk->t", blend.shares, means)
    return mean, 1.0 / np.einsum("tk,tk->t", blend.shares, 1.0 / variances)


@dataclass(frozen=True, eq=False)
class LocalPosterior:
    """K exact processes and where they count (keeps `protocols.Posterior`, but has no covariances).

    Attributes:
        centres: (K, D). lengths: (D,) of the activations.
        models: one exact posterior per part, all with the same hyperparameters.
        nearest: models blended at an input, at most; the prediction jumps slightly where this set changes.
    """

    form: ClassVar[str] = "local"
    centres: Array
    lengths: Array
    models: tuple[ExactPosterior, ...]
    nearest: int

    @property
    def kernel(self) -> Kernel:
        return self.models[0].kernel

    @property
    def theta(self) -> Array:
        """(P,) log hyperparameters."""
        return self.models[0].theta

    @property
    def noise_variance(self) -> float:
        """sn², squared output units."""
        return self.models[0].noise_variance

    @cached_property
    def signal_variance(self) -> float:
        """Mean of k(x, x) over the samples of all models."""
        return float(self.kernel.diagonal(self.theta, self.X).mean())

    @cached_property
    def X(self) -> Array:
        """(n, D) samples of all models, one after the other."""
        return np.concatenate([model.X for model in self.models])

    @cached_property
    def y(self) -> Array:
        """(n,) their centred outputs."""
        return np.concatenate([model.y for model in self.models])

    @property
    def counts(self) -> Index:
        """(K,) samples of each model."""
        return np.array([len(model.y) for model in self.models])

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and variance (T,) at X (T, D).

        The mean is the paper's. The paper has no variance: this one is a generalised product of experts, the
        harmonic mean of the local variances by activation. It knows nothing of samples in other parts.
        """
        X = self._inputs(X)
        blend = self._blend(X)
        return combined(blend, *blended(blend, self.models, X, self._least))

    def mean(self, X: Array) -> Array:
        """Mean (T,) alone: O(nearest capacity) a point."""
        X = self._inputs(X)
        blend, total = self._blend(X), np.zeros(len(X))
        for k, model in enumerate(self.models):
            rows = np.flatnonzero(blend.shares[:, k])
            if len(rows):
                total[rows] += blend.shares[rows, k] * model.mean(X[rows])
        return total

    def mean_gradient(self, X: Array) -> Array:
        """Gradient (T, D) of the mean at each row of X, the set of nearest models held fixed."""
        X = self._inputs(X)
        blend = self._blend(X)
        means, _ = blended(blend, self.models, X, self._least)
        gradient = self._share_slope(blend, means)
        for k, model in enumerate(self.models):
            rows = np.flatnonzero(blend.shares[:, k])
            if len(rows):
                gradient[rows] += blend.shares[rows, k, None] * model.mean_gradient(X[rows])
        return gradient

    def variance_gradient(self, X: Array, g: Array) -> Array:
        """Gradient (T, D) of sum(g * variance(X)) with respect to X; g is (T,)."""
        X, g = self._inputs(X), np.asarray(g, dtype=float)
        blend = self._blend(X)
        means, variances = blended(blend, self.models, X, self._least)
        _, variance = combined(blend, means, variances)
        outer = -g * variance**2  # d variance = -variance² d(precision)
        gradient = outer[:, None] * self._share_slope(blend, 1.0 / variances)
        for k, model in enumerate(self.models):
            rows = np.flatnonzero(blend.shares[:, k])
            if len(rows):
                weights = -outer[rows] * blend.shares[rows, k] / variances[rows, k] ** 2
                gradient[rows] += model.variance_gradient(X[rows], weights)
        return gradient

    def covariance(self, X: Array, Z: Array) -> Array:  # noqa: ARG002
        """Not defined for local processes: UsageError."""
        raise _no_covariance()

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:  # noqa: ARG002
        """Not defined for local processes: UsageError."""
        raise _no_covariance()

    @property
    def _least(self) -> float:
        return LEAST_VARIANCE * self.signal_variance

    def _blend(self, X: Array) -> Blend:
        return Blend.of(X, self.centres, self.lengths, self.nearest)

    def _share_slope(self, blend: Blend, values: Array) -> Array:
        """(T, D) gradient of sum_k shares_k values_k with the values held fixed."""
        apart = blend.shares * (values - np.einsum("tk,tk->t", blend.shares, values)[:, None])
        # d log w_k / dx = -(x - c_k) / lengths²; the terms in x cancel, for `apart` sums to 0
        return np.asarray((apart @ self.centres) / self.lengths**2)

    def _inputs(self, X: Array) -> Array:
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != len(self.lengths):
            raise UsageError(f"expected inputs of shape (T, {len(self.lengths)}), got {X.shape}")
        return X


def local_posterior_given(
    kernel: Kernel,
    theta: Array,
    noise_variance: float,
    centres: Array,
    lengths: Array,
    nearest: int,
    samples: tuple[Array, Array, Index],
) -> LocalPosterior:
    """The posterior of its samples: X (n, D) and y (n,) of all models one after the other, counts (K,)."""
    X, y, counts = samples
    ends = np.cumsum(counts)[:-1]
    models = tuple(
        posterior_given(kernel, theta, noise_variance, own_X, own_y)
        for own_X, own_y in zip(np.split(X, ends), np.split(y, ends), strict=True)
    )
    return LocalPosterior(centres, lengths, models, nearest)


def _no_covariance() -> UsageError:
    return UsageError(
        "Local processes have no covariance between two inputs",
        next_step="Design with an exact process, a dictionary or inducing points.",
    )
