"""Kernels of other packages: named in every message, with all their results checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from etude.errors import NumericalError, UsageError
from etude.models.gp.kernel_algebra import VJP, Kernel, Product, Role, Sum
from etude.models.gp.kernels import Linear, RestNoise, SquaredExponential
from etude.types import Array, Column

PARTS = (SquaredExponential, Linear, RestNoise)
"""Of which, their sums and products every way of writing a kernel is complete."""
METHODS = ("names", "roles", "initial", "gram", "cross", "diagonal", "diagonal_gradient")
ROLES = ("amplitude", "length", "slope")


@dataclass(frozen=True)
class PluginKernel(Kernel):
    """What a factory made, as a kernel of the family.

    Attributes:
        plugin: name of the factory. columns, commands: what it was called with; stored with a model, so that
            the kernel can be made again.
        wrapped: the plug-in's kernel.
    """

    plugin: str
    columns: tuple[Column, ...]
    commands: tuple[str, ...]
    wrapped: Any = field(compare=False)

    @classmethod
    def of(
        cls, plugin: str, factory: Callable[..., Any], columns: Sequence[Column], commands: tuple[str, ...]
    ) -> PluginKernel:
        """The factory's kernel. UsageError if it makes none, or one that lacks a method."""
        plain = tuple((str(c), str(p), str(u), str(o)) for c, p, u, o in columns)
        try:
            inner = factory(plain, commands)
        except UsageError:
            raise
        except Exception as error:
            raise UsageError(f"the kernel {plugin!r} cannot be made ({error})", next_step=_ASK) from error
        missing = [name for name in METHODS if not callable(getattr(inner, name, None))]
        if missing:
            raise UsageError(f"the kernel {plugin!r} has no {', '.join(missing)}", next_step=_ASK)
        kernel = cls(plugin, plain, commands, inner)
        if len(kernel.roles()) != len(kernel.names()) or not set(kernel.roles()) <= set(ROLES):
            raise UsageError(
                f"the kernel {plugin!r} must give each of its hyperparameters one of the roles "
                f"{', '.join(ROLES)}",
                where=f"names {kernel.names()}, roles {kernel.roles()}",
                next_step=_ASK,
            )
        return kernel

    def tried(self, X: Array) -> PluginKernel:
        """The kernel itself, when every method has answered at inputs X (n, D) as it should.

        Raises:
            UsageError: it has not.
        """
        half_range = 0.5 * np.ptp(X, axis=0)
        try:
            theta = self.initial(np.where(half_range > 0.0, half_range, 1.0), 1.0)
            K, vjp = self.gram(theta, X)
            C, vjp_inputs = self.cross(theta, X, X[:1])
            vjp(np.ones_like(K))
            vjp_inputs(np.ones_like(C))
            # other orders of summation differ in the last digits, a wrong formula by more than 1e-6
            same = np.allclose(K.diagonal(), self.diagonal(theta, X), rtol=1e-6)
            same = same and np.allclose(K[:, :1], C, rtol=1e-6, atol=1e-9 * float(np.abs(K).max()))
            self.diagonal_gradient(theta, X, np.ones(len(X)))
        except UsageError:
            raise
        except Exception as error:
            raise UsageError(f"the kernel {self.plugin!r} does not work ({error})", next_step=_ASK) from error
        if not same:
            raise UsageError(
                f"gram, cross and diagonal of the kernel {self.plugin!r} differ at the same inputs",
                next_step=_ASK,
            )
        return self

    def names(self) -> tuple[str, ...]:
        return tuple(self.wrapped.names())

    def roles(self) -> tuple[Role, ...]:
        return tuple(self.wrapped.roles())

    def initial(self, half_range: Array, scale: float) -> Array:
        return self._sound("initial", self.wrapped.initial(half_range, scale), (self.size,))

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        K, vjp = self._pair("gram", self.wrapped.gram(self.check(theta), X), (len(X), len(X)))

        def checked(G: Array) -> Array:
            # a likelihood's weights have gaps between their columns, which a plug-in need not expect
            return self._sound("gram", vjp(np.asfortranarray(G)), (self.size,))

        return np.asfortranarray(K), checked

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        K, vjp = self._pair("cross", self.wrapped.cross(self.check(theta), X, Z), (len(X), len(Z)))

        def checked(G: Array) -> Array:
            return self._sound("cross", vjp(G), X.shape)

        return np.ascontiguousarray(K), checked

    def diagonal(self, theta: Array, X: Array) -> Array:
        return self._sound("diagonal", self.wrapped.diagonal(self.check(theta), X), (len(X),))

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        values = self.wrapped.diagonal_gradient(self.check(theta), X, g)
        return self._sound("diagonal_gradient", values, X.shape)

    def _pair(self, what: str, pair: Any, shape: tuple[int, ...]) -> tuple[Array, VJP]:
        if not isinstance(pair, tuple) or len(pair) != 2 or not callable(pair[1]):
            raise UsageError(
                f"{what} of the kernel {self.plugin!r} must give a matrix and its pull-back", next_step=_ASK
            )
        return self._sound(what, pair[0], shape), pair[1]

    def _sound(self, what: str, value: Any, shape: tuple[int, ...]) -> Array:
        values = np.asarray(value, dtype=float)
        if values.shape != shape:
            raise UsageError(
                f"{what} of the kernel {self.plugin!r} gives shape {values.shape}, not {shape}",
                next_step=_ASK,
            )
        if not np.isfinite(values).all():  # a training steps back from where this happens
            raise NumericalError(
                f"{what} of the kernel {self.plugin!r} returns values that are not numbers", next_step=_ASK
            )
        return values


_ASK = "Ask the author of the plug-in; etude.testing.KernelSuite shows the failure."


def in_parts(kernel: Kernel) -> Kernel:
    """What a plug-in's kernel is made of, if all of it are this room's parts; any other kernel as it is."""
    inner = kernel.wrapped if isinstance(kernel, PluginKernel) else kernel
    return inner if _of_parts(inner) else kernel


def _of_parts(kernel: Any) -> bool:
    if isinstance(kernel, Sum | Product):
        return all(map(_of_parts, kernel.parts))
    return type(kernel) in PARTS
