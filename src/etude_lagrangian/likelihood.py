"""Likelihood of all commands together, and training of its hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.models.gp.hyperparameters import (
    AMPLITUDE_DEVIATION,
    INITIAL_NOISE,
    LENGTH_DEVIATION,
    NOISE_DEVIATION,
    NOISE_FRACTION,
    SLOPE_DEVIATION,
    Prior,
    negative_posterior,
    optimise,
)
from etude.models.gp.likelihood_algebra import solved
from etude.threads import threads_for
from etude.types import Array, Index
from etude_lagrangian.prior import JointPrior

WIDTHS = {"length": LENGTH_DEVIATION, "amplitude": AMPLITUDE_DEVIATION, "slope": SLOPE_DEVIATION}


@dataclass(frozen=True, eq=False)
class JointHyperparameters:
    """All that training moves, and the floors under it.

    Attributes:
        theta: (P,) of the prior.
        log_noise, floor: (J,): sn² = floor² + exp(2 log_noise), as of an exact process.
    """

    theta: Array
    log_noise: Array
    floor: Array

    @property
    def noise_variance(self) -> Array:
        """(J,) sn²."""
        return np.asarray(self.floor**2 + np.exp(2.0 * self.log_noise))

    @property
    def vector(self) -> Array:
        """(P + J,)."""
        return np.concatenate([self.theta, self.log_noise])

    def with_vector(self, vector: Array) -> JointHyperparameters:
        """Others above the same floors."""
        theta, log_noise = np.split(vector, [len(self.theta)])
        return JointHyperparameters(theta, log_noise, self.floor)


def joint_likelihood(
    prior: JointPrior, at: JointHyperparameters, X: Array, y: Array, used: Index
) -> tuple[float, Array]:
    """log p(y) of the entries that count, y (u,), at inputs X (n, D), and its gradient (P + J,).

    Raises:
        NumericalError: the covariance is indefinite.
    """
    command = used // len(X)
    with threads_for(len(used)):
        K = prior.gram(at.theta, X, used)
        K[np.diag_indices(len(K))] += at.noise_variance[command]
        solution = solved(K, 0.0, y)
        value = -0.5 * (solution.square + solution.log_det + len(y) * np.log(2.0 * np.pi))
        Q = np.ascontiguousarray(solution.weights + np.tril(solution.weights, -1).T)
        in_theta = prior.gram_gradient(at.theta, X, used, 0.5 * Q)
    traces = np.bincount(command, weights=Q.diagonal(), minlength=len(at.log_noise))
    return float(value), -np.concatenate([in_theta, np.exp(2.0 * at.log_noise) * traces])


def initial_hyperparameters(
    prior: JointPrior, X: Array, y: Array, used: Index, floor: Array
) -> tuple[JointHyperparameters, Prior]:
    """Where training begins, from the data's scales, and the weak prior around it."""
    command = used // len(X)
    power = np.bincount(command, weights=y * y, minlength=len(floor))
    scale = np.sqrt(power / np.maximum(np.bincount(command, minlength=len(floor)), 1))
    scale = np.where(scale > 0.0, scale, scale.max() if scale.max() > 0.0 else 1.0)
    half = 0.5 * np.ptp(X, axis=0)
    theta = prior.initial(np.where(half > 0.0, half, 1.0), scale)
    centre = np.concatenate([theta, np.log(NOISE_FRACTION * scale)])
    widths = [*(WIDTHS[role] for role in prior.roles()), *[NOISE_DEVIATION] * len(floor)]
    start = JointHyperparameters(theta, np.log(INITIAL_NOISE * scale), floor)
    return start, Prior(centre, np.array(widths))


def fit_joint(
    prior: JointPrior,
    start: JointHyperparameters,
    weak: Prior | None,
    X: Array,
    y: Array,
    used: Index,
    *,
    steps: int,
    method: Any = "lbfgs",
) -> JointHyperparameters:
    """The hyperparameters that explain the entries best, `steps` and `method` as `hyperparameters.fit`.

    Raises:
        NumericalError: the likelihood is not finite at the start.
    """
    if steps == 0:
        return start

    objective = negative_posterior(
        lambda vector: joint_likelihood(prior, start.with_vector(vector), X, y, used), weak
    )
    with threads_for(len(used)):
        return start.with_vector(optimise(objective, start.vector, method=method, steps=steps))
