"""Process of all commands of a robot together, given the entries that count (`protocols.Process`)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np

from etude._runtime.scipy_parts import dpotrs, dtrmm
from etude.errors import DataError, UsageError
from etude.models.gp.cholesky import factorise, inverse_lower, triangular_inverse
from etude.models.gp.covariance_factors import blocks
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.models.gp.kernel_algebra import Kernel, Of
from etude.models.gp.single_point import PointMean
from etude.protocols import FitData, Posterior
from etude.threads import threads_for
from etude.types import Array, Code, Column, Index, Mask
from etude_lagrangian.likelihood import JointHyperparameters
from etude_lagrangian.prior import JointPrior

FEW = 4
"""One of so many instants bounds the deviations."""
BLOCK = 64
"""Inputs predicted at once: a few megabytes of covariances."""


class Expansion(NamedTuple):
    """Mean of an addition: what `PointMean` takes."""

    kernel: Kernel
    theta: Array
    X: Array
    alpha: Array


@dataclass(frozen=True, eq=False)
class JointProcess:
    """One energy for J commands, and additions of each.

    Attributes:
        prior: see there. at: its hyperparameters.
        X: (n, D) inputs that it is conditioned on. Y: (n, J). counts: (n, J) which entries of Y count.
        columns, commands: what the prior was made for.
        fit, rows: what it learned from, and the positions of X there; None of a stored process.
    """

    prior: JointPrior
    at: JointHyperparameters
    X: Array
    Y: Array
    counts: Mask
    columns: tuple[Column, ...]
    commands: tuple[str, ...]
    fit: FitData | None = field(default=None, repr=False)
    rows: Index | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not self.counts.any():
            raise DataError("no entry of any command can be used", next_step="Record a longer motion.")

    @property
    def noise_variance(self) -> Array:
        """(J,) sn²."""
        return self.at.noise_variance

    @property
    def conditioned_on(self) -> Array:
        """(n, D) X."""
        return self.X

    @cached_property
    def signal_variance(self) -> Array:
        """(J,) mean of the prior variances over the inputs."""
        return np.asarray(self.prior.diagonal(self.at.theta, self.X).mean(axis=0))

    @cached_property
    def used(self) -> Index:
        """(u,) positions of the entries that count, by command and then by instant."""
        return np.flatnonzero(self.counts.T)

    @cached_property
    def L(self) -> Array:
        """(u, u) lower Cholesky factor of the covariance of the entries, noise included."""
        with threads_for(len(self.used)):
            K = self.prior.gram(self.at.theta, self.X, self.used)
            K[np.diag_indices(len(K))] += self.noise_variance[self.used // len(self.X)]
            return factorise(K, 0.0)[0]

    @cached_property
    def inverse(self) -> Array:
        """(u, u) of that covariance."""
        with threads_for(len(self.used)):
            W = inverse_lower(self.L.copy(order="F"))
            return W + np.tril(W, -1).T

    @cached_property
    def L_inverse(self) -> Array:
        """(u, u), lower."""
        return triangular_inverse(self.L)

    @cached_property
    def alpha(self) -> Array:
        """(J, n) weights of the entries in every mean, 0 where an entry does not count."""
        return self._spread(dpotrs(self.L, self._entries(self.Y), lower=1)[0])

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Means and latent variances (T, J) at X (T, D)."""
        return self.mean(X), self._variance(X, self.X, self.used, self.L_inverse)

    def at_most(self, X: Array) -> tuple[Array, Array]:
        """Means (T, J), and variances given a few of the instants: never below those of `predict`."""
        return self.mean(X), self._variance(X, *self._variance_subset)

    @cached_property
    def _variance_subset(self) -> tuple[Array, Index, Array]:
        """Every `FEW`th instant with an entry, the entries there, and their covariance's inverse factor."""
        instants = np.flatnonzero(self.counts.any(axis=1))[::FEW]
        X, used = np.ascontiguousarray(self.X[instants]), np.flatnonzero(self.counts[instants].T)
        with threads_for(len(used)):
            K = self.prior.gram(self.at.theta, X, used)
            K[np.diag_indices(len(K))] += self.noise_variance[used // len(X)]
            return X, used, triangular_inverse(factorise(K, 0.0)[0])

    def _variance(self, X: Array, Z: Array, used: Index, L_inverse: Array) -> Array:
        """(T, J) latent variances at X (T, D), given the entries `used` at instants Z (n, D)."""
        J, variance = len(self.commands), np.empty((len(X), len(self.commands)))
        with threads_for(len(used)):
            prior = self.prior.diagonal(self.at.theta, X)
            for first in range(0, len(X), BLOCK):
                here = slice(first, first + BLOCK)
                K = self.prior.cross(self.at.theta, X[here], Z, used)
                V = dtrmm(1.0, L_inverse, K, side=1, lower=1, trans_a=1, overwrite_b=1)
                reduced = np.einsum("tu,tu->t", V, V).reshape(J, -1).T
                variance[here] = np.maximum(prior[here] - reduced, 0.0)
        return variance

    def mean(self, X: Array) -> Array:
        """Means (T, J) alone: O(J²) for each pair of inputs."""
        out = self._lagrangian_means(self.prior.joints.packed(X))
        for rows in blocks(len(X)):
            for added, sums in zip(out, self._sums, strict=True):
                added[rows] += sums(X[rows])
        return out.T

    def point(self) -> Callable[[Array], Array]:
        """x (D,) -> means (J,), compiled: for a controller's tick; not for several threads at once."""
        pairs = zip(self.prior.additions, self._addition_thetas, self.alpha, strict=True)
        additions = PointMean([Expansion(kernel, theta, self.X, alpha) for kernel, theta, alpha in pairs])

        def mean(x: Array) -> Array:
            added = additions(x)  # refuses another shape
            return added + self._lagrangian_means(self.prior.joints.packed(x[None]))[:, 0]

        return mean

    def latents(self) -> Sequence[tuple[Posterior, tuple[int, ...]]]:
        """A process of each command alone, with the shared hyperparameters: what designs can afford."""
        return [(posterior, (j,)) for j, posterior in enumerate(self.own)]

    @cached_property
    def own(self) -> tuple[ExactPosterior, ...]:
        """Those processes. DataError if no entry of a command counts."""
        posteriors = []
        for j in range(len(self.commands)):
            kernel, theta = self.prior.one(self.at.theta, j)
            rows, noise = self.counts[:, j], float(self.noise_variance[j])
            posteriors.append(posterior_given(kernel, theta, noise, self.X[rows], self.Y[rows, j]))
        return tuple(posteriors)

    def held_out(self, own: Index, Y: Array | None = None) -> tuple[Array, Array]:
        """Means and variances with noise (k, J) at the samples `own` from those of other folds, closed form.

        Entries that it is not conditioned on are predicted too: those of instants that were thinned out or of
        joints at rest.

        Args:
            own: positions of samples that were kept, all in one fold.
            Y: (n, J) outputs to predict from, if not those that it was taught.

        Raises:
            UsageError: a stored process, which keeps only what it predicts from.
        """
        if self.fit is None or self.rows is None:
            raise UsageError("a stored process cannot be held out", next_step="Train the model again.")
        J, n = len(self.commands), len(self.X)
        folds = np.unique(self.fit.fold[own])
        entry_row = self.rows[self.used % n]  # of each entry that counts
        out = np.flatnonzero(np.isin(self.fit.fold[entry_row], folds))
        with threads_for(len(self.used)):
            left = self._leave_out(out, None if Y is None else Y[self.rows])
        mean, variance = np.full((J, len(own)), np.nan), np.full((J, len(own)), np.nan)
        command, place = self.used[out] // n, _places(own, entry_row[out])
        inside = place >= 0
        mean[command[inside], place[inside]] = left.mean[inside]
        variance[command[inside], place[inside]] = left.variance[inside]
        incomplete = np.flatnonzero(np.isnan(mean).any(axis=0))
        if len(incomplete):
            missing = np.isnan(mean[:, incomplete])
            more = self._at_new_inputs(self.fit.X[own[incomplete]], left)
            mean[:, incomplete] = np.where(missing, more[0].T, mean[:, incomplete])
            variance[:, incomplete] = np.where(missing, more[1].T, variance[:, incomplete])
        return mean.T, variance.T

    def arrays(self) -> Mapping[str, Array]:
        """Everything that it predicts from; the metadata are JSON in bytes."""
        metadata = {"columns": [list(column) for column in self.columns], "commands": list(self.commands)}
        return {
            "words": cast("Array", np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)),
            "theta": self.at.theta,
            "log_noise": self.at.log_noise,
            "floor": self.at.floor,
            "X": self.X,
            "Y": self.Y,
            "counts": cast("Array", self.counts),
        }

    def c(self, name: str) -> Code:
        """C99 of it, with variances. UnwritableError if an addition has none."""
        from etude_lagrangian.c99 import joint_code

        return joint_code(name, self)

    @cached_property
    def _addition_thetas(self) -> list[Array]:
        return self.prior.split(self.at.theta)[1]

    @cached_property
    def _sums(self) -> list[Of]:
        terms = zip(self.prior.additions, self._addition_thetas, self.alpha, strict=True)
        return [kernel.sums(theta, self.X, alpha) for kernel, theta, alpha in terms]

    @cached_property
    def _packed(self) -> tuple[Array, Array]:
        return self.prior.split(self.at.theta)[0], self.prior.joints.packed(self.X)

    def _lagrangian_means(self, F: Array) -> Array:
        from etude_lagrangian.all_outputs import means_all

        p, fixed = self._packed
        out = np.empty((len(self.commands), F.shape[2]))
        means_all(p, F, fixed, self.alpha, out)
        return out

    def _entries(self, Y: Array) -> Array:
        return np.ascontiguousarray(Y.T).ravel()[self.used]

    def _spread(self, entries: Array) -> Array:
        out = np.zeros(len(self.commands) * len(self.X))
        out[self.used] = entries
        return out.reshape(len(self.commands), len(self.X))

    def _leave_out(self, out: Index, Y: Array | None) -> _Reduced:
        """The entries at the positions `out` of `used`, from all others."""
        W, y = self.inverse, self._entries(self.Y if Y is None else Y)
        alpha = W @ y
        if not len(out):
            return _Reduced(np.zeros(0), np.zeros(0), alpha, np.zeros((0, len(W))))
        block, _ = factorise(np.asfortranarray(W[np.ix_(out, out)]), 0.0)
        half = triangular_inverse(block)
        error = half.T @ (half @ alpha[out])
        variance = np.einsum("ij,ij->j", half, half)
        return _Reduced(y[out] - error, variance, alpha - W[:, out] @ error, half @ W[out])

    def _at_new_inputs(self, X: Array, left: _Reduced) -> tuple[Array, Array]:
        """Means and variances with noise (k, J) at X (k, D) from the entries that were not left out."""
        J = len(self.commands)
        K = self.prior.cross(self.at.theta, X, self.X, self.used)
        V = dtrmm(1.0, self.L_inverse, K, side=1, lower=1, trans_a=1)
        reduced = np.einsum("tu,tu->t", V, V)
        regained = K @ left.half.T
        explained = (reduced - np.einsum("ta,ta->t", regained, regained)).reshape(J, -1).T
        latent = np.maximum(self.prior.diagonal(self.at.theta, X) - explained, 0.0)
        return (K @ left.alpha).reshape(J, -1).T, latent + self.noise_variance


class _Reduced(NamedTuple):
    """Entries left out, (a,) each, and what predicts elsewhere without them.

    With W the inverse, A those left out, B the others: K_BB^-1 y_B = α - W_:A W_AA^-1 α_A (0 at A), and
    K_BB^-1 = W - W_:A W_AA^-1 W_A: (0 outside B).
    """

    mean: Array
    variance: Array
    alpha: Array
    half: Array


def _places(targets: Index, rows: Index) -> Index:
    """Position of each of `rows` in `targets`, which increase; -1 where it is absent."""
    place = np.minimum(np.searchsorted(targets, rows), len(targets) - 1)
    return np.where(targets[place] == rows, place, -1)
