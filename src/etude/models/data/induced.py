"""Exact regression beyond `points` samples: all of them teach through some that stay where they are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from etude.models.gp.exact import ExactGP
from etude.models.gp.fixed_inducing import FixedInducing
from etude.protocols import Posterior
from etude.types import Array, Index


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
        seen = _seen(self) if X.shape == self.X.shape else FixedInducing(self.gp, self.Z, X)
        return tuple(seen.posterior(np.ascontiguousarray(y)) for y in Y.T)

    def held_out(self, own: Array, fold: Index, Y: Array) -> tuple[Array, Array]:
        """Means and variances with noise (k, m) at inputs own (k, D) from the samples of other folds.

        Args:
            fold: numbers of those left out. Y: (N, m) outputs of every sample.
        """
        out = np.flatnonzero(np.isin(self.fold[self.taught], fold))
        pairs = [_seen(self).held_out(y, out, own) for y in np.ascontiguousarray(Y[self.taught].T)]
        return np.stack([mean for mean, _ in pairs], axis=1), np.stack([v for _, v in pairs], axis=1)


@lru_cache(maxsize=1)
def _seen(induced: Induced) -> FixedInducing:
    """What all its folds share: tens of megabytes, so only the latest stays."""
    return FixedInducing(induced.gp, induced.Z, induced.X)
