"""The mean of several outputs at one input, as fast as Python allows: for a controller's tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel
from etude.models.gp.point_kernel import Terms, kernel_terms, means_at, pointwise_parts
from etude.types import Array


class Expansion(Protocol):
    """A mean Σ_i alpha_i k(x, x_i): what an exact posterior has of it, X (n, D) and alpha (n,)."""

    @property
    def kernel(self) -> Kernel: ...
    @property
    def theta(self) -> Array: ...
    @property
    def X(self) -> Array: ...
    @property
    def alpha(self) -> Array: ...


class PointMean:
    """Means of m exact posteriors (dictionaries included); not for several threads at once.

    Choose it where one input at a time has to be answered, and no variance: `ExactPosterior.predict` spends
    most of such a call on checks and small arrays, and would do so m times. Kernels may be any sum of
    squared exponentials, linear parts, their products, and kernels with compiled covariances of their own.

    Args:
        posteriors: one per output.

    Raises:
        UsageError: no posterior, inputs of different widths, or a kernel with other parts.
    """

    def __init__(self, posteriors: Sequence[Expansion]) -> None:
        widths = {posterior.X.shape[1] for posterior in posteriors}
        if len(widths) != 1:
            raise UsageError(f"posteriors must share their inputs, one at least; widths: {sorted(widths)}")
        D, m = widths.pop(), len(posteriors)
        self._counts = np.array([len(posterior.X) for posterior in posteriors])
        most = int(self._counts.max())
        self._Z, self._alpha = np.zeros((m, D, most)), np.zeros((m, most))
        for j, posterior in enumerate(posteriors):
            self._Z[j, :, : len(posterior.X)] = posterior.X.T
            self._alpha[j, : len(posterior.X)] = posterior.alpha
        self._others: list[tuple[int, Callable[[Array], Array], Array]] = []
        terms = []
        for j, posterior in enumerate(posteriors):
            kernel, theta, others = pointwise_parts(posterior.kernel, posterior.theta)
            terms.append(_none(D) if kernel is None else kernel_terms(kernel, theta, D))
            self._others += [(j, part.at(own, posterior.X), posterior.alpha) for part, own in others]
        self._terms = _stacked(terms)
        self._k, self._space = np.empty(most), np.empty((3, most))

    def __call__(self, x: Array) -> Array:
        """Means (m,) at x (D,), thesis (2.5); NaN where x is not finite, UsageError for another shape."""
        if x.shape != self._Z.shape[1:2]:
            raise UsageError(f"expected one input of shape {self._Z.shape[1:2]}, got {x.shape}")
        out = np.empty(len(self._Z))
        means_at(x, self._Z, self._alpha, self._counts, self._terms, self._k, self._space, out)
        for j, covariances, alpha in self._others:
            out[j] += covariances(x) @ alpha
        return out


def _none(inputs: int) -> Terms:
    """No term at all."""
    no = np.zeros(0, dtype=np.bool_)
    return Terms(np.zeros((0, inputs)), np.zeros(0), np.zeros((0, inputs)), no, no)


def _stacked(terms: Sequence[Terms]) -> Terms:
    """One array per field for all outputs; one with fewer terms gets linear terms with slopes of zero."""
    most = max(len(own.log_variance) for own in terms)
    m, D = len(terms), terms[0].curve.shape[1]
    out = Terms(
        curve=np.zeros((m, most, D)),
        log_variance=np.zeros((m, most)),
        slope=np.zeros((m, most, D)),
        curved=np.zeros((m, most), dtype=np.bool_),
        linear=np.ones((m, most), dtype=np.bool_),
    )
    for j, own in enumerate(terms):
        for all_outputs, values in zip(out, own, strict=True):
            all_outputs[j, : len(values)] = values
    return out
