"""Local Gaussian processes while they learn, one sample after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.gp.dictionary_stream import DictionaryStream
from etude.models.gp.exact import checked_data
from etude.models.gp.local_parts import joined
from etude.models.gp.local_posterior import LEAST_VARIANCE, Blend, LocalPosterior, blended, combined

if TYPE_CHECKING:
    from etude.models.gp.local import LocalGP

Array = NDArray[np.float64]


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
        self._streams.append(DictionaryStream(self.prior.gp, self.prior.dictionary, X.shape[1]))
        self.centres = np.concatenate([self.centres, X])
        self.counts = np.append(self.counts, 0)
