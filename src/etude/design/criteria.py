"""Design criteria: how much a batch of planned samples would teach one output of the model.

A criterion is a function of covariances and returns its value and its derivatives with respect to them; the
chain from covariances to inputs is the same for all and lives in `score.evaluate`. To add one, write such a
function, with an attribute `needs = "reference"` if it looks at reference states, or `needs = "identified"`
if it judges the identified model's parameters, and name it: by an entry point in `etude.criteria`, or in a
campaign as "module:function". `etude.testing.CriterionSuite` checks its gradient and what else it owes.
Here are the criteria that count variances; those that count nats are in `information`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude import plugins
from etude.design.batch import Batch
from etude.design.config import GROUP
from etude.design.information import d_opt, info_gain, mi_region, sum_log
from etude.design.score import Criterion, Output, Score, evaluate, needing, value_of
from etude.errors import UsageError
from etude.models.gp.cholesky import solved_in_place
from etude.types import Array

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
"""Part of the signal variance that `log_ivr` adds, so that states known already stop paying."""


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
        UsageError: there is none, it cannot be loaded, it is no function, or it needs what no design has.
    """
    criterion: Criterion = plugins.load(GROUP, name)
    if needs_of(criterion) not in ("", "reference", "identified"):
        raise UsageError(
            f"the criterion {name!r} needs {needs_of(criterion)!r}; a design has 'reference' and 'identified'"
        )
    return criterion


def needs_of(criterion: Criterion) -> str:
    """What it needs: "reference", "identified", or "" for a criterion that needs neither."""
    return str(getattr(criterion, "needs", ""))


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
