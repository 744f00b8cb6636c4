"""Incremental sparse spectrum regression (I-SSGPR): one sample at a time, at constant cost.

Gijsberts and Metta 2013. The triangle R of A = RᵀR and b = Σ φ y carry everything; a sample is a rank-1
update of R. With fixed hyperparameters the result is that of `SparseSpectrumGP.condition` on all samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude._runtime.compilation import compiled
from etude._runtime.scipy_parts import dtrsv
from etude.errors import DataError, UsageError
from etude.models.gp.cholesky import factorise
from etude.threads import threads_for
from etude.types import Array
from etude_sparse.sparse_spectrum import SparseSpectrumGP
from etude_sparse.spectral_posterior import SparseSpectrumPosterior, SpectralFeatures

REFACTOR_EVERY = 10_000
"""Updates after which R is made anew from A."""
LEAST_NOISE = 1e-10
"""Least sn² as a part of s0²: below it millions of samples outweigh the prior beyond rounding."""
FADING = 0.1
"""With forgetting, the prior on a weight is restored before it has lost this part of its precision."""


class Features(Protocol):
    """What turns D inputs into the columns of a linear model."""

    @property
    def inputs(self) -> int: ...
    @property
    def size(self) -> int: ...
    def transform(self, X: Array) -> Array: ...


class LinearProcess(Protocol):
    """A process that is linear in features: a `SparseSpectrumGP`, or a `random_features.FeatureProcess`."""

    @property
    def features(self) -> Features: ...
    @property
    def noise_variance(self) -> float: ...
    @property
    def signal_variance(self) -> float: ...
    @property
    def ridge(self) -> float: ...


@compiled
def add_outer_product(A: Array, x: Array, forgetting: float) -> None:
    """The upper triangle of A (q, q), C order, becomes that of forgetting A + x xᵀ, in place."""
    for k in range(len(x)):
        for j in range(k, len(x)):
            A[k, j] = forgetting * A[k, j] + x[k] * x[j]


@compiled
def rank_one_update(R: Array, x: Array, forgetting: float) -> None:
    """R (q, q) becomes the factor of forgetting RᵀR + x xᵀ, in place, forgetting > 0; x (q,) is overwritten.

    R is upper triangular in C order, so that the rotations run along rows.
    """
    scale = np.sqrt(forgetting)
    for k in range(len(x)):
        if x[k] == 0.0 and scale == 1.0:
            continue
        old = scale * R[k, k]
        new = np.hypot(old, x[k])
        c, s = old / new, x[k] / new
        R[k, k] = new
        for j in range(k + 1, len(x)):
            r = scale * R[k, j]
            R[k, j] = c * r + s * x[j]
            x[j] = c * x[j] - s * r


@dataclass
class IncrementalSpectrum:
    """A sparse spectrum process that learns on line. Mutable; for one thread.

    Choose it to follow a robot that changes, at a cost per sample that does not grow: O(m²), and O(m) for a
    mean. It keeps no samples and trains no hyperparameters: take those of a `SparseSpectrumGP` trained on
    earlier logs. Its variance is the batch model's, with the same deficit. With forgetting it describes a
    function that the last 1/(1 - λ) samples determine. Consecutive samples of one motion count as
    independent, so the variance is too small by about their correlation time and not calibrated.

    With forgetting λ < 1, sample i of n weighs λ^(n - i) and the prior must not fade with the samples:
    A <- λ A + φφᵀ + (1 - λ)(m sn²/s0²) I. The last term has full rank. It is paid in turn, a few weights at
    each update, so that each weight's prior precision stays between 90 % and all of its own.

    Attributes:
        gp: fixed hyperparameters and points. Outputs are centred by the caller, always by the same offset.
        forgetting: λ in (0, 1]; 1 forgets nothing.
        A, R: (2m, 2m) normal matrix (its upper triangle) and upper triangular factor. b: (2m,).
        prior: (2m,) the part of A's diagonal that is the prior's precision.
        count: samples seen.
    """

    gp: LinearProcess
    forgetting: float
    A: Array
    R: Array
    b: Array
    prior: Array
    count: int = 0

    def __post_init__(self) -> None:
        self._features = self.gp.features
        self._weights: Array | None = None
        self._next = 0

    @classmethod
    def start(cls, gp: LinearProcess, *, forgetting: float = 1.0) -> IncrementalSpectrum:
        """Before any sample. UsageError if the noise is below `LEAST_NOISE` or λ outside (0, 1]."""
        _check(gp, forgetting)
        size = gp.features.size
        prior = np.full(size, gp.ridge)
        return cls(gp, forgetting, np.diag(prior), np.diag(np.sqrt(prior)), np.zeros(size), prior)

    @classmethod
    def resume(
        cls, gp: SparseSpectrumGP, X: Array, y: Array, *, forgetting: float = 1.0
    ) -> IncrementalSpectrum:
        """After X (n, D) and y (n,) learned at once, all at full weight; errors as `gp.condition`."""
        model = cls.start(gp, forgetting=forgetting)
        posterior = gp.condition(X, y)
        model.A, model.R = posterior.L @ posterior.L.T, np.ascontiguousarray(posterior.L.T)
        model.b = model.A @ posterior.weights
        model.count = len(posterior.y)
        return model

    def update(self, x: Array, y: float) -> None:
        """Learn one sample: input x (D,) and centred output y. On an error nothing is changed.

        Raises:
            UsageError: x has another shape. DataError: x or y is NaN or infinite.
        """
        phi = self._feature(x)
        if not (np.isfinite(phi).all() and np.isfinite(y)):
            raise DataError("a sample to learn from is NaN or infinite", where=f"after {self.count} samples")
        self._absorb(phi)
        self.b *= self.forgetting
        self.b += phi * float(y)
        if self.forgetting < 1.0:
            self._restore_prior()
        self._weights = None
        self.count += 1
        if self.count % REFACTOR_EVERY == 0:
            self.refactor()

    def mean(self, x: Array) -> float:
        """Mean at one input x (D,): O(m), after O(m²) if there was an update since."""
        return float(self._feature(x) @ self.weights)

    @property
    def weights(self) -> Array:
        """(2m,) A^-1 b, by two triangular solves after an update."""
        if self._weights is None:
            # the transpose of a C-ordered R is a Fortran-ordered lower triangle, without a copy
            half = dtrsv(self.R.T, self.b, lower=1)
            self._weights = np.asarray(dtrsv(self.R.T, half, lower=1, trans=1))
        return self._weights

    @property
    def posterior(self) -> SparseSpectrumPosterior:
        """What is known now, as a value that later updates do not change; of spectral features alone."""
        if not (isinstance(self._features, SpectralFeatures) and isinstance(self.gp, SparseSpectrumGP)):
            raise UsageError(
                "a process of these features has no posterior for the design", next_step="Use mean."
            )
        return SparseSpectrumPosterior(
            self._features,
            self.gp.signal_variance,
            self.gp.noise_variance,
            self.weights.copy(),
            self.R.copy().T,
            np.empty((0, self._features.inputs)),
            np.empty(0),
            self.gp.theta,
        )

    def refactor(self) -> None:
        """R from A, the prior whole again: takes back what rounding and the turns of the prior have done."""
        diagonal = np.arange(len(self.b))
        self.A[diagonal, diagonal] += self.gp.ridge - self.prior
        self.prior[:] = self.gp.ridge
        with threads_for(len(self.b)):
            L, _ = factorise(self.A.T, 0.0)
        self.R = np.ascontiguousarray(L.T)
        self._weights = None

    def _absorb(self, phi: Array) -> None:

        add_outer_product(self.A, phi, self.forgetting)
        rank_one_update(self.R, phi.copy(), self.forgetting)
        self.prior *= self.forgetting

    def _restore_prior(self) -> None:
        """Tops up the next weights in turn, as many as keep every one above 1 - FADING."""

        size = len(self.b)
        turns = min(size, int(np.ceil(size * np.log(self.forgetting) / np.log(1.0 - FADING))))
        for i in (self._next + np.arange(turns)) % size:
            missing = self.gp.ridge - self.prior[i]
            unit = np.zeros(size)
            unit[i] = np.sqrt(missing)
            rank_one_update(self.R, unit, 1.0)
            self.A[i, i] += missing
            self.prior[i] = self.gp.ridge
        self._next = (self._next + turns) % size

    def _feature(self, x: Array) -> Array:
        x = np.asarray(x, dtype=float)
        if x.shape != (self._features.inputs,):
            raise UsageError(f"expected one input of shape ({self._features.inputs},), got {x.shape}")
        with np.errstate(invalid="ignore"):
            return np.asarray(self._features.transform(x[None])[0])


def _check(gp: LinearProcess, forgetting: float) -> None:
    if not 0.0 < forgetting <= 1.0:
        raise UsageError(f"forgetting must be above 0 and at most 1, got {forgetting}")
    if gp.noise_variance < LEAST_NOISE * gp.signal_variance:
        raise UsageError(
            f"a noise variance of {gp.noise_variance:.1e} is too small for updates to stay accurate",
            next_step="Give the process a noise floor.",
        )
