"""Sparse Gaussian processes with inducing inputs: FITC (SPGP) and the variational VFE.

`FixedInducing` (Titsias 2009) takes hyperparameters as given. Nothing is optimised, so a fold is left out in
closed form. With V = L^-1 K_uf Λ^-1/2, Λ the samples' noise, A = I + V Vᵀ is a sum over folds, and what the
others teach is the sum without one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from etude._runtime.scipy_parts import dpotrs, dpstrf, dsyrk, dtrmm, dtrtrs
from etude.errors import NumericalError, UsageError
from etude.models.gp.basis_posterior import BasisPosterior, lower_root
from etude.models.gp.cholesky import factorise, triangular_inverse
from etude.models.gp.exact import ExactGP, checked_data
from etude.models.gp.kernels import Kernel, mean_signal, rest_variance
from etude.protocols import Posterior
from etude.threads import threads_for
from etude.types import Array, Index

Form = Literal["vfe", "fitc"]

LEAST_NOISE = 1e-10
"""Least sn² as a part of the prior variance; below it the sums over the data cancel to nothing."""

LEAST_VARIANCE = 1e-100
"""Least prior variance; the likelihood of outputs that are all zero grows for ever as it falls."""


LEAST_BLOCK = 64  # rows: in smaller blocks calls cost more than sums


def prior_gradient(
    kernel: Kernel, theta: Array, Z: Array, X: Array, on_uu: Array, on_uf: Array, on_diagonal: Array
) -> tuple[Array, Array]:
    """Gradient of sum(on_uu * k(Z, Z)) + sum(on_uf * k(Z, X)) + sum(on_diagonal * diag k(X, X)).

    Args:
        Z: (u, D) inducing inputs. X: (n, D) data.
        on_uu: (u, u), symmetric. on_uf: (u, n). on_diagonal: (n,).

    Returns:
        gradient in theta (P,) and in Z (u, D).
    """
    on_Z = 2.0 * kernel.input_gradient(theta, Z, Z, on_uu) + kernel.input_gradient(theta, Z, X, on_uf)
    return _theta_gradient(kernel, theta, Z, X, on_uu, on_uf, on_diagonal), on_Z


def _theta_gradient(
    kernel: Kernel, theta: Array, Z: Array, X: Array, on_uu: Array, on_uf: Array, on_diagonal: Array
) -> Array:
    """A kernel pulls weights back to theta from a Gram matrix only, so Z is stacked on about u rows of X at a
    time: 4 n u covariances in all, and no n x n matrix.
    """
    u, total = len(Z), np.zeros(kernel.size)
    size = max(u, LEAST_BLOCK)
    for first in range(0, len(X), size):
        block = slice(first, first + size)
        points = np.vstack([Z, X[block]])
        weights = np.zeros((len(points), len(points)), order="F")
        weights[u:, :u] = on_uf[:, block].T
        weights[np.arange(u, len(points)), np.arange(u, len(points))] = on_diagonal[block]
        if first == 0:
            weights[:u, :u] = on_uu
        total += kernel.theta_gradient(theta, points, weights)
    return total


@dataclass(frozen=True)
class InducingGP:
    """A Gaussian process of O(n u²) that knows the data through u inducing inputs Z; the caller centres y.

    Choose it when there are more samples than exact regression can carry (some thousands) and one model of
    all of them is wanted, trained in one go; u = 50-300 is usual. "vfe" (Titsias 2009) bounds the exact log
    likelihood from below, so it cannot overfit through Z, and approaches exact regression as u grows: the
    default wherever a variance is used. Its noise absorbs what Z cannot express. "fitc" (SPGP, Snelson and
    Ghahramani 2006) gives each sample its own extra noise: comparable with work of the thesis's era, but its
    likelihood can exceed the exact one, the learned noise is often too small and the variance then too
    confident between the samples. Variances of both return to the prior far from Z, so inputs that Z does not
    cover stay uncertain however many samples lie there: safe for design, pessimistic. Neither is calibrated
    by construction; check z² on held-out trajectories.

    Attributes:
        kernel: covariance function of the latent function.
        theta: (P,) its log hyperparameters.
        log_noise: log of the learned noise deviation.
        Z: (u, D) inducing inputs.
        form: "vfe" or "fitc".
        noise_floor: as in ExactGP, sn² = floor² + exp(2 log_noise).
        jitter: part of the mean prior variance at Z that is added to the diagonal of K_uu.
    """

    kernel: Kernel
    theta: Array
    log_noise: float
    Z: Array
    form: Form = "vfe"
    noise_floor: float = 0.0
    jitter: float = 1e-8

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", self.kernel.check(self.theta))
        Z = np.array(self.Z, dtype=float)
        if Z.ndim != 2 or not Z.size or not np.isfinite(Z).all():
            raise UsageError(f"inducing inputs must be a finite array (u, D), u >= 1; got shape {Z.shape}")
        object.__setattr__(self, "Z", Z)
        if self.form not in ("vfe", "fitc"):
            raise UsageError(f"unknown form {self.form!r} of an inducing-point model", next_step='Use "vfe".')
        if not np.isfinite(self.log_noise):
            raise UsageError(f"log_noise must be finite, got {self.log_noise}")
        for name in ("noise_floor", "jitter"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise UsageError(f"{name} must be a finite number >= 0, got {getattr(self, name)}")

    @property
    def noise_variance(self) -> float:
        """sn², floor included."""
        return float(self.noise_floor**2 + np.exp(2.0 * self.log_noise))

    @property
    def parameters(self) -> Array:
        """The kernel's theta, log_noise, and Z row by row: (P + 1 + u D,)."""
        return np.concatenate([self.theta, [self.log_noise], self.Z.ravel()])

    def with_parameters(self, parameters: Array) -> InducingGP:
        """The same model with another vector (P + 1 + u D,); UsageError if its length is wrong."""
        parameters = np.asarray(parameters, dtype=float)
        P = self.kernel.size
        if parameters.shape != (P + 1 + self.Z.size,):
            raise UsageError(
                f"expected {P} kernel hyperparameters, log_noise and {self.Z.size} coordinates of inducing "
                f"inputs, got a vector of shape {parameters.shape}"
            )
        Z = parameters[P + 1 :].reshape(self.Z.shape)
        return replace(self, theta=parameters[:P], log_noise=float(parameters[P]), Z=Z)

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]:
        """log q(y | X) of FITC, or the evidence lower bound of VFE, and its gradient (P + 1 + u D,).

        Raises DataError for unusable X (n, D) or y (n,), UsageError where D is not that of Z, NumericalError
        if a covariance is indefinite or sn² is below 1e-10 of the prior variance.
        """
        X, y = checked_data(X, y)
        with threads_for(len(self.Z)):
            solution = _Solution.of(self, X, y, announce=False)
            on_uu, on_uf, on_diagonal, on_noise = solution.weights()
            on_theta, on_Z = prior_gradient(self.kernel, self.theta, self.Z, X, on_uu, on_uf, on_diagonal)
            noise_gradient = 2.0 * np.exp(2.0 * self.log_noise) * on_noise
            return -solution.objective(), -np.concatenate([on_theta, [noise_gradient], on_Z.ravel()])

    def condition(self, X: Array, y: Array) -> BasisPosterior:
        """The posterior given X (n, D) and centred y (n,); errors as above."""
        X, y = checked_data(X, y)
        with threads_for(len(self.Z)):
            solution = _Solution.of(self, X, y, announce=True)
            # Kuu^-1 - B^-1 = L^-T (I - A^-1) L^-1; with A - I = U diag(p) Uᵀ the middle is U diag(p/(1+p)) Uᵀ
            p, U = np.linalg.eigh(solution.explained)
            p = np.maximum(p, 0.0)
            half = lower_root(p / (1.0 + p), U) @ solution.L_inverse
            weights = solution.L_inverse.T @ solution.beta
        return BasisPosterior(
            self.kernel,
            self.theta,
            self.noise_variance,
            float(solution.diagonal.mean()),
            self.Z,
            weights,
            np.asfortranarray(half),
        )


@dataclass(frozen=True, eq=False)
class _Solution:
    """What value, gradient and posterior share: S = Q + Λ, Q = VᵀV, V = L^-1 K_uf, through A = I + VΛ^-1Vᵀ.

    FITC: Λ = diag(K - Q) + sn² I. VFE: Λ = sn² I, and tr(K - Q)/(2 sn²) is added to the objective.

    Attributes:
        diagonal: (n,) diag K. missing: (n,) diag(K - Q). noises: (n,) diagonal of Λ.
        L_inverse: (u, u). V: (u, n). explained: (u, u) A - I. root: (u, u) Cholesky factor of A.
        beta: (u,) A^-1 V Λ^-1 y. alpha: (n,) S^-1 y = (y - Vᵀ beta)/Λ.
    """

    gp: InducingGP
    diagonal: Array
    L_inverse: Array
    V: Array
    missing: Array
    noises: Array
    explained: Array
    root: Array
    beta: Array
    alpha: Array

    @classmethod
    def of(cls, gp: InducingGP, X: Array, y: Array, *, announce: bool) -> _Solution:
        """Everything at O(n u²); a jitter beyond that of `gp` is announced or not, as `factorise` does."""
        diagonal = _checked_diagonal(gp, X)
        K_uu, _ = gp.kernel.gram(gp.theta, gp.Z)
        L, _ = factorise(K_uu, gp.jitter * float(K_uu.diagonal().mean()), announce=announce)
        L_inverse = triangular_inverse(L)
        V = L_inverse @ gp.kernel.value(gp.theta, gp.Z, X)
        missing = np.maximum(diagonal - np.einsum("un,un->n", V, V), 0.0)
        noises = gp.noise_variance + (missing if gp.form == "fitc" else np.zeros(len(y)))
        explained = (V / noises) @ V.T
        root, _ = factorise(np.asfortranarray(explained), 1.0, announce=announce)
        beta, _ = dpotrs(root, V @ (y / noises), lower=1)
        alpha = (y - V.T @ beta) / noises
        return cls(gp, diagonal, L_inverse, V, missing, noises, explained, root, beta, alpha)

    def objective(self) -> float:
        """-log q(y), or -ELBO. yᵀS^-1y = |y - Vᵀβ|²/Λ + |β|²: a sum of squares, so nothing cancels."""
        quadratic = float(self.alpha @ (self.noises * self.alpha)) + float(self.beta @ self.beta)
        log_det = float(np.log(self.noises).sum() + 2.0 * np.log(self.root.diagonal()).sum())
        value = 0.5 * (quadratic + log_det + len(self.alpha) * math.log(2.0 * math.pi))
        if self.gp.form == "fitc":
            return value
        return value + 0.5 * float(self.missing.sum()) / self.gp.noise_variance

    def weights(self) -> tuple[Array, Array, Array, float]:
        """Derivatives of the objective in K_uu (u, u), K_uf (u, n), diag K (n,) and sn².

        With M = S^-1 - αα' the objective moves by 1/2 tr(M dS). FITC takes the diagonal of Q out of S again,
        VFE adds tr(K - Q)/(2 sn²): either way dQ is weighted by 1/2 (M - diag w) and diag K by w/2.
        """
        scaled = self.V / self.noises
        solved, _ = dpotrs(self.root, scaled, lower=1)  # V S^-1 = A^-1 V Λ^-1
        diagonal = 1.0 / self.noises - np.einsum("un,un->n", scaled, solved) - self.alpha**2
        if self.gp.form == "fitc":
            w, on_noise = diagonal, 0.5 * float(diagonal.sum())
        else:
            noise = self.gp.noise_variance
            w = np.full(len(diagonal), 1.0 / noise)
            on_noise = 0.5 * float(diagonal.sum() - self.missing.sum() / noise**2)
        # V α = β, so the rank-one part of V M costs nothing
        on_uf = self.L_inverse.T @ (solved - np.outer(self.beta, self.alpha) - self.V * w)
        on_uu = -0.5 * (on_uf @ self.V.T) @ self.L_inverse
        on_uu[np.diag_indices_from(on_uu)] += self.gp.jitter * float(np.trace(on_uu)) / len(on_uu)
        return 0.5 * (on_uu + on_uu.T), on_uf, 0.5 * w, on_noise


def _checked_diagonal(gp: InducingGP, X: Array) -> Array:
    """diag k(X, X) (n,), after a look at what would make it useless."""
    if X.shape[1] != gp.Z.shape[1]:
        raise UsageError(f"inputs have {X.shape[1]} columns, the inducing inputs {gp.Z.shape[1]}")
    diagonal = gp.kernel.diagonal(gp.theta, X)
    if not LEAST_VARIANCE <= diagonal.mean() <= 1.0 / LEAST_VARIANCE:
        raise NumericalError(f"a prior variance of {diagonal.mean():.1e} leaves the floating-point range")
    if not gp.noise_variance >= LEAST_NOISE * diagonal.mean():
        raise NumericalError(
            f"noise variance {gp.noise_variance:.1e} is below {LEAST_NOISE:.0e} of the prior variance "
            f"{diagonal.mean():.1e}, too little for an inducing-point model",
            next_step="Set a noise floor.",
        )
    return diagonal


JITTER = 1e-8
"""Part of the mean prior variance at the inducing inputs that is added to their covariance."""
ROUNDING = 1e-10
"""Part of the prior that the posterior's variance may lose to rounding."""
UNEXPLAINED = 0.003
"""Part of the noise variance, or of the prior variance if that is less, that the other inducing inputs leave
at most of one that is left out. With 0.01, errors of simulated arms on new motion grew by up to 0.8 %."""


def telling_inputs(gp: ExactGP, Z: Array) -> Array:
    """(r, D) of the inputs (u, D), in their order: those that the others do not explain.

    A pivoted Cholesky factor takes next the input of which most is left (Harbrecht, Peters and Schneider
    2012), until no more than `UNEXPLAINED` is left of any.
    """
    K = np.asfortranarray(gp.kernel.value(gp.theta, Z, Z))
    most = UNEXPLAINED * min(gp.noise_variance, float(K.diagonal().mean()))
    _, order, rank, _ = dpstrf(K, tol=most, lower=1, overwrite_a=1)
    return np.asarray(Z[np.sort(order[: max(rank, 1)] - 1)])


@dataclass(frozen=True, eq=False)
class FixedInducing:
    """A process that sees samples X (n, D) through inducing inputs Z (u, D).

    Attributes:
        gp: kernel, hyperparameters and noise.
        fold: (n,) what each sample is left out with; None: nothing is.
        roots_without: by folds left out, the factor of what the others teach.
        solved: by folds left out and inputs, results of `_without`, for any outputs.
    """

    gp: ExactGP
    Z: Array
    X: Array
    fold: Index | None = None
    roots_without: dict[tuple[int, ...], Array] = field(default_factory=dict)
    solved: dict[tuple[tuple[int, ...], bytes], tuple[Array, Array]] = field(default_factory=dict)

    @cached_property
    def L_inverse(self) -> Array:
        """(u, u) inverse of the Cholesky factor of the covariance at Z, which no sample's own noise is in."""
        K = np.asfortranarray(self.gp.kernel.value(self.gp.theta, self.Z, self.Z))
        L, _ = factorise(K, JITTER * float(K.diagonal().mean()), announce=False)
        return triangular_inverse(L)

    @cached_property
    def roots(self) -> Array:
        """(n,) root of each sample's noise: s², and what friction holds at rest."""
        at_rest = rest_variance(self.gp.kernel, self.gp.theta, self.X)
        return np.asarray(np.sqrt(self.gp.noise_variance + at_rest))

    @cached_property
    def places(self) -> dict[int, Index]:
        """By fold, its samples: all of them in one if there are none."""
        fold = np.zeros(len(self.X), dtype=np.int64) if self.fold is None else self.fold
        return {number: np.flatnonzero(fold == number) for number in np.unique(fold).tolist()}

    @cached_property
    def parts(self) -> dict[int, Array]:
        """By fold, V (u, k) = L^-1 k(Z, X), each sample in deviations of its noise."""
        return {
            number: self._whitened(self.X[rows]) / self.roots[rows] for number, rows in self.places.items()
        }

    @cached_property
    def whole(self) -> Array:
        """(u, u) V Vᵀ of all samples, lower half."""
        total = np.zeros((len(self.Z), len(self.Z)), order="F")
        for V in self.parts.values():
            total = dsyrk(1.0, V, beta=1.0, c=total, lower=1, overwrite_c=1)
        return np.asarray(total)

    def posterior(self, y: Array) -> BasisPosterior:
        """Given y (n,)."""
        gp = self.gp
        with threads_for(len(self.Z)):
            root_inverse = triangular_inverse(factorise(self.whole, 1.0, announce=False)[0])
            beta = root_inverse.T @ (root_inverse @ self._projected(y[:, None], self.places)[:, 0])
            middle = -(root_inverse.T @ root_inverse)  # I - A^-1, its rows and columns reversed
            middle[np.diag_indices_from(middle)] += 1.0
            upper, _ = factorise(np.asfortranarray(middle[::-1, ::-1]), ROUNDING, announce=False)
            half = np.asfortranarray(upper.T[::-1, ::-1] @ self.L_inverse)
            signal = mean_signal(gp.kernel, gp.theta, self.X)
            weights = self.L_inverse.T @ beta
        return BasisPosterior(gp.kernel, gp.theta, gp.noise_variance, signal, self.Z, weights, half)

    def held_out(self, Y: Array, folds: Iterable[int], at: Array) -> tuple[Array, Array]:
        """Means (k, m) and variances (k,) with noise at inputs (k, D), from outputs (n, m) of other folds."""
        left_out = tuple(sorted(set(folds)))
        with threads_for(len(self.Z)):
            if (key := (left_out, at.tobytes())) not in self.solved:
                self.solved[key] = self._without(left_out, at)
            here, variance = self.solved[key]
            projected = self._projected(Y, [number for number in self.places if number not in left_out])
            return here.T @ dtrtrs(self._root(left_out), projected, lower=1)[0], variance

    def _without(self, left_out: tuple[int, ...], at: Array) -> tuple[Array, Array]:
        """Of inputs (k, D): A^-1/2 L^-1 k(Z, at) (u, k) of what other folds teach, and variances (k,) with
        noise.
        """
        gp, V = self.gp, self._whitened(at)
        missing = gp.kernel.diagonal(gp.theta, at) - np.einsum("un,un->n", V, V)
        here = np.asarray(dtrtrs(self._root(left_out), V, lower=1)[0])
        spread = np.einsum("un,un->n", here, here)
        return here, np.maximum(missing, 0.0) + spread + gp.noise_variance

    def _root(self, left_out: tuple[int, ...]) -> Array:
        """(u, u) lower factor of A without those folds."""
        if left_out not in self.roots_without:
            A = self.whole.copy(order="F")  # of all but a fold: less is rounded than jitter adds
            for number in set(left_out) & set(self.places):
                A = dsyrk(-1.0, self.parts[number], beta=1.0, c=A, lower=1, overwrite_c=1)
            self.roots_without[left_out] = factorise(A, 1.0, announce=False)[0]
        return self.roots_without[left_out]

    def _whitened(self, X: Array) -> Array:
        """(u, k) L^-1 k(Z, X) at X (k, D)."""
        K = self.gp.kernel.value(self.gp.theta, X, self.Z)  # its transposed is in Fortran order
        return np.asarray(dtrmm(1.0, self.L_inverse, K.T, lower=1, overwrite_b=1))

    def _projected(self, Y: Array, folds: Iterable[int]) -> Array:
        """(u, m) V y of those folds, of outputs Y (n, m)."""
        total = np.zeros((len(self.Z), Y.shape[1]))
        for number in folds:
            rows = self.places[number]
            total += self.parts[number] @ (Y[rows] / self.roots[rows, None])
        return total


@dataclass(frozen=True, eq=False)
class Induced:
    """How outputs are conditioned (a `process.Condition`), and held out without learning again.

    Attributes:
        gp: with its hyperparameters. Z: (u, D) inducing inputs. X: (n, D) samples that teach.
        taught: (n,) their positions. fold: of every sample, what it is held out with.
    """

    gp: ExactGP
    Z: Array
    X: Array
    taught: Index
    fold: Index

    def __call__(self, X: Array, Y: Array) -> tuple[Posterior, ...]:
        """A posterior for each output (n, m)."""
        fixed = _fixed(self) if X.shape == self.X.shape else FixedInducing(self.gp, self.Z, X)
        return tuple(fixed.posterior(np.ascontiguousarray(y)) for y in Y.T)

    def held_out(self, X: Array, fold: Index, Y: Array) -> tuple[Array, Array]:
        """Means and variances with noise (k, m) at inputs X (k, D) from the samples of other folds.

        Args:
            fold: numbers of those left out. Y: (N, m) outputs of every sample.
        """
        mean, variance = _fixed(self).held_out(Y[self.taught], fold.tolist(), X)
        return mean, np.repeat(variance[:, None], mean.shape[1], axis=1)


@lru_cache(maxsize=1)
def _fixed(induced: Induced) -> FixedInducing:
    """What all its folds share: tens of megabytes, so only the latest stays."""
    return FixedInducing(induced.gp, induced.Z, induced.X, induced.fold[induced.taught])
