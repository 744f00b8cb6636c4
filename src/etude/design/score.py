"""What a criterion is given, what it returns, and the chain from there to inputs that all criteria share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from etude.design.batch import Batch, batch_of
from etude.errors import UsageError
from etude.models.contracts import Posterior
from etude.models.gp.cholesky import factorise
from etude.models.guided import guide_of

Array = NDArray[np.float64]

RESOLUTION = 1e-9
"""Part of the signal variance that is the least noise information is counted against.

A noise-free process would learn infinitely much from every sample.
"""


@dataclass(frozen=True)
class Output:
    """One output of the model, as a criterion sees it.

    Attributes:
        posterior: its Gaussian process; the guide of a member that has no covariances.
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
        posterior = guide_of(posterior)
        batch = batch_of(posterior, reference)
        scale = 1.0 if raw_units else posterior.signal_variance
        variance = batch.variance() if len(reference) else np.zeros(0)
        return cls(posterior, reference, batch, variance, scale)

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


Criterion = Callable[[Output, Batch, Array], Score]
"""(output, batch of T planned samples, gains (T,)) -> Score.

Slow samples will be masked as stuck, so sample t counts with weight gain_t^2 in [0, 1]; its noise variance is
sn^2/gain_t^2. All gains 1: no mask.
"""


def evaluate(
    criterion: Criterion, outputs: Sequence[Output], X: Array, gains: Array
) -> tuple[float, Array, Array]:
    """A criterion summed over outputs.

    Args:
        criterion: one of `criteria.CRITERIA`, or a function like them.
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
