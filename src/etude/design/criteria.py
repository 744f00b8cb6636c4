"""Design criteria: how much a batch of planned samples would teach one output of the model.

A criterion is a function of covariances and returns its value and its derivatives with respect to them; the
chain from covariances to inputs is the same for all and lives in `evaluate`. To add one, write such a
function and a row in CRITERIA; the conformance suite tests/conformance/test_criteria.py checks its gradient.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from etude.design.batch import Batch, batch_of
from etude.models.contracts import Posterior

Array = NDArray[np.float64]

LOG_FLOOR = 1e-4
"""Part of the signal variance that `log_ivr` adds, so that states known already stop paying."""


@dataclass(frozen=True)
class Output:
    """One output of the model, as a criterion sees it.

    Attributes:
        posterior: its Gaussian process.
        reference: (r, D) states where its variance matters; r = 0 if the criterion needs none.
        reference_batch: the same as a batch of `posterior`.
        reference_variance: (r,) their latent variance now.
        scale: variances are divided by this, so that outputs can be added: the signal variance, or 1 for the
            thesis's sum in raw squared units.
    """

    posterior: Posterior
    reference: Array
    reference_batch: Batch
    reference_variance: Array
    scale: float

    @classmethod
    def of(cls, posterior: Posterior, reference: Array, *, raw_units: bool = False) -> Output:
        """The output with everything that is fixed during a design computed once."""
        batch = batch_of(posterior, reference)
        scale = 1.0 if raw_units else posterior.signal_variance
        variance = batch.variance() if len(reference) else np.zeros(0)
        return cls(posterior, reference, batch, variance, scale)


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


Criterion = Callable[[Output, Batch, Array], Score]
"""(output, batch of T planned samples, gains (T,)) -> Score.

Slow samples will be masked as stuck, so sample t counts with weight gain_t^2 in [0, 1]; its noise variance is
sn^2/gain_t^2. All gains 1: no mask.
"""


def mean_variance(output: Output, batch: Batch, gain: Array) -> Score:
    """Mean latent variance along the motion, sum_t gain_t^2 C_tt/T: thesis (3.2), to be maximised."""
    variance, weight = batch.variance(), 1.0 / (len(gain) * output.scale)
    return Score(
        value=weight * float(gain**2 @ variance),
        gain=2.0 * weight * gain * variance,
        variance=weight * gain**2,
    )


def ivr(output: Output, batch: Batch, gain: Array) -> Score:
    """Integrated variance reduction: mean reference variance before minus after, exactly (ALC, A-optimality).

    tr(C_RT S^-1 C_TR)/r with S = C_TT + diag(sn^2/gain^2).
    """
    r = len(output.reference)
    reduction = Reduction.of(output, batch, gain)
    weights = np.full(r, 1.0 / (r * output.scale))
    return reduction.score(float(weights @ reduction.values), weights)


def log_ivr(output: Output, batch: Batch, gain: Array) -> Score:
    """Minus the mean log of the reference variances afterwards, each plus 1e-4 of the signal variance."""
    r = len(output.reference)
    reduction = Reduction.of(output, batch, gain)
    after = np.maximum(output.reference_variance - reduction.values, 0.0) / output.scale + LOG_FLOOR
    return reduction.score(-float(np.log(after).mean()), 1.0 / (r * output.scale * after))


CRITERIA: dict[str, Criterion] = {"mean_variance": mean_variance, "ivr": ivr, "log_ivr": log_ivr}
NEEDS_REFERENCE = frozenset({"ivr", "log_ivr"})


@dataclass(frozen=True)
class Reduction:
    """Reference variances removed by a batch, v_r = C_rT S^-1 C_Tr, and what their derivatives need.

    With gains d, A = d C_TR and M = d C_TT d + sn^2 I, v = diag(A^T M^-1 A): smooth where a gain is zero.
    """

    gain: Array
    noise: float
    cross: Array
    solved: Array
    values: Array

    @classmethod
    def of(cls, output: Output, batch: Batch, gain: Array) -> Reduction:
        own, cross = batch.covariance(), batch.covariance(output.reference_batch)
        noisy = gain[:, None] * own * gain
        noisy[np.diag_indices_from(noisy)] += output.posterior.noise_variance
        scaled = gain[:, None] * cross
        solved: Array = cho_solve(cho_factor(noisy.T, lower=True, overwrite_a=True), scaled)
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


def evaluate(
    criterion: Criterion, outputs: Sequence[Output], X: Array, gains: Array
) -> tuple[float, Array, Array]:
    """A criterion summed over outputs.

    Args:
        criterion: one of CRITERIA, or a function like them.
        outputs: J outputs.
        X: (T, D) inputs, the same for all outputs.
        gains: (T, J) square roots of the weights of the samples, per output.

    Returns:
        value, gradient in X (T, D), gradient in the gains (T, J).
    """
    total, in_inputs, in_gains = 0.0, np.zeros_like(X), np.zeros_like(gains)
    for j, output in enumerate(outputs):
        batch = batch_of(output.posterior, X)
        score = criterion(output, batch, gains[:, j])
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
        criterion(output, batch_of(output.posterior, X), gains[:, j]).value
        for j, output in enumerate(outputs)
    )
