"""Compiled means and covariances at one input, for a controller's tick.

A kernel made of squared exponentials and linear parts is a sum of terms lin(x, z) · exp(log s² - Σ_d c_d
(x_d - z_d)² / 2), either factor perhaps absent. `Kernel.value` answers for matrices and spends most of a
single row on its bookkeeping; here the members lie in columns, so that every loop runs over members and
vectorises. All compiled code is in this file because numba's cache watches only the file of the function it
stores.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from etude._runtime.compilation import compiled
from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel, Product, Sum
from etude.models.gp.kernels import Linear, RestNoise, SquaredExponential
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


Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]


class Terms(NamedTuple):
    """A kernel as a sum of S terms on D inputs.

    Attributes:
        curve: (S, D) 1/ℓ² of each input, 0 where it does not count. log_variance: (S,) log s².
        slope: (S, D) a² of each input of the linear factor.
        curved, linear: (S,) whether the term has that factor.
    """

    curve: Array
    log_variance: Array
    slope: Array
    curved: Flags
    linear: Flags


def kernel_terms(kernel: Kernel, theta: Array, inputs: int) -> Terms:
    """The terms of `kernel` with log hyperparameters theta (P,), on that many inputs.

    Raises:
        UsageError: a kernel with other parts, or a product with two linear factors.
    """
    rows = []
    for factors in _summands(kernel, kernel.check(theta)):
        curve, slope, log_variance = np.zeros(inputs), np.zeros(inputs), 0.0
        linear = [share for part, share in factors if isinstance(part, Linear)]
        curved = [part for part, _ in factors if isinstance(part, SquaredExponential)]
        if len(linear) > 1 or len(linear) + len(curved) < len(factors):
            raise UsageError(
                f"covariances of a single point are not implemented for {kernel}",
                next_step="Use the kernel's own value, or squared exponential and linear parts.",
            )
        for part, share in factors:
            if isinstance(part, Linear):
                slope[list(part.dims)] = np.exp(2.0 * share)
            elif isinstance(part, SquaredExponential):
                curve[list(part.dims)] += np.exp(-2.0 * (share if part.unit else share[1:]))
                log_variance += 0.0 if part.unit else 2.0 * float(share[0])
        rows.append((curve, log_variance, slope, bool(curved), bool(linear)))
    return Terms(*(np.array(column) for column in zip(*rows, strict=True)))


def _summands(kernel: Kernel, theta: Array) -> list[list[tuple[Kernel, Array]]]:
    """The factors of each term, with their own hyperparameters."""
    if isinstance(kernel, Sum):
        pairs = [pair for pair in _split(kernel.parts, theta) if not isinstance(pair[0], RestNoise)]
        return [
            term for part, share in pairs for term in _summands(part, share)
        ]  # noise is shared with no other
    if isinstance(kernel, Product):
        return [_split(kernel.parts, theta)]
    return [[(kernel, theta)]]


def _split(parts: tuple[Kernel, ...], theta: Array) -> list[tuple[Kernel, Array]]:
    ends = np.cumsum([part.size for part in parts])
    return list(zip(parts, np.split(theta, ends[:-1]), strict=True))


@runtime_checkable
class Pointwise(Protocol):
    """A kernel with compiled covariances of its own: x (D,) -> k(x, Z) (m,)."""

    def at(self, theta: Array, Z: Array) -> Callable[[Array], Array]: ...


def pointwise_parts(
    kernel: Kernel, theta: Array
) -> tuple[Kernel | None, Array, list[tuple[Pointwise, Array]]]:
    """What `kernel_terms` is for, with its hyperparameters, and the summands that answer for themselves."""
    terms: list[tuple[Kernel, Array]] = []
    others: list[tuple[Pointwise, Array]] = []
    parts = _split(kernel.parts, theta) if isinstance(kernel, Sum) else [(kernel, theta)]
    for part, share in parts:
        if isinstance(part, Pointwise):
            others.append((part, share))
        else:
            terms.append((part, share))
    if not terms:
        return None, np.zeros(0), others
    return Sum(tuple(part for part, _ in terms)), np.concatenate([share for _, share in terms]), others


# ln 2 in two parts, so that the reduction of e^x is exact (Cody and Waite)
LOG2E, LN2_HIGH, LN2_LOW = 1.4426950408889634, 6.93147180369123816490e-01, 1.90821492927058770002e-10
ROUNDER = 6755399441055744.0  # 1.5 · 2^52: adding it leaves the nearest integer in the low bits
LEAST_EXPONENT = -709.0  # its k is -1023, whose 2^k comes out as 0: what is less is not a normal number


@compiled
def _exponential(e: Array, bits: Array, n: int) -> None:
    """e[:n] becomes exp(e[:n]) for e <= 700, to two roundings; compiled `np.exp` does one number at a time.

    exp(x) = 2^k exp(r) with |r| <= log(2)/2, Taylor to r^13/13!; 0 below LEAST; NaN stays.
    """
    scale = bits.view(np.int64)
    for i in range(n):
        x = LEAST_EXPONENT if e[i] < LEAST_EXPONENT else e[i]
        bits[i] = x * LOG2E + ROUNDER
        k = bits[i] - ROUNDER
        e[i] = (x - k * LN2_HIGH) - k * LN2_LOW
    for i in range(n):
        # the integer as the exponent of a float64: its bias is 1023, its fraction has 52 bits
        scale[i] = (scale[i] + 1023) << 52
    for i in range(n):
        r = e[i]
        # Taylor's series of exp up to r^13 / 13! by Horner: with |r| <= ln 2 / 2 the rest is below 1e-17
        p = 1.0 / 6227020800.0
        p = p * r + 1.0 / 479001600.0
        p = p * r + 1.0 / 39916800.0
        p = p * r + 1.0 / 3628800.0
        p = p * r + 1.0 / 362880.0
        p = p * r + 1.0 / 40320.0
        p = p * r + 1.0 / 5040.0
        p = p * r + 1.0 / 720.0
        p = p * r + 1.0 / 120.0
        p = p * r + 1.0 / 24.0
        p = p * r + 1.0 / 6.0
        p = p * r + 0.5
        e[i] = (1.0 + r + r * r * p) * bits[i]


@compiled
def covariances(x: Array, Z: Array, n: int, terms: Terms, k: Array, space: Array) -> None:
    """k[:n] = k(x, z_i) for x (D,) and the first n columns of Z (D, >= n); `space` is (3, >= n)."""
    e, line, bits = space[0], space[1], space[2]
    for i in range(n):
        k[i] = 0.0
    for s in range(len(terms.log_variance)):
        for i in range(n):
            e[i] = 0.0
            line[i] = 0.0 if terms.linear[s] else 1.0
        for d in range(len(x)):
            c, a, here, there = -0.5 * terms.curve[s, d], terms.slope[s, d] * x[d], x[d], Z[d]
            if c != 0.0:
                for i in range(n):
                    e[i] += c * (here - there[i]) * (here - there[i])
            if terms.slope[s, d] != 0.0:
                for i in range(n):
                    line[i] += a * there[i]
        if terms.curved[s]:
            for i in range(n):
                e[i] += terms.log_variance[s]
            _exponential(e, bits, n)
            for i in range(n):
                line[i] *= e[i]
        for i in range(n):
            k[i] += line[i]


@compiled
def mean_at(x: Array, Z: Array, alpha: Array, n: int, terms: Terms, k: Array, space: Array) -> float:
    """Σ_i alpha_i k(x, z_i), thesis (2.5), NaN if x is not finite; arguments as for `covariances`."""
    for value in x:
        if not np.isfinite(value):
            return np.nan
    covariances(x, Z, n, terms, k, space)
    total = 0.0
    for i in range(n):
        total += alpha[i] * k[i]
    return total


@compiled
def means_at(
    x: Array, Z: Array, alpha: Array, counts: Counts, terms: Terms, k: Array, space: Array, out: Array
) -> None:
    """`mean_at` of every output j into out (m,): Z[j], alpha[j], the first counts[j] members, terms[j]."""
    for j in range(len(out)):
        output_terms = Terms(
            terms.curve[j], terms.log_variance[j], terms.slope[j], terms.curved[j], terms.linear[j]
        )
        out[j] = mean_at(x, Z[j], alpha[j], counts[j], output_terms, k, space)


class PointCovariances:
    """k(x, X) of one input at a time: compiled where the kernel allows, else by its own `value`.

    Args:
        kernel: of the family. theta: (P,) its log hyperparameters. inputs: D.
    """

    def __init__(self, kernel: Kernel, theta: Array, inputs: int) -> None:
        self._kernel, self._theta = kernel, theta
        self._space = np.empty((3, 0))
        try:
            self._terms: Terms | None = kernel_terms(kernel, theta, inputs)
        except UsageError:
            self._terms = None

    def __call__(self, x: Array, X: Array) -> Array:
        """(n,) between x (D,) and the rows of X (n, D)."""
        if self._terms is None:
            return self._kernel.value(self._theta, x[None], X)[0] if len(X) else np.zeros(0)
        if self._space.shape[1] < len(X):
            self._space = np.empty((3, 2 * len(X)))
        k = np.empty(len(X))
        covariances(x, X.T, len(X), self._terms, k, self._space)
        return k


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
            self._others += [(j, part.at(share, posterior.X), posterior.alpha) for part, share in others]
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
    most = max(len(one.log_variance) for one in terms)
    m, D = len(terms), terms[0].curve.shape[1]
    out = Terms(
        curve=np.zeros((m, most, D)),
        log_variance=np.zeros((m, most)),
        slope=np.zeros((m, most, D)),
        curved=np.zeros((m, most), dtype=np.bool_),
        linear=np.ones((m, most), dtype=np.bool_),
    )
    for j, output_terms in enumerate(terms):
        for all_outputs, values in zip(out, output_terms, strict=True):
            all_outputs[j, : len(values)] = values
    return out
