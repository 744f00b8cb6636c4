"""Exact process of several outputs that share kernel, noise and Cholesky factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude._runtime.scipy_parts import dtrmm
from etude.errors import DataError, NumericalError
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactGP, ExactPosterior, checked_outputs, posterior_given
from etude.models.gp.hyperparameters import Method, Prior, negative_posterior, optimise
from etude.models.gp.kernels import Kernel
from etude.models.gp.likelihood_algebra import solved
from etude.threads import threads_for
from etude.types import Array


def shared_likelihood(gp: ExactGP, X: Array, Y: Array) -> tuple[float, Array]:
    """Sum over the columns of Y (n, m) of log p(y_j | X), and its gradient (P + 1,) in `gp.parameters`.

    One factorisation and one inverse serve all columns: the gradient sees them only through Σ_j α_j α_jᵀ.
    DataError for unusable X or Y, NumericalError if the covariance is indefinite.
    """
    X, Y = _matrix(X, Y)
    n, m = Y.shape
    with threads_for(n):
        K, vjp = gp.kernel.gram_lower(gp.theta, X)
        solution = solved(K, gp.noise_variance, Y)
        value = -0.5 * (solution.square + m * (solution.log_det + n * np.log(2.0 * np.pi)))
        in_theta, in_noise = solution.slopes(vjp)
        return value, -np.append(in_theta, 2.0 * np.exp(2.0 * gp.log_noise) * in_noise)


def fit_shared(
    gp: ExactGP,
    X: Array,
    Y: Array,
    *,
    steps: int = 60,
    method: Method = "lbfgs",
    prior: Prior | None = None,
    others: Sequence[Array] = (),
) -> ExactGP:
    """The hyperparameters that explain all centred columns of Y (n, m) best, from several starts.

    Args:
        gp: the first start; gives kernel and noise floor.
        steps, method: as `hyperparameters.fit`.
        others: further starts, vectors like `gp.parameters`; the best end wins.

    Raises:
        DataError: unusable X or Y. NumericalError: the likelihood is finite at no start.
    """
    X, Y = _matrix(X, Y)
    if steps == 0:
        return gp

    objective = negative_posterior(lambda p: shared_likelihood(gp.with_parameters(p), X, Y), prior)
    best, refused = None, None
    for start in (gp.parameters, *others):
        try:
            end = optimise(objective, start, method=method, steps=steps)
        except NumericalError as error:
            refused = error
            continue
        value, _ = objective(end)
        if best is None or value < best[0]:
            best = value, end
    if best is None:
        assert refused is not None
        raise refused
    return gp.with_parameters(best[1])


@dataclass(frozen=True, eq=False)
class SharedPosterior:
    """m processes with the same hyperparameters, conditioned on the same inputs.

    Attributes:
        outputs: one posterior for each column; kernel, X and L are the same objects in all.
    """

    outputs: tuple[ExactPosterior, ...]

    @property
    def noise_variance(self) -> float:
        return self.outputs[0].noise_variance

    @property
    def signal_variance(self) -> float:
        return self.outputs[0].signal_variance

    @property
    def alpha(self) -> Array:
        """(n, m) K_y^-1 Y."""
        return np.column_stack([posterior.alpha for posterior in self.outputs])

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Means (T, m), and the latent variance (T,), which is the same for all."""
        first = self.outputs[0]
        with threads_for(len(first.X)):
            factors = first.factors(X)
            return factors.K @ self.alpha, factors.variance()

    @threads_for(0)  # the products are as narrow as the inputs
    def mean(self, X: Array) -> Array:
        """Means (T, m) alone."""
        first = self.outputs[0]
        return np.asarray(first.kernel.value(first.theta, first._inputs(X), first.X) @ self.alpha)

    def held_out(self, places: NDArray[np.int64], Y: Array | None = None) -> tuple[Array, Array]:
        """Means (k, m) at the samples `places` from all others, and variances (k,) with noise, closed form.

        Args:
            Y: (n, m) outputs to predict from, if not those that the processes were conditioned on: hold out
                a flight of a residual, of which the mean function has not seen that flight either.
        """
        first = self.outputs[0]
        targets = np.column_stack([posterior.y for posterior in self.outputs]) if Y is None else Y
        with threads_for(len(first.X)):
            W = first.inverse
            alpha = self.alpha[places] if Y is None else W[places] @ targets
            block, _ = factorise(np.asfortranarray(W[np.ix_(places, places)]), 0.0)
            half = triangular_inverse(block)
            return targets[places] - half.T @ (half @ alpha), np.einsum("ij,ij->j", half, half)

    def elsewhere(self, out: NDArray[np.int64], X: Array, Y: Array | None = None) -> tuple[Array, Array]:
        """Means (k, m) at X (k, D) from all samples but those at `out`, and variances (k,) with noise.

        With W the inverse of all, that of the rest is W - W_o W_oo^-1 W_oᵀ.
        """
        first = self.outputs[0]
        targets = np.column_stack([posterior.y for posterior in self.outputs]) if Y is None else Y
        with threads_for(len(first.X)):
            W, K = first.inverse, first.kernel.value(first.theta, X, first.X)
            half = np.zeros((0, len(W)))
            if len(out):
                block, _ = factorise(np.asfortranarray(W[np.ix_(out, out)]), 0.0)
                half = triangular_inverse(block) @ W[out]
            left = K @ half.T
            mean = K @ (W @ targets) - left @ (half @ targets)
            V = dtrmm(1.0, first.L_inverse, K.T, lower=1, overwrite_b=1)
            explained = np.einsum("nk,nk->k", V, V) - np.einsum("ko,ko->k", left, left)
        latent = np.maximum(first.kernel.diagonal(first.theta, X) - explained, 0.0)
        return mean, latent + first.noise_variance


def condition_shared(gp: ExactGP, X: Array, Y: Array) -> SharedPosterior:
    """The processes given X (n, D) and centred outputs Y (n, m); errors as `ExactGP.condition`."""
    return shared_posterior(gp.kernel, gp.theta, gp.noise_variance, X, Y)


def shared_posterior(
    kernel: Kernel, theta: Array, noise_variance: float, X: Array, Y: Array
) -> SharedPosterior:
    """The same of hyperparameters theta (P,) and sn²."""
    X, Y = _matrix(X, Y)
    first = posterior_given(kernel, theta, noise_variance, X, Y[:, 0].copy())
    outputs = [first]
    for y in Y.T[1:]:
        other = replace(first, y=y.copy())
        # factor and triangular inverse are made once, and every output's cache refers to them
        other.__dict__.update(factor=first.factor, L_inverse=first.L_inverse)
        outputs.append(other)
    return SharedPosterior(tuple(outputs))


def _matrix(X: Array, Y: Array) -> tuple[Array, Array]:
    if np.ndim(Y) != 2:
        raise DataError(f"training needs outputs (n, m), m >= 1; got {np.shape(Y)}")
    return checked_outputs(X, Y)
