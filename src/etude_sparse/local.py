"""Local Gaussian processes (Nguyen-Tuong, Seeger and Peters 2009): many small exact processes, blended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import DataError, UsageError
from etude.models.gp.exact import ExactGP, ExactPosterior, checked_data
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, SquaredExponential
from etude.types import Array, Index
from etude_sparse.dictionary_stream import DictionaryConfig
from etude_sparse.local_posterior import LEAST_VARIANCE, Blend, LocalPosterior, blended, combined

if TYPE_CHECKING:
    from etude_sparse.dictionary_stream import DictionaryStream


OVERFLOW = 0.1
"""Share of the samples that may find their part full."""
MOST_TRIED, HALVINGS = 1000, 12
"""Samples and steps of the search for parts that fit."""
EVERYTHING = 4.0
"""Squared reach, in largest squared distances from the mean, with which one part holds all."""


def kernel_lengths(kernel: Kernel, theta: Array) -> Array:
    """Lengths (D,) of the kernel's squared exponential of most inputs, by input.

    Raises:
        UsageError: no part of the kernel is a squared exponential of all its inputs.
    """
    thetas = {
        part.dims: part_theta
        for part, part_theta in _parts(kernel, theta)
        if isinstance(part, SquaredExponential)
    }
    width = 1 + max(max(part.dims) for part, _ in _parts(kernel, theta))
    for dims, part_theta in thetas.items():
        if set(dims) == set(range(width)):
            lengths = np.empty(width)
            lengths[list(dims)] = np.exp(part_theta[-width:])
            return lengths
    raise UsageError(
        "the kernel has no squared exponential of all inputs to measure distances by",
        next_step="Pass lengths, one per input.",
    )


def _parts(kernel: Kernel, theta: Array) -> list[tuple[SquaredExponential | Linear, Array]]:
    """The kernels that others are made of, each with its share of theta."""
    if not isinstance(kernel, Sum | Product):
        return [(kernel, theta)] if isinstance(kernel, SquaredExponential | Linear) else []
    ends = np.cumsum([part.size for part in kernel.parts])[:-1]
    shares = zip(kernel.parts, np.split(theta, ends), strict=True)
    return [pair for part, part_theta in shares for pair in _parts(part, part_theta)]


def joined(u: Array, C: Array, reach: float) -> int:
    """The nearest of the centres C (K, D) within reach of u (D,), or K for a new one."""
    if not len(C):
        return 0
    squared = np.square(C - u).sum(axis=1)
    k = int(squared.argmin())
    return k if squared[k] < reach else len(C)


def partition(U: Array, reach: float) -> Index:
    """The part (n,) that each of U (n, D), inputs in lengths, joins, one after the other."""
    assignment = np.zeros(len(U), dtype=np.int64)
    C, counts = np.zeros_like(U), np.zeros(len(U))
    K = 0
    for i, u in enumerate(U):
        k = joined(u, C[:K], reach)
        K = max(K, k + 1)
        counts[k] += 1.0
        C[k] += (u - C[k]) / counts[k]
        assignment[i] = k
    return assignment


def fitting_reach(U: Array, capacity: int) -> float:
    """The largest squared reach with which parts lose at most `OVERFLOW` of the samples to their capacity.

    U (n, D) are inputs in lengths. With no more samples than capacity, one part holds all.
    """
    step = -(-len(U) // MOST_TRIED)
    some, room = U[::step], max(1.0, capacity / step)
    widest = float(np.square(U - U.mean(axis=0)).sum(axis=1).max())
    low, high = 0.0, EVERYTHING * widest if widest > 0.0 else 1.0
    if len(U) <= capacity:
        return 4.0 * high
    for _ in range(HALVINGS):
        reach = 0.5 * (low + high)
        counts = np.bincount(partition(some, reach))
        fits = np.maximum(counts - room, 0.0).sum() <= OVERFLOW * len(some)
        low, high = (reach, high) if fits else (low, reach)
    return low or high


@dataclass(frozen=True)
class LocalGP:
    """A partition of the inputs with an exact process in each part (keeps `protocols.Regressor.condition`).

    Choose it for many samples that all should count, when one exact process of them is too large and samples
    keep coming. An update costs O(capacity²), a mean O(nearest capacity). It trains no hyperparameters: take
    those of an exact process. Dictionaries and inducing points give a better variance, and covariances.

    A sample starts a local model if none is activated by more than `generate`. The activation of a model with
    centre c is exp(-|(x - c)/lengths|²/2). Otherwise it joins the model it activates most, whose centre moves
    to the mean of all samples that joined. A full model is a dictionary with the variance rule: it drops the
    sample that the others determine best (the paper's information gain).

    Attributes:
        gp: kernel, hyperparameters and noise of every local model; zero mean, so the caller centres y.
        capacity: samples of a local model, at most.
        generate: w_gen.
        nearest: local models that a prediction blends, at most.
        lengths: (D,) of the activation. None takes those of the kernel's squared exponential of all inputs,
            times the factor with which the data's parts just fit into `capacity` (`fitted`). With the
            kernel's own, as in the paper, parts much smaller than a length blend as equals, and those that
            know nothing of a place spoil its prediction: the error on a simulated arm is 8 times as large.
    """

    gp: ExactGP
    capacity: int = 200
    generate: float = 0.01
    nearest: int = 8
    lengths: Array | None = None

    def __post_init__(self) -> None:
        for name in ("capacity", "nearest"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be at least 1, got {getattr(self, name)}")
        if not 0.0 < self.generate < 1.0:
            raise UsageError(f"generate must be in (0, 1), got {self.generate}")
        if self.lengths is None:
            return
        lengths = np.asarray(self.lengths, dtype=float)
        if lengths.ndim != 1 or not (np.isfinite(lengths).all() and np.all(lengths > 0.0)):
            raise UsageError("lengths must be positive numbers, one per input")
        object.__setattr__(self, "lengths", lengths)

    @property
    def reach(self) -> float:
        """Squared distance, in lengths, at which an activation is `generate`."""
        return -2.0 * float(np.log(self.generate))

    @property
    def dictionary(self) -> DictionaryConfig:
        """How a full local model chooses its samples."""
        return DictionaryConfig(size=self.capacity, rule="variance")

    def fitted(self, X: Array) -> LocalGP:
        """The same with lengths, if it has none, for inputs like X (n, D).

        Raises:
            UsageError: no part of the kernel is a squared exponential of all inputs.
        """
        if self.lengths is not None:
            return self
        lengths = kernel_lengths(self.gp.kernel, self.gp.theta)
        if X.shape[1:] != lengths.shape:
            raise UsageError(f"expected inputs with {len(lengths)} columns, got {X.shape}")
        return replace(
            self, lengths=lengths * np.sqrt(fitting_reach(X / lengths, self.capacity) / self.reach)
        )

    def begin(self) -> LocalModels:
        """No local model yet. UsageError if there are no lengths: call it on `fitted(X)`."""
        return LocalModels(self)

    def condition(self, X: Array, y: Array) -> LocalPosterior:
        """The posterior after X (n, D) and centred y (n,), as if they had come one after the other.

        Raises DataError for unusable X or y, UsageError for another number of inputs than lengths.
        """
        X, y = checked_data(X, y)
        fitted = self.fitted(X)
        lengths = fitted.lengths_for(X)
        assignment = partition(X / lengths, self.reach)
        parts = [np.flatnonzero(assignment == k) for k in range(assignment.max() + 1)]
        models = tuple(self._conditioned(X[part], y[part]) for part in parts)
        return LocalPosterior(
            np.array([X[part].mean(axis=0) for part in parts]), lengths, models, self.nearest
        )

    def lengths_for(self, X: Array) -> Array:
        """The lengths (D,) of the activations of X (n, D).

        Raises:
            UsageError: there are none, or of another number.
        """
        if self.lengths is None:
            raise UsageError("local models need lengths to begin", next_step="Call begin on fitted(X).")
        if X.ndim != 2 or X.shape[1:] != self.lengths.shape:
            raise UsageError(f"expected inputs of shape (n, {len(self.lengths)}), got {X.shape}")
        return self.lengths

    def _conditioned(self, X: Array, y: Array) -> ExactPosterior:
        """An exact process, or if there are too many samples one on a dictionary of them."""
        if len(y) <= self.capacity:
            return self.gp.condition(X, y)
        from etude_sparse.dictionary import DictionaryGP

        selected = DictionaryGP(self.gp, self.dictionary).select(X, y).kept
        return self.gp.condition(X[selected], y[selected])


class LocalModels:
    """Local models that learn one sample after the other; `observe` changes them.

    Attributes:
        samples: number absorbed.
        centres: (K, D) means of all samples that joined. counts: (K,) numbers of these.
    """

    def __init__(self, prior: LocalGP) -> None:
        if prior.lengths is None:
            raise UsageError("local models need lengths to begin", next_step="Call begin on fitted(X).")
        self.prior, self.lengths, self.samples = prior, prior.lengths, 0
        self.centres = np.zeros((0, len(prior.lengths)))
        self.counts = np.zeros(0, dtype=np.int64)
        self._streams: list[DictionaryStream] = []

    def observe(self, x: Array, y: float) -> int:
        """Absorb one sample x (D,), y; returns the local model it joined.

        Raises DataError for NaN, UsageError for the wrong shape; nothing is absorbed then.
        """
        X, target = checked_data(np.asarray(x, dtype=float)[None], np.array([y], dtype=float))
        lengths = self.prior.lengths_for(X)
        k = joined(X[0] / lengths, self.centres / lengths, self.prior.reach)
        if k == len(self.centres):
            self._open(X)
        self._streams[k].offer(X, target)
        self.counts[k] += 1
        self.centres[k] += (X[0] - self.centres[k]) / self.counts[k]
        self.samples += 1
        return k

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and variance (T,) at X (T, D), from the running inverses; the prior before any sample."""
        X, gp = np.asarray(X, dtype=float), self.prior.gp
        lengths = self.prior.lengths_for(X)
        if not self._streams:
            return np.zeros(len(X)), gp.kernel.diagonal(gp.theta, X)
        blend = Blend.of(X, self.centres, lengths, self.prior.nearest)
        least = LEAST_VARIANCE * float(gp.kernel.diagonal(gp.theta, self.centres).mean())
        return combined(blend, *blended(blend, self._streams, X, least))

    def posterior(self) -> LocalPosterior:
        """A copy that later samples leave alone, O(K capacity³). DataError before the first sample."""
        if not self._streams:
            raise DataError("the local models have seen no sample yet")
        models = tuple(self.prior.gp.condition(stream.X, stream.y) for stream in self._streams)
        return LocalPosterior(self.centres.copy(), self.lengths, models, self.prior.nearest)

    def _open(self, X: Array) -> None:
        """A new local model, empty, with its centre at X (1, D)."""
        from etude_sparse.dictionary_stream import DictionaryStream

        self._streams.append(DictionaryStream(self.prior.gp, self.prior.dictionary, X.shape[1]))
        self.centres = np.concatenate([self.centres, X])
        self.counts = np.append(self.counts, 0)
