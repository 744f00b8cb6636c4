"""Processes of the family: a posterior for each command of a group, and its cross-validation."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from etude.errors import UsageError
from etude.models.forms import posterior_arrays, posterior_metadata, posterior_of
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.kernels import rests
from etude.models.gp.shared_exact import SharedPosterior, shared_posterior
from etude.models.process_abilities import (
    HasInputs,
    HasKernel,
    SupportsBound,
    SupportsClosedForm,
    SupportsMeans,
    SupportsSamples,
    SupportsSharedFactor,
)
from etude.protocols import FitData, Posterior
from etude.types import Array, Code, Index

WORDS = "words"
Condition = Callable[[Array, Array], tuple[Posterior, ...]]


@dataclass(frozen=True, eq=False)
class Teaching:
    """A member with its hyperparameters, before it is conditioned.

    Attributes:
        fit: what it learns from.
        condition: inputs (n, D) and outputs (n, m) -> m posteriors.
        taught: positions of the samples to condition on.
        guides: of a member without covariances, exact posteriors that a design sees in its place.
    """

    fit: FitData
    condition: Condition
    taught: Index
    guides: tuple[Posterior, ...] = ()

    def on(self, rows: Index, Y: Array) -> Posteriors:
        """Conditioned on the samples at `rows`."""
        return Posteriors(self.condition(self.fit.X[rows], Y[rows]), self.guides)


@dataclass(frozen=True, eq=False)
class Posteriors:
    """One posterior for each of m commands (implements `protocols.Process`).

    Attributes:
        own: the posteriors; those of one kernel share their factor.
        guides: for members without covariances, m posteriors that designs see; else none.
        teaching: how it was learned, to be learned again without a fold; None of a stored process.
    """

    own: tuple[Posterior, ...]
    guides: tuple[Posterior, ...] = ()
    teaching: Teaching | None = field(default=None, repr=False)

    @property
    def noise_variance(self) -> Array:
        """(m,) sn² of the commands."""
        return np.array([posterior.noise_variance for posterior in self.own])

    @property
    def signal_variance(self) -> Array:
        """(m,) prior variance of the commands, averaged over the inputs."""
        return np.array([posterior.signal_variance for posterior in self.own])

    @property
    def rests(self) -> tuple[tuple[tuple[int, float], ...], ...]:
        """Of each command the noise at rest that its latent variance holds, as `kernels.rests`."""
        return tuple(rests(p.kernel, p.theta) if isinstance(p, HasKernel) else () for p in self.own)

    @property
    def conditioned_on(self) -> Array | None:
        """(k, D) inputs that a posterior, or its substitute for designs, stores; None if none."""
        for posterior in (*self.own, *self.guides):
            if isinstance(posterior, SupportsSamples):
                return np.asarray(posterior.X)
            if isinstance(posterior, BasisPosterior):
                return np.asarray(posterior.basis)
        return None

    @property
    def shared(self) -> SharedPosterior | None:
        """The posteriors as one, if they are exact and of one factor."""
        first = self.own[0]
        if not isinstance(first, ExactPosterior):
            return None
        others = self.own[1:]
        if not all(isinstance(posterior, ExactPosterior) and posterior.L is first.L for posterior in others):
            return None
        return SharedPosterior(cast("tuple[ExactPosterior, ...]", self.own))

    def latents(self) -> Sequence[tuple[Posterior, tuple[int, ...]]]:
        """What designs see: one posterior for each covariance, with its commands."""
        posteriors = self.guides or self.own
        if (
            len(posteriors) == 1
        ):  # its factor, which is made when asked for, is not needed to tell it from others
            return [(posteriors[0], (0,))]
        groups: dict[int, tuple[Posterior, list[int]]] = {}
        for place, posterior in enumerate(posteriors):
            key = id(posterior.L if isinstance(posterior, SupportsSharedFactor) else posterior)
            groups.setdefault(key, (posterior, []))[1].append(place)
        return [(posterior, tuple(places)) for posterior, places in groups.values()]

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Means and latent variances (T, m) at X (T, D)."""
        shared = self.shared
        if shared is not None and len(self.own) > 1:
            mean, variance = shared.predict(X)
            return mean, np.repeat(variance[:, None], len(self.own), axis=1)
        pairs = [posterior.predict(X) for posterior in self.own]
        return np.stack([m for m, _ in pairs], axis=1), np.stack([v for _, v in pairs], axis=1)

    def at_most(self, X: Array) -> tuple[Array, Array]:
        """Means (T, m), and latent variances (T, m) that are at least those of `predict`, for less."""
        if len(self.own) > 1:
            return self.predict(X)
        posterior = self.own[0]
        mean, variance = (
            posterior.at_most(X) if isinstance(posterior, SupportsBound) else posterior.predict(X)
        )
        return mean[:, None], variance[:, None]

    def mean(self, X: Array) -> Array:
        """Means (T, m) alone, without the price of their variances."""
        shared = self.shared
        if shared is not None and len(self.own) > 1:
            return shared.mean(X)
        means = [p.mean(X) if isinstance(p, SupportsMeans) else p.predict(X)[0] for p in self.own]
        return np.stack(means, axis=1)

    def held_out(self, own: Index, Y: Array | None = None) -> tuple[Array, Array]:
        """Means and variances with noise (k, m) at the samples `own` from those of other folds.

        In closed form if the process is exact, or sees all samples through some; else by learning again
        without the fold.

        Args:
            own: positions of samples, all in one fold.
            Y: (n, m) outputs to predict from, if not those that it was taught.

        Raises:
            UsageError: a stored process, which keeps only what it predicts from.
        """
        if self.teaching is None:
            raise UsageError("a stored process cannot be held out", next_step="Train the model again.")
        fit, taught, shared = self.teaching.fit, self.teaching.taught, self.shared
        outputs = fit.Y if Y is None else Y
        if shared is not None and taught is fit.kept and np.isin(own, taught).all():
            places = np.searchsorted(taught, own)
            mean, variance = shared.held_out(places, None if Y is None else outputs[taught])
            return mean, np.repeat(variance[:, None], len(self.own), axis=1)
        numbers = np.unique(fit.fold[own])
        if shared is not None and taught is fit.kept:
            out = np.flatnonzero(np.isin(fit.fold[taught], numbers))
            mean, variance = shared.elsewhere(out, fit.X[own], None if Y is None else outputs[taught])
            return mean, np.repeat(variance[:, None], len(self.own), axis=1)
        condition: object = self.teaching.condition
        if isinstance(condition, SupportsClosedForm):
            return condition.held_out(fit.X[own], numbers, outputs)
        other = taught[~np.isin(fit.fold[taught], numbers)]
        without = self.teaching.on(other, outputs)
        mean, latent = without.predict(fit.X[own])
        return mean, latent + without.noise_variance

    def arrays(self) -> Mapping[str, Array]:
        """Everything that it predicts from; the metadata are JSON in bytes."""
        shared, parts = self.shared, [*self.own, *self.guides]
        metadata: dict[str, Any] = {"own": len(self.own), "forms": [posterior_metadata(p) for p in parts]}
        metadata["shared"] = shared is not None and len(self.own) > 1
        arrays = {f"{i}.{name}": a for i, p in enumerate(parts) for name, a in posterior_arrays(p).items()}
        return {WORDS: cast("Array", np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)), **arrays}

    def c(self, name: str) -> Code:
        """C99 of it, with variances. UnwritableError if a posterior or a kernel has none."""
        from etude.models.c99 import posteriors_code

        return posteriors_code(name, self.own)


def taught(teaching: Teaching) -> Posteriors:
    """The process on all samples that its member takes."""
    process = teaching.on(teaching.taught, teaching.fit.Y)
    return Posteriors(process.own, process.guides, teaching)


def restored(arrays: Mapping[str, Array]) -> Posteriors:
    """The process whose `arrays` these are; its predictions are the same bits.

    Raises:
        KeyError, ValueError, TypeError: something is missing or of an unknown form.
    """
    metadata = json.loads(bytes(arrays[WORDS]))
    parts = [posterior_of(form, arrays, f"{i}.") for i, form in enumerate(metadata["forms"])]
    posteriors = tuple(parts[: metadata["own"]])
    if metadata["shared"]:
        first = cast("ExactPosterior", posteriors[0])
        Y = np.column_stack([cast("ExactPosterior", posterior).y for posterior in posteriors])
        posteriors = shared_posterior(first.kernel, first.theta, first.noise_variance, first.X, Y).outputs
    return Posteriors(posteriors, tuple(parts[metadata["own"] :]))


@dataclass(frozen=True, eq=False)
class Silent:
    """Beside a mean that predicts alone: says nothing itself, but knows where the robot has not been.

    Implements `protocols.Process` in the units of another process: a mean of zero, and a variance found on
    motion held out.

    Attributes:
        own: that process of the same commands, which designs see; None if there is none.
        calibration: (m,) of its variances.
        least: (m,) variance of the mean's errors on motion held out.
        prior: (m,) variance of what the mean was to explain.
        grows: whether the variance is that of `own` where this is larger: a linear trend goes on for ever.
    """

    own: Any
    calibration: Array
    least: Array
    prior: Array
    grows: bool

    @property
    def noise_variance(self) -> Array:
        """Zero (m,): all of it is in the variance."""
        return np.zeros_like(self.least)

    @property
    def signal_variance(self) -> Array:
        """(m,) variance before any data."""
        return self.prior

    @property
    def conditioned_on(self) -> Array | None:
        """(k, D) inputs of `own`, if it has some."""
        return self.own.conditioned_on if isinstance(self.own, HasInputs) else None

    def latents(self) -> Sequence[tuple[Posterior, tuple[int, ...]]]:
        """Those of `own`."""
        return (
            ()
            if self.own is None
            else cast("Sequence[tuple[Posterior, tuple[int, ...]]]", self.own.latents())
        )

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Zero, and the variance, (T, m)."""
        variance = np.tile(self.least, (len(X), 1))
        if self.grows and self.own is not None:
            latent = self.own.predict(X)[1] + self.own.noise_variance
            variance = np.maximum(self.calibration * latent, variance)
        return np.zeros_like(variance), variance

    def mean(self, X: Array) -> Array:
        """Zero (T, m)."""
        return np.zeros((len(X), len(self.least)))

    def held_out(self, own: Index, Y: Array | None = None) -> tuple[Array, Array]:  # noqa: ARG002
        """Zero, and the variance, (k, m)."""
        return np.zeros((len(own), len(self.least))), np.tile(self.least, (len(own), 1))

    def arrays(self) -> Mapping[str, Array]:
        """All but `own`."""
        names = ("calibration", "least", "prior")
        return {name: getattr(self, name) for name in names} | {"grows": np.array(float(self.grows))}

    def c(self, name: str) -> Code:
        """C99 of it. Errors as those of `own`."""
        from etude.models.c99 import silent_code

        return silent_code(name, self)
