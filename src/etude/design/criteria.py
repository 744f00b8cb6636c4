"""Design criteria: information of a batch of planned samples about one output of the model.

A criterion is a function of covariances. It returns its value and its derivatives with respect to them; the
chain from covariances to inputs is the same for all criteria, see `evaluate`. To add one, write such a
function. Set its attribute `needs = "reference"` if it uses reference states, or `needs = "identified"` if it
rates the identified model's parameters. Name it by an entry point in `etude.criteria`, or in a campaign as
"module:function". `etude.testing.CriterionSuite` checks its gradient and the rest of its contract.

With gains d the noise of sample t is sn^2/d_t^2. Multiplied through by d, S = C_TT + diag(sn^2/d^2) becomes
M = d C_TT d + sn^2 I: the same information, log det(S/noise) = log det(M/sn^2), and smooth where a gain is
zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np

from etude import plugins
from etude._runtime.scipy_parts import dpotrs, dtrtrs
from etude.abilities import SupportsNeeds
from etude.design.config import GROUP
from etude.errors import EtudeError, UsageError
from etude.models.gp.cholesky import factorise, inverse_lower, solved_in_place
from etude.models.process_abilities import SupportsFactors
from etude.protocols import Posterior
from etude.types import Array

RESOLUTION = 1e-9
"""Smallest noise variance in information criteria, as a fraction of the signal variance.

Without noise every sample would give infinite information.
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
    """The batch of X (T, D), with shared factors if the posterior has them, else a `PlainBatch`."""
    if not isinstance(posterior, SupportsFactors):
        return PlainBatch(posterior, X)
    batch: Batch = posterior.factors(X)
    return batch


@dataclass(frozen=True)
class PlainBatch:
    """A batch for any posterior that implements only `protocols.Posterior`."""

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
    """One latent function of the model, in the form that a criterion takes.

    Attributes:
        posterior: its Gaussian process.
        reference: (r, D) states where its variance matters; r = 0 if the criterion needs none.
        reference_batch: the same as a batch of `posterior`.
        reference_variance: (r,) their latent variance now.
        scale: divisor of variances, so that outputs can be added: the signal variance, or, for the thesis's
            sum, the divisor that gives squared units of the commands.
    """

    posterior: Posterior
    reference: Array
    reference_batch: Batch
    reference_variance: Array
    scale: float

    @classmethod
    def of(cls, posterior: Posterior, reference: Array, scale: float | None = None) -> Output:
        """The output with the constant parts of a design precomputed; scale None: the signal variance."""
        batch = batch_of(posterior, reference)
        variance = batch.variance() if len(reference) else np.zeros(0)
        return cls(
            posterior, reference, batch, variance, posterior.signal_variance if scale is None else scale
        )

    @property
    def noise(self) -> float:
        """sn^2 for information criteria: at least RESOLUTION of the signal variance."""
        return max(self.posterior.noise_variance, RESOLUTION * self.posterior.signal_variance)

    @cached_property
    def reference_factor(self) -> Array:
        """Lower Cholesky factor (r, r) of C_RR + sn^2 I, cached.

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
            reductions of reference variances; backpropagation then has r columns instead of T.
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
        UsageError: the criterion fails, or returns NaN or wrong shapes; the message names it.
    """
    total, in_inputs, in_gains = 0.0, np.zeros_like(X), np.zeros_like(gains)
    for j, output in enumerate(outputs):
        batch = batch_of(output.posterior, X)
        score = _checked_score(criterion, output, batch, gains[:, j])
        reference = output.reference_batch
        cross = None if score.cross is None else (reference, score.cross)
        reduction = None if score.reduction is None else (reference, *score.reduction)
        total += score.value
        in_inputs += batch.gradient(variance=score.variance, own=score.own, cross=cross, reduction=reduction)
        in_gains[:, j] = score.gain
    return total, in_inputs, in_gains


def value_of(criterion: Criterion, outputs: Sequence[Output], X: Array, gains: Array) -> float:
    """The value of `evaluate` without gradients, at about half its cost."""
    return sum(
        _checked_score(criterion, output, batch_of(output.posterior, X), gains[:, j]).value
        for j, output in enumerate(outputs)
    )


def _checked_score(criterion: Criterion, output: Output, batch: Batch, gain: Array) -> Score:
    """The checked score of a criterion; any exception of a plug-in becomes a UsageError."""
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
        next_step="Repair it; `etude.testing.CriterionSuite` tests criteria.",
    )


__all__ = [
    "LOG_FLOOR",
    "Criterion",
    "Output",
    "Reduction",
    "Score",
    "criterion_named",
    "d_opt",
    "evaluate",
    "info_gain",
    "ivr",
    "log_ivr",
    "mean_variance",
    "mi_region",
    "needs_of",
    "sum_log",
    "value_of",
]

LOG_FLOOR = 1e-4
"""Fraction of the signal variance that `log_ivr` adds, so that well-known states add no more value."""


def mean_variance(output: Output, batch: Batch, gain: Array) -> Score:
    """Mean latent variance along the motion, sum_t gain_t^2 C_tt/T: thesis (3.2), to be maximised."""
    variance, weight = batch.variance(), 1.0 / (len(gain) * output.scale)
    return Score(
        value=weight * float(gain**2 @ variance),
        gain=2.0 * weight * gain * variance,
        variance=weight * gain**2,
    )


@needing("reference")
def ivr(output: Output, batch: Batch, gain: Array) -> Score:
    """Integrated variance reduction: mean reference variance before minus after, exactly (ALC, A-optimality).

    tr(C_RT S^-1 C_TR)/r with S = C_TT + diag(sn^2/gain^2).
    """
    r = len(output.reference)
    reduction = Reduction.of(output, batch, gain)
    weights = np.full(r, 1.0 / (r * output.scale))
    return reduction.score(float(weights @ reduction.values), weights)


@needing("reference")
def log_ivr(output: Output, batch: Batch, gain: Array) -> Score:
    """Minus the mean log of the reference variances afterwards, each plus 1e-4 of the signal variance."""
    r = len(output.reference)
    reduction = Reduction.of(output, batch, gain)
    after = np.maximum(output.reference_variance - reduction.values, 0.0) / output.scale + LOG_FLOOR
    return reduction.score(-float(np.log(after).mean()), 1.0 / (r * output.scale * after))


def criterion_named(name: str) -> Criterion:
    """The criterion of that name, built in or of a plug-in.

    Raises:
        UsageError: it does not exist, cannot be loaded, is no function, or has an unknown `needs`.
    """
    criterion: Criterion = plugins.load(GROUP, name)
    if needs_of(criterion) not in ("", "reference", "identified"):
        raise UsageError(
            f"the criterion {name!r} needs {needs_of(criterion)!r}; a design has 'reference' and 'identified'"
        )
    return criterion


def needs_of(criterion: Criterion) -> str:
    """The criterion's `needs`: "reference", "identified", or "" for neither."""
    return str(criterion.needs) if isinstance(criterion, SupportsNeeds) else ""


@dataclass(frozen=True)
class Reduction:
    """Reductions of reference variances by a batch, v_r = C_rT S^-1 C_Tr, and factors for their derivatives.

    With gains d, A = d C_TR and M = d C_TT d + sn^2 I, v = diag(A^T M^-1 A): smooth where a gain is zero.
    """

    gain: Array
    noise: float
    cross: Array
    solved: Array
    values: Array

    @classmethod
    def of(cls, output: Output, batch: Batch, gain: Array) -> Reduction:
        covariance, cross = batch.covariance(), batch.covariance(output.reference_batch)
        noisy = gain[:, None] * covariance * gain
        noisy.ravel()[:: len(noisy) + 1] += output.posterior.noise_variance
        scaled = gain[:, None] * cross
        solved = solved_in_place(noisy.T, scaled)
        noise = output.posterior.noise_variance
        return cls(gain, noise, cross, solved, np.einsum("tr,tr->r", scaled, solved))

    def score(self, value: float, weights: Array) -> Score:
        """The score of a criterion with derivative `weights` (r,) in `values`."""
        d = self.gain[:, None]
        weighted = self.solved * weights
        # C_TT d solved, from M solved = d C_TR without another product; where d is zero, `weighted` is too
        through_own = (d * self.cross - self.noise * self.solved) / np.where(d == 0.0, 1.0, d)
        return Score(
            value=value,
            gain=2.0 * np.einsum("tr,tr->t", weighted, self.cross - through_own),
            reduction=(d * weighted, d * self.solved),
        )


def sum_log(output: Output, batch: Batch, gain: Array) -> Score:
    """Information in each sample taken alone, 1/2 sum_t log(1 + gain_t^2 C_tt/sn^2) (OpAx, Sukhija 2023).

    An upper bound of `info_gain` at the cost of `mean_variance`: it ignores the redundancy of samples.
    """
    variance = batch.variance()
    signal = output.noise + gain**2 * variance
    return Score(
        value=0.5 * float(np.log(signal / output.noise).sum()),
        gain=gain * variance / signal,
        variance=0.5 * gain**2 / signal,
    )


def info_gain(output: Output, batch: Batch, gain: Array) -> Score:
    """Information that all samples together give about the function, 1/2 log det(S/sn^2) (D-optimality)."""
    return _joint(output, batch, gain, 1.0)


@needing("identified")
def d_opt(output: Output, batch: Batch, gain: Array) -> Score:
    """Growth of the log determinant of the parameters' information (Swevers et al. 1997), per output.

    log det(Y^T Sigma^-1 Y + Lambda0) - log det Lambda0 for the regressor Y of the planned samples. Parameters
    are the weights of a linear regression, and Lambda0 is their present information. By the determinant lemma
    the result is log det(S/sn^2), twice `info_gain`. The difference is the process: `design` passes the
    identified model (`latents.of_parameters`) in place of the model's own processes.
    """
    return _joint(output, batch, gain, 2.0)


def _joint(output: Output, batch: Batch, gain: Array, factor: float) -> Score:
    joint = Entropy.of(batch.covariance(), gain, output.noise)
    in_covariance, in_gain = joint.back()
    return Score(value=factor * joint.value, gain=factor * in_gain, own=factor * in_covariance)


@needing("reference")
def mi_region(output: Output, batch: Batch, gain: Array) -> Score:
    """Information that the samples give about noisy measurements at the reference states, I(y_T; y_R).

    1/2 log det S - 1/2 log det(S - C_TR (C_RR + e I)^-1 C_RT) with e = sn^2 (Krause, Singh and Guestrin
    2008). It is about y_R, not the latent f_R (e = 0): an e far below the noise would reward details of f_R
    that no later measurement can show, and is badly conditioned for neighbouring states.
    """
    factor = output.reference_factor
    prior, cross = batch.covariance(), batch.covariance(output.reference_batch)
    half, _ = dtrtrs(factor, cross.T, lower=1)
    before = Entropy.of(prior, gain, output.noise)
    after = Entropy.of(prior - half.T @ half, gain, output.noise)
    (in_own, in_gain), (in_rest, in_rest_gain) = before.back(), after.back()
    projected = dpotrs(factor, cross.T, lower=1)[0].T
    return Score(
        value=before.value - after.value,
        gain=in_gain - in_rest_gain,
        own=in_own - in_rest,
        cross=2.0 * in_rest @ projected,
    )


@dataclass(frozen=True)
class Entropy:
    """1/2 log det(M/sn^2), M = d C d + sn^2 I, for covariance C (T, T) and gains d (T,).

    The Cholesky factor L of M shows the chain rule: diag(L)^2 - sn^2 is d_t^2 times the variance at sample t
    given samples 1..t-1.
    """

    covariance: Array
    gain: Array
    noise: float
    factor: Array

    @classmethod
    def of(cls, covariance: Array, gain: Array, noise: float) -> Entropy:
        """NumericalError if rounding makes M indefinite beyond what `factorise` repairs with a warning."""
        scaled = np.asfortranarray(gain[:, None] * covariance * gain)
        return cls(covariance, gain, noise, factorise(scaled, noise)[0])

    @property
    def value(self) -> float:
        return float(np.log(self.factor.diagonal() / np.sqrt(self.noise)).sum())

    def back(self) -> tuple[Array, Array]:
        """Derivatives of the value in C, (T, T) symmetric, and in the gains, (T,): G = M^-1/2 taken back."""
        lower = inverse_lower(self.factor.copy(order="F"))
        inverse = lower + np.tril(lower, -1).T
        in_covariance = 0.5 * self.gain[:, None] * inverse * self.gain
        return in_covariance, np.asarray((inverse * self.covariance) @ self.gain)
