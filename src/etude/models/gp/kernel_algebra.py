"""Covariance functions that compose: sums, products and active dimensions.

A kernel is a frozen description; its hyperparameters arrive as one vector `theta` of logarithms, so that the
same kernel serves every output and every step of a training. Each kernel says two things about itself, both
as a matrix and the pull-back of a weight on that matrix (reverse mode by hand, at the price of one
evaluation): `gram` with respect to `theta`, `cross` with respect to the first inputs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from etude.errors import UsageError
from etude.models.gp.cholesky import combined
from etude.types import Array

VJP = Callable[[Array], Array]
Against = Callable[[Array], tuple[Array, VJP]]
Of = Callable[[Array], Array]
Role = Literal["amplitude", "length", "slope"]


class Kernel(ABC):
    """A covariance function k(x, z) with P log hyperparameters, on inputs with D columns.

    To add one, give `names`, `roles`, `initial`, `gram`, `cross`, `diagonal` and `diagonal_gradient`, and a
    row in tests/conformance/test_kernels.py. Matrices are in squared output units.
    """

    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the P hyperparameters, in the order of `theta`."""

    @abstractmethod
    def roles(self) -> tuple[Role, ...]:
        """What each hyperparameter is, so that a prior can be put on it."""

    @abstractmethod
    def initial(self, half_range: Array, scale: float) -> Array:
        """Start value of theta (P,) for inputs of half range (D,) and outputs of deviation `scale`."""

    @abstractmethod
    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        """k(X, X) (n, n), Fortran order, and the map G (n, n) -> d sum(G * k(X, X)) / d theta (P,).

        G need not be symmetric: a lower triangle with the halves folded together does.
        """

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        """`gram` for whoever reads its lower half alone, as a Cholesky factor does; nobody writes into it.

        Above the diagonal the matrix may hold anything, and G is zero there.
        """
        return self.gram(theta, X)

    @abstractmethod
    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        """k(X, Z) (n, m), C order, and the map G (n, m) -> d sum(G * k(X, Z)) / dX (n, D), Z held fixed."""

    @abstractmethod
    def diagonal(self, theta: Array, X: Array) -> Array:
        """k(x, x) for each row of X: (n,)."""

    @abstractmethod
    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        """Gradient (n, D) of sum(g * diagonal(X)) with respect to X; g is (n,)."""

    @cached_property
    def size(self) -> int:
        """Number P of hyperparameters."""
        return len(self.names())

    def against(self, theta: Array, Z: Array) -> Against:
        """X -> `cross` with Z (m, D) that stays: what depends on that alone is made once."""
        return lambda X: self.cross(theta, X, Z)

    def value(self, theta: Array, X: Array, Z: Array) -> Array:
        """k(X, Z), (n, m), in memory of its own."""
        return self.values(theta, Z)(X)

    def values(self, theta: Array, Z: Array) -> Of:
        """X -> `value` with Z (m, D) that stays, as `against`."""
        return lambda X: self.cross(theta, X, Z)[0]

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:
        """X -> k(X, Z) alpha, (n,) or (n, c), of weights (m,) or (m, c): means need no more of the matrix."""
        values = self.values(theta, Z)
        return lambda X: np.asarray(values(X) @ alpha)

    def features(self, theta: Array, X: Array) -> Array | None:  # noqa: ARG002
        """(n, F) with k(x, z) their scalar product, of a kernel with few of them; None of others."""
        return None

    def theta_gradient(self, theta: Array, X: Array, G: Array) -> Array:
        """Gradient (P,) of sum(G * k(X, X)) with respect to theta; G is (n, n)."""
        return self.gram(theta, X)[1](G)

    def input_gradient(self, theta: Array, X: Array, Z: Array, G: Array) -> Array:
        """Gradient (n, D) of sum(G * k(X, Z)) with respect to X, Z held fixed; G is (n, m)."""
        return self.cross(theta, X, Z)[1](G)

    def check(self, theta: Array) -> Array:
        """`theta` as a float vector; UsageError if its length is not P or it is not finite."""
        theta = np.asarray(theta, dtype=float)
        if theta.shape != (self.size,):
            raise UsageError(
                f"the kernel has {self.size} hyperparameters, the vector has shape {theta.shape}",
                next_step="Pass one logarithm per name in kernel.names().",
            )
        if not np.isfinite(theta).all():
            bad = [name for name, value in zip(self.names(), theta, strict=True) if not np.isfinite(value)]
            raise UsageError(f"log hyperparameters must be finite, got {bad}")
        return theta

    def __add__(self, other: Kernel) -> Sum:
        return Sum((*_terms(self, Sum), *_terms(other, Sum)))

    def __mul__(self, other: Kernel) -> Product:
        return Product((*_terms(self, Product), *_terms(other, Product)))


@dataclass(frozen=True)
class _Composite(Kernel):
    """Kernels made of kernels: theta is the parts' vectors one after the other."""

    parts: tuple[Kernel, ...]

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Where each part's hyperparameters are in theta."""
        ends = np.cumsum([part.size for part in self.parts]).tolist()
        return tuple(slice(first, end) for first, end in zip([0, *ends], ends, strict=False))

    def shares(self, theta: Array) -> list[tuple[Kernel, Array]]:
        """Each part with its hyperparameters."""
        theta = self.check(theta)
        return [(part, theta[place]) for part, place in zip(self.parts, self.places, strict=True)]

    def names(self) -> tuple[str, ...]:
        return _joined_names(self.parts)

    def roles(self) -> tuple[Role, ...]:
        return tuple(role for part in self.parts for role in part.roles())


def multiplied(factors: list[Of]) -> Of:
    """Functions whose values are matrices, as one whose value is their product."""
    first, *others = factors

    def valued(X: Array) -> Array:
        out = first(X)
        for other in others:
            out *= other(X)
        return out

    return valued


def total(terms: list[Array]) -> Array:
    """The sum, in memory of its own."""
    out = terms[0].copy(order="K")
    for term in terms[1:]:
        out += term
    return out


def product(factors: list[Array], without: int = -1) -> Array:
    """The product of all factors but one."""
    others = [factor for i, factor in enumerate(factors) if i != without]
    if len(others) == 1 < len(factors):
        return others[0]  # only read
    out = others[0].copy(order="K")
    for factor in others[1:]:
        out *= factor
    return out


def joined_lower(operation: np.ufunc, terms: list[Array]) -> Array:
    """The lower halves of the terms joined, or the only one."""
    return combined(operation, terms, np.empty_like(terms[0], order="F")) if len(terms) > 1 else terms[0]


def weighted_lower(G: Array, factors: list[Array], without: int) -> Array:
    """G times all factors but one, zero above the diagonal as G is."""
    others = [factor for i, factor in enumerate(factors) if i != without]
    return combined(np.multiply, [G, *others], np.zeros_like(G, order="F")) if others else G


@dataclass(frozen=True)
class Sum(_Composite):
    """k_1 + k_2 + ..."""

    def initial(self, half_range: Array, scale: float) -> Array:
        share = scale / np.sqrt(len(self.parts))
        return np.concatenate([part.initial(half_range, share) for part in self.parts])

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        pairs = [part.gram(share, X) for part, share in self.shares(theta)]

        def vjp(G: Array) -> Array:
            return np.concatenate([vjp_part(G) for _, vjp_part in pairs])

        return total([K for K, _ in pairs]), vjp

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        pairs = [part.gram_lower(share, X) for part, share in self.shares(theta)]

        def vjp(G: Array) -> Array:
            return np.concatenate([vjp_part(G) for _, vjp_part in pairs])

        return joined_lower(np.add, [K for K, _ in pairs]), vjp

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        return self.against(theta, Z)(X)

    def against(self, theta: Array, Z: Array) -> Against:
        parts = [part.against(share, Z) for part, share in self.shares(theta)]

        def crossed(X: Array) -> tuple[Array, VJP]:
            pairs = [part(X) for part in parts]
            return total([K for K, _ in pairs]), lambda G: total([vjp(G) for _, vjp in pairs])

        return crossed

    def values(self, theta: Array, Z: Array) -> Of:
        first, *others = [part.values(share, Z) for part, share in self.shares(theta)]

        def valued(X: Array) -> Array:
            out = first(X)
            for other in others:
                out += other(X)
            return out

        return valued

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:
        parts = [part.sums(share, Z, alpha) for part, share in self.shares(theta)]
        return lambda X: total([part(X) for part in parts])

    def diagonal(self, theta: Array, X: Array) -> Array:
        return total([part.diagonal(share, X) for part, share in self.shares(theta)])

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        shares = self.shares(theta)
        return total([part.diagonal_gradient(share, X, g) for part, share in shares])


@dataclass(frozen=True)
class Product(_Composite):
    """k_1 · k_2 · ...; fix the amplitude of all factors but one, or they cannot be identified."""

    def initial(self, half_range: Array, scale: float) -> Array:
        first, *others = self.parts
        return np.concatenate(
            [first.initial(half_range, scale), *(part.initial(half_range, 1.0) for part in others)]
        )

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        pairs = [part.gram(share, X) for part, share in self.shares(theta)]
        values = [K for K, _ in pairs]

        def vjp(G: Array) -> Array:
            return np.concatenate([pairs[i][1](G * product(values, without=i)) for i in range(len(pairs))])

        return product(values), vjp

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        pairs = [part.gram_lower(share, X) for part, share in self.shares(theta)]
        values = [K for K, _ in pairs]

        def vjp(G: Array) -> Array:
            parts = [vjp(weighted_lower(G, values, without=i)) for i, (_, vjp) in enumerate(pairs)]
            return np.concatenate(parts)

        return joined_lower(np.multiply, values), vjp

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        return self.against(theta, Z)(X)

    def against(self, theta: Array, Z: Array) -> Against:
        parts = [part.against(share, Z) for part, share in self.shares(theta)]

        def crossed(X: Array) -> tuple[Array, VJP]:
            pairs = [part(X) for part in parts]
            values = [K for K, _ in pairs]

            def vjp(G: Array) -> Array:
                return total([pairs[i][1](G * product(values, without=i)) for i in range(len(pairs))])

            return product(values), vjp

        return crossed

    def values(self, theta: Array, Z: Array) -> Of:
        return multiplied([part.values(share, Z) for part, share in self.shares(theta)])

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:
        shares = self.shares(theta)
        features = [part.features(share, Z) for part, share in shares]
        place = next((i for i, table in enumerate(features) if table is not None), None)
        if place is None or len(shares) == 1:
            return super().sums(theta, Z, alpha)
        # a factor of few features asks for no matrix of its own, but for that many weights on the others
        (part, share), beside = shares.pop(place), features[place]
        assert beside is not None
        weights = beside[:, :, None] * alpha.reshape(len(Z), 1, -1)
        others = multiplied([other.values(its, Z) for other, its in shares])

        def summed(X: Array) -> Array:
            weighted = (others(X) @ weights.reshape(len(Z), -1)).reshape(len(X), *weights.shape[1:])
            total = np.einsum("nf,nfc->nc", np.asarray(part.features(share, X)), weighted)
            return np.asarray(total.reshape(len(X), *alpha.shape[1:]))

        return summed

    def diagonal(self, theta: Array, X: Array) -> Array:
        return product([part.diagonal(share, X) for part, share in self.shares(theta)])

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        shares = self.shares(theta)
        values = [part.diagonal(share, X) for part, share in shares]
        return total(
            [
                part.diagonal_gradient(share, X, g * product(values, without=i))
                for i, (part, share) in enumerate(shares)
            ]
        )


def _terms(kernel: Kernel, kind: type[Sum] | type[Product]) -> tuple[Kernel, ...]:
    return kernel.parts if isinstance(kernel, kind) else (kernel,)


def _joined_names(parts: tuple[Kernel, ...]) -> tuple[str, ...]:
    return tuple(f"{i}.{name}" for i, part in enumerate(parts) for name in part.names())
