"""Streaming dictionary: its state between candidate points, and its refreshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude._runtime.scipy_parts import dpotrs
from etude.errors import DataError, NumericalError, UsageError
from etude.models.gp.cholesky import factorise, inverse_lower
from etude.models.gp.exact import ExactGP, ExactPosterior, checked_data, posterior_given
from etude.models.gp.single_point import PointCovariances
from etude.threads import threads_for
from etude.types import Array, Index
from etude_sparse import dictionary_updates as steps

BLOCK = 256
"""Candidates whose prior covariances are computed at once, by matrix products for any kernel."""
LEAST_DIAGONAL = 1e-6
"""Least diagonal term as a part of the signal variance: neighbouring samples of a smooth motion are so nearly
the same that at 1e-8 the inverse means nothing."""
LEAST_GAIN = 1e-9
"""A swap has to raise the score by more than rounding does."""
KINDS = {"variance": steps.VARIANCE, "error": steps.ERROR}


@dataclass(frozen=True)
class DictionaryConfig:
    """How a dictionary chooses.

    Attributes:
        size: members u at most. A candidate costs O(u²), a refresh O(u³).
        rule: "variance", thesis (2.7): a candidate replaces the member that the others determine best, if
            they determine the candidate less; log det (K + d I) then never falls. "error", thesis (2.8): the
            same with the error |y* - y| of the prediction from the others.
        guard: of the error rule, which by itself collects outliers and noise and forgets the rest. A point is
            then worth its latent variance, and up to 1 + guard² times that if its error is large: as far as
            data there could reduce the error, and less again beyond `guard` standard deviations, where it
            is rather an outlier. None is the bare rule of the thesis.
        threshold: a candidate enters only if its deviation (variance rule) or error (error rule) exceeds this
            part of the prior deviation; the thesis's delta_t, for which it gives no number.
        gain: part by which a swap has to raise the score. With 0, the thesis's, members are dragged along the
            trajectory by ever so small gains: more swaps, and a smaller determinant at the end.
        half_life: s (or points, if no times are given) in which a member's score halves, so that old members
            give way although they are informative (the idea of Nguyen-Tuong and Peters 2011; the exponential
            is ours); None keeps them. With it log det may fall.
        refresh_every: replacements after which the inverse is computed anew.
    """

    size: int = 500
    rule: Literal["variance", "error"] = "variance"
    guard: float | None = 3.0
    threshold: float = 0.0
    gain: float = 0.1
    half_life: float | None = None
    refresh_every: int = 500

    def __post_init__(self) -> None:
        if self.rule not in ("variance", "error"):
            raise UsageError("rule must be 'variance' or 'error'", where=f"dictionary.rule = {self.rule!r}")
        for name in ("size", "refresh_every"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be at least 1", where=f"dictionary.{name}")
        for name in ("guard", "half_life"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} must be a positive number or absent", where=f"dictionary.{name}")
        for name in ("threshold", "gain"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise UsageError(f"{name} must be a number >= 0", where=f"dictionary.{name}")


class DictionaryStream:
    """The points kept so far of one output, and the inverse of their covariance. Changes with every `offer`.

    The one mutable object of the family, because an online update may not copy u² numbers. The inverse
    belongs to A = k(D, D) + d I with d = max(sn², 1e-6 s0²), where s0² is the prior variance over the first
    points offered. It is computed anew every `refresh_every` replacements, and at once if a pivot shows
    rounding.

    Args:
        gp: kernel, hyperparameters and noise.
        config: size and rule.
        inputs: number D of columns of the inputs.
    """

    def __init__(self, gp: ExactGP, config: DictionaryConfig, inputs: int) -> None:
        u = config.size
        self.gp, self.config = gp, config
        self.diagonal, self.signal_variance = 0.0, 0.0
        self.offered = self.refreshes = 0
        self._members = steps.Members(
            X=np.zeros((u, inputs)),
            y=np.zeros(u),
            t=np.zeros(u),
            alpha=np.zeros(u),
            number=np.zeros(u, dtype=np.int64),
            A=np.zeros((u, u)),
            P=np.zeros((u, u)),
            counts=np.zeros(3, dtype=np.int64),
            log_det=np.zeros(1),
        )
        self._work = np.empty((4, u))
        self._point = PointCovariances(gp.kernel, gp.theta, inputs)

    def __len__(self) -> int:
        return int(self._members.counts[0])

    @property
    def X(self) -> Array:
        """Inputs (m, D) of the members."""
        return self._members.X[: len(self)].copy()

    @property
    def y(self) -> Array:
        """Centred outputs (m,) of the members."""
        return self._members.y[: len(self)].copy()

    @property
    def kept(self) -> Index:
        """Place (m,) of each member in the stream, counted from 0."""
        return self._members.number[: len(self)].copy()

    @property
    def replacements(self) -> int:
        """Members replaced so far."""
        return int(self._members.counts[2])

    @property
    def log_det(self) -> float:
        """log det A, as the updates carry it along."""
        return float(self._members.log_det[0])

    def member_scores(self) -> tuple[Array, Array]:
        """Variance with d (m,) and error (m,) of each member given the others, thesis (2.7) and (2.8)."""
        n = len(self)
        pivots = self._members.P[:n, :n].diagonal()
        return 1.0 / pivots, self._members.alpha[:n] / pivots

    def offer(self, X: Array, y: Array, t: Array | None = None) -> int:
        """Offer points in their order; returns how many replaced a member.

        Args:
            X: (n, D) inputs. y: (n,) centred outputs.
            t: (n,) times in s for the age weight; by default the points are numbered.

        Raises:
            DataError: shapes that do not fit, NaN, or times that run backwards; nothing is offered then.
            NumericalError: prior variance and noise are both zero.
        """
        X, y, t = self._checked(X, y, t)
        self._set_diagonal(X)
        before = self.replacements
        with threads_for(self.config.size):
            for first in range(0, len(y), BLOCK):
                part = slice(first, first + BLOCK)
                self._offer_block(X[part], y[part], t[part])
        return self.replacements - before

    def predict(self, X: Array) -> tuple[Array, Array]:
        """Mean (T,) and latent variance (T,) at X (T, D), thesis (2.5), (2.6), from the running inverse."""
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self._members.X.shape[1]:
            raise UsageError(f"expected inputs (T, {self._members.X.shape[1]}), got {X.shape}")
        prior = self.gp.kernel.diagonal(self.gp.theta, X)
        n = len(self)
        if not n:
            return np.zeros(len(X)), prior
        with threads_for(n):
            K = self.gp.kernel.value(self.gp.theta, X, self._members.X[:n])
            explained = np.einsum("ij,ij->i", K @ self._members.P[:n, :n], K)
            return K @ self._members.alpha[:n], np.maximum(prior - explained, 0.0)

    def mean(self, x: Array) -> float:
        """Mean at one input x (D,), thesis (2.5): O(u), for a controller's tick."""
        n = len(self)
        return float(self._point(x, self._members.X[:n]) @ self._members.alpha[:n])

    def posterior(self) -> ExactPosterior:
        """The exact process given the members; its noise variance is d. DataError if there are none."""
        if not len(self):
            raise DataError("the dictionary is empty", next_step="Offer points, or lower its threshold.")
        return posterior_given(self.gp.kernel, self.gp.theta, self.diagonal, self.X, self.y)

    def drift(self) -> float:
        """max |P A - I|: what rounding has done to the running inverse."""
        n = len(self)
        A, P = self._members.A[:n, :n], self._members.P[:n, :n]
        with threads_for(n):
            return float(np.abs(P @ A - np.eye(n)).max(initial=0.0))

    def refresh(self) -> None:
        """Compute inverse, weights and determinant anew from A, by Cholesky."""
        n, members = len(self), self._members
        if n:
            with threads_for(n):
                L, jitter = factorise(np.asfortranarray(members.A[:n, :n]), 0.0)
                members.log_det[0] = 2.0 * np.log(L.diagonal()).sum()
                members.alpha[:n] = dpotrs(L, members.y[:n], lower=1)[0]
                W = inverse_lower(L)
            members.P[:n, :n] = W + np.tril(W, -1).T
            self._raise_diagonal(self.diagonal + jitter)
        members.counts[1] = 0
        self.refreshes += 1

    def _checked(self, X: Array, y: Array, t: Array | None) -> tuple[Array, Array, Array]:
        X, y = checked_data(X, y)
        if X.shape[1] != self._members.X.shape[1]:
            raise DataError(f"expected inputs with {self._members.X.shape[1]} columns, got {X.shape[1]}")
        if t is None:
            return X, y, self.offered + np.arange(len(y), dtype=float)
        t = np.asarray(t, dtype=float)
        if t.shape != y.shape or not np.isfinite(t).all():
            raise DataError(f"one finite time per point: {len(y)} points, times of shape {t.shape}")
        if np.any(np.diff(t) < 0.0):
            raise DataError("the times run backwards", next_step="Offer points in time order.")
        return X, y, t

    def _set_diagonal(self, X: Array) -> None:
        if self.diagonal == 0.0:
            self.signal_variance = float(self.gp.kernel.diagonal(self.gp.theta, X).mean())
            self.diagonal = max(self.gp.noise_variance, LEAST_DIAGONAL * self.signal_variance)
        if not (np.isfinite(self.diagonal) and self.diagonal > 0.0):
            raise NumericalError(f"the diagonal term of the dictionary is {self.diagonal}")

    def _raise_diagonal(self, diagonal: float) -> None:
        """d never falls: A follows, so that a covariance that once needed more on its diagonal keeps it."""
        n, A = len(self), self._members.A
        A[range(n), range(n)] += diagonal - self.diagonal
        self.diagonal = diagonal

    def _offer_block(self, X: Array, y: Array, t: Array) -> None:
        kernel, theta, n = self.gp.kernel, self.gp.theta, len(self)
        if len(y) == 1:  # online, where the bookkeeping of a matrix costs more than the row itself
            rows, prior = self._point(X[0], self._members.X[:n])[None], self._point(X[0], X)
        else:
            rows = kernel.value(theta, X, self._members.X[:n]) if n else np.zeros((len(y), 0))
            prior = kernel.diagonal(theta, X)
        block = steps.Candidates(
            X=_plain(X),
            y=_plain(y),
            t=_plain(t),
            number=self.offered + np.arange(len(y)),
            rows=_plain(rows),
            own=_plain(kernel.value(theta, X, X) if len(y) > 1 else prior[:, None]),
            prior=_plain(prior),
            taken=np.full(self.config.size, -1, dtype=np.int64),
        )
        done, skip = 0, -1
        while done < len(y):
            done, reason = steps.stream(self._members, block, self._rule(), done, skip, self._work)
            if reason == steps.PIVOT_LOST:
                skip = done
                self._recover()
            elif reason == steps.REFRESH_DUE:
                self.refresh()
        self.offered += len(y)

    def _recover(self) -> None:
        """A pivot was lost: the members' prior variance may have outgrown d, which is then raised."""
        n = len(self)
        if n:
            mean = float(self._members.A[:n, :n].diagonal().mean()) - self.diagonal
            self._raise_diagonal(max(self.diagonal, LEAST_DIAGONAL * mean))
        self.refresh()

    def _rule(self) -> steps.Rule:
        config = self.config
        guarded = config.rule == "error" and config.guard is not None
        least = config.threshold * np.sqrt(self.signal_variance)
        return steps.Rule(
            kind=steps.GUARDED_ERROR if guarded else KINDS[config.rule],
            guard=float(config.guard or 0.0),
            novelty=float(least**2) if config.rule == "variance" else -np.inf,
            error=float(least) if config.rule == "error" else 0.0,
            gain=max(float(config.gain), LEAST_GAIN),
            decay=0.0 if config.half_life is None else float(np.log(2.0) / config.half_life),
            diagonal=float(self.diagonal),
            refresh_every=config.refresh_every,
        )


def _plain(array: Array) -> Array:
    """Contiguous and writable: every other form would have the core compiled once more."""
    return np.require(array, dtype=np.float64, requirements=["C", "W"])
