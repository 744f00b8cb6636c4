"""What a criterion is given and returns: batches of inputs, a score, and the chain back to the inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np

from etude.errors import EtudeError, UsageError
from etude.models.gp.cholesky import factorise
from etude.models.process_abilities import SupportsFactors
from etude.protocols import Posterior
from etude.types import Array

RESOLUTION = 1e-9
"""Part of the signal variance that is the least noise information is counted against.

A noise-free process would learn infinitely much from every sample.
"""


class Batch(Protocol):
    """Latent posterior covariances of inputs X (T, D); `models.gp.covariance_factors` shares factors."""

    def variance(self) -> Array:
        """(T,) latent variance."""
        ...

    def covariance(self, other: Any = None) -> Array:
        """(T, r) covariance with another batch, or (T, T) with itself."""
        ...

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[Any, Array] | None = None,
        reduction: tuple[Any, Array, Array] | None = None,
    ) -> Array:
        """Gradient (T, D) in X of sum(variance * var) + sum(own * C_TT) + sum(cross[1] * C_T,cross[0]).

        `reduction` = (other, A, B) stands for own = -A Bᵀ and cross = (other, 2 A).
        """
        ...


def batch_of(posterior: Posterior, X: Array) -> Batch:
    """The batch of X (T, D): with shared factors if the posterior has them, else by the bare contract."""
    if not isinstance(posterior, SupportsFactors):
        return PlainBatch(posterior, X)
    batch: Batch = posterior.factors(X)
    return batch


@dataclass(frozen=True)
class PlainBatch:
    """A batch for any posterior that keeps `protocols.Posterior` and no more."""

    posterior: Posterior
    X: Array

    def variance(self) -> Array:
        return self.posterior.predict(self.X)[1]

    def covariance(self, other: PlainBatch | None = None) -> Array:
        return self.posterior.covariance(self.X, self.X if other is None else other.X)

    def gradient(
        self,
        *,
        variance: Array | None = None,
        own: Array | None = None,
        cross: tuple[PlainBatch, Array] | None = None,
        reduction: tuple[PlainBatch, Array, Array] | None = None,
    ) -> Array:
        total = np.zeros_like(self.X)
        if reduction is not None:
            other, A, B = reduction
            total += self.gradient(own=-A @ B.T, cross=(other, 2.0 * A))
        if variance is not None:
            total += self.posterior.variance_gradient(self.X, variance)
        if own is not None:
            total += self.posterior.covariance_gradient(self.X, self.X, own + own.T)
        if cross is not None:
            other, weights = cross
            total += self.posterior.covariance_gradient(self.X, other.X, weights)
        return total


@dataclass(frozen=True)
class Output:
    """One latent function of the model, as a criterion sees it.

    Attributes:
        posterior: its Gaussian process.
        reference: (r, D) states where its variance matters; r = 0 if the criterion needs none.
        reference_batch: the same as a batch of `posterior`.
        reference_variance: (r,) their latent variance now.
        scale: variances are divided by this, so that outputs can be added: the signal variance, or what
            leaves them in squared units of the commands, for the thesis's sum.
    """

    posterior: Posterior
    reference: Array
    reference_batch: Batch
    reference_variance: Array
    scale: float

    @classmethod
    def of(cls, posterior: Posterior, reference: Array, scale: float | None = None) -> Output:
        """The output with everything that is fixed during a design computed once; scale None: the signal."""
        batch = batch_of(posterior, reference)
        variance = batch.variance() if len(reference) else np.zeros(0)
        return cls(
            posterior, reference, batch, variance, posterior.signal_variance if scale is None else scale
        )

    @property
    def noise(self) -> float:
        """sn^2 that information is counted against: at least RESOLUTION of the signal variance."""
        return max(self.posterior.noise_variance, RESOLUTION * self.posterior.signal_variance)

    @cached_property
    def reference_factor(self) -> Array:
        """Lower Cholesky factor (r, r) of C_RR + sn^2 I, made once.

        Raises:
            UsageError: the output has no reference states.
        """
        if not len(self.reference):
            raise UsageError("this criterion needs reference states, and the output has none")
        return factorise(np.asfortranarray(self.reference_batch.covariance()), self.noise)[0]


@dataclass(frozen=True)
class Score:
    """Value of a criterion and its derivatives; None where it does not depend on that quantity.

    Attributes:
        value: to be maximised.
        gain: (T,) derivative in the gains.
        variance: (T,) derivative in the latent variances.
        own: (T, T) derivative in C_TT.
        cross: (T, r) derivative in C_TR.
        reduction: (A, B), each (T, r): derivatives own = -A Bᵀ and cross = 2 A of a criterion that depends on
            reference variances removed; the chain then goes back r wide instead of T.
    """

    value: float
    gain: Array
    variance: Array | None = None
    own: Array | None = None
    cross: Array | None = None
    reduction: tuple[Array, Array] | None = None


class Criterion(Protocol):
    """(output, batch of T planned samples, gains (T,)) -> Score.

    Slow samples will be masked as stuck, so sample t counts with weight gain_t^2 in [0, 1]; its noise
    variance is sn^2/gain_t^2. All gains 1: no mask.
    """

    def __call__(self, output: Output, batch: Batch, gain: Array, /) -> Score: ...


def needing(what: Literal["reference", "identified"]) -> Callable[[Criterion], Criterion]:
    """Decorator that sets the attribute `needs` of a criterion."""

    def marked(criterion: Criterion) -> Criterion:
        vars(criterion)["needs"] = what
        return criterion

    return marked


def evaluate(
    criterion: Criterion, outputs: Sequence[Output], X: Array, gains: Array
) -> tuple[float, Array, Array]:
    """A criterion summed over outputs.

    Args:
        criterion: one of `criteria`, or a function like them.
        outputs: L latent functions.
        X: (T, D) inputs, the same for all outputs.
        gains: (T, L) square roots of the weights of the samples, per output.

    Returns:
        value, gradient in X (T, D), gradient in the gains (T, L).

    Raises:
        UsageError: the criterion fails, or answers with NaN or wrong shapes; it is named.
    """
    total, in_inputs, in_gains = 0.0, np.zeros_like(X), np.zeros_like(gains)
    for j, output in enumerate(outputs):
        batch = batch_of(output.posterior, X)
        score = _asked(criterion, output, batch, gains[:, j])
        reference = output.reference_batch
        cross = None if score.cross is None else (reference, score.cross)
        reduction = None if score.reduction is None else (reference, *score.reduction)
        total += score.value
        in_inputs += batch.gradient(variance=score.variance, own=score.own, cross=cross, reduction=reduction)
        in_gains[:, j] = score.gain
    return total, in_inputs, in_gains


def value_of(criterion: Criterion, outputs: Sequence[Output], X: Array, gains: Array) -> float:
    """The value of `evaluate` alone, at about half its price."""
    return sum(
        _asked(criterion, output, batch_of(output.posterior, X), gains[:, j]).value
        for j, output in enumerate(outputs)
    )


def _asked(criterion: Criterion, output: Output, batch: Batch, gain: Array) -> Score:
    """What the criterion says, if it is a score. A plug-in may fail with anything."""
    try:
        score = criterion(output, batch, gain)
    except EtudeError:
        raise
    except Exception as error:
        raise _refused(criterion, f"fails: {type(error).__name__}: {error}") from error
    if not isinstance(score, Score):
        raise _refused(criterion, f"returns a {type(score).__name__}, not a Score")
    if np.ndim(score.value) or not np.isfinite(score.value):
        raise _refused(criterion, f"returns the value {score.value}, not a finite number")
    T, r = len(gain), len(output.reference)
    for name, part, shape in (
        ("gain", score.gain, (T,)),
        ("variance", score.variance, (T,)),
        ("own", score.own, (T, T)),
        ("cross", score.cross, (T, r)),
        ("reduction", None if score.reduction is None else np.stack(score.reduction), (2, T, r)),
    ):
        if part is not None and (np.shape(part) != shape or not np.isfinite(part).all()):
            fault = "not finite" if np.shape(part) == shape else f"of shape {np.shape(part)}, not {shape}"
            raise _refused(criterion, f"returns derivatives in '{name}' that are {fault}")
    return score


def _refused(criterion: Criterion, fault: str) -> UsageError:
    name = getattr(criterion, "__name__", type(criterion).__name__)
    return UsageError(
        f"the criterion '{name}' {fault}",
        where=getattr(criterion, "__module__", ""),
        next_step="Repair it; `etude.testing.CriterionSuite` shows what a criterion owes.",
    )
