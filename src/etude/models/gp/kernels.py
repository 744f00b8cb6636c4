"""Kernels: squared exponential, linear, the structured default, and the noise of stiction.

A new kernel is a class here, with the methods of `kernel_algebra.Kernel`, and a row of `etude.kernels` in
`plugins`. `plugin_kernel` only checks those of other packages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from etude.errors import UsageError
from etude.models.gp import cholesky
from etude.models.gp.kernel_algebra import VJP, Against, Kernel, Of, Product, Role, Sum
from etude.types import Array, Column

OWN_SHARE = 0.25
"""First length of what depends on the joint's own position alone, as a part of the half range."""

AT_REST = ("memory", "rest")
"""Ops of inputs that say what holds a joint at rest, for kernels of standing joints (`rest.standing`)."""

__all__ = ["Kernel", "Linear", "Product", "SquaredExponential", "Sum", "ard_se", "structured"]


BLOCK = 512
"""Columns of a weighted Gram matrix handled at once: a few megabytes instead of one more n x n array."""


def active(X: Array, dims: tuple[int, ...]) -> Array:
    """The columns `dims` of X (n, D); UsageError if there are fewer."""
    columns = places(dims)
    if X.ndim != 2 or X.shape[1] <= (max(dims) if isinstance(columns, list) else dims[-1]):
        raise UsageError(f"a kernel on column {max(dims)} needs more than inputs of shape {X.shape}")
    return X[:, columns]


@cache
def places(dims: tuple[int, ...]) -> slice | list[int]:
    """The columns as an index: consecutive ones as a slice, whose columns are a view, and no copy."""
    first, count = dims[0], len(dims)
    return slice(first, first + count) if dims == tuple(range(first, first + count)) else list(dims)


def with_ones(U: Array) -> Array:
    """[U, 1], (n, D + 1)."""
    out = np.empty((len(U), U.shape[1] + 1))
    out[:, :-1], out[:, -1] = U, 1.0
    return out


def check_dims(dims: tuple[int, ...]) -> None:
    """UsageError if these cannot be columns."""
    if not dims or len(set(dims)) != len(dims) or min(dims) < 0:
        raise UsageError(f"active dimensions must be distinct and not negative, got {dims}")


@dataclass(frozen=True)
class SquaredExponential(Kernel):
    """ARD squared exponential s0² exp(-1/2 Σ_d (x_d - z_d)² / ℓ_d²), thesis (2.3), over the columns `dims`.

    theta = log s0 (absent with `unit=True`, where s0 = 1: for a factor of a product), then log ℓ_d.
    `share` is the part of an input's half range that training starts from as its length.
    """

    dims: tuple[int, ...]
    unit: bool = False
    share: float = 1.0

    def __post_init__(self) -> None:
        check_dims(self.dims)
        if not (np.isfinite(self.share) and self.share > 0.0):
            raise UsageError(f"a length starts at a positive share of its half range, not {self.share}")

    def names(self) -> tuple[str, ...]:
        lengths = [f"length[{d}]" for d in self.dims]
        return tuple(lengths if self.unit else ["amplitude", *lengths])

    def roles(self) -> tuple[Role, ...]:
        lengths: list[Role] = ["length"] * len(self.dims)
        return tuple(lengths if self.unit else ["amplitude", *lengths])

    def initial(self, half_range: Array, scale: float) -> Array:
        lengths = np.log(self.share * half_range[list(self.dims)])
        return lengths if self.unit else np.concatenate([[np.log(scale)], lengths])

    def _split(self, theta: Array) -> tuple[float, Array]:
        theta = self.check(theta)
        return (0.0, np.exp(theta)) if self.unit else (float(theta[0]), np.exp(theta[1:]))

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        log_s0, lengths = self._split(theta)
        inputs = active(X, self.dims)
        U = (inputs - inputs.mean(axis=0)) / lengths
        K = _scaled_exponential(U, U, log_s0).T  # symmetric: its transposed view is itself in Fortran order
        np.fill_diagonal(K, np.exp(2.0 * log_s0))

        def vjp(G: Array) -> Array:
            TU, columns = _weighted_sums(G, K, with_ones(U))
            return self._slopes(U, TU, columns)

        return K, vjp

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        log_s0, lengths = self._split(theta)
        inputs = active(X, self.dims)
        U = (inputs - inputs.mean(axis=0)) / lengths
        left, right = _both_sides(U, log_s0)
        K = cholesky.exponentials(left, right, 2.0 * log_s0)

        def vjp(G: Array) -> Array:
            return self._slopes(U, *cholesky.weighted_sums(G, K, left))

        return K, vjp

    def _slopes(self, U: Array, products: Array, others: Array) -> Array:
        """Of T = G * K: T [U, ..., 1] or its transposed's, and the sums of T along the other side."""
        TU, sums = products[:, : U.shape[1]], products[:, -1]
        # sum_ij T_ij (u_i - u_j)^2 for every dimension without an n x n x D array
        along = (sums + others) @ (U * U) - 2.0 * np.einsum("nd,nd->d", U, TU)
        return along if self.unit else np.concatenate([[2.0 * sums.sum()], along])

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        return self.against(theta, Z)(X)

    def values(self, theta: Array, Z: Array) -> Of:
        log_s0, lengths = self._split(theta)
        fixed = active(Z, self.dims)
        centre = fixed.mean(axis=0)
        right = _right((fixed - centre) / lengths)
        return lambda X: _exponential(_left((active(X, self.dims) - centre) / lengths, log_s0), right, log_s0)

    def against(self, theta: Array, Z: Array) -> Against:
        log_s0, lengths = self._split(theta)
        fixed = active(Z, self.dims)
        centre = fixed.mean(axis=0)
        V = (fixed - centre) / lengths
        right, beside = _right(V), with_ones(V)

        def crossed(X: Array) -> tuple[Array, VJP]:
            U = (active(X, self.dims) - centre) / lengths
            K = _exponential(_left(U, log_s0), right, log_s0)

            def vjp(G: Array) -> Array:
                GV = (G * K) @ beside
                out = np.zeros(X.shape)
                out[:, places(self.dims)] = (GV[:, :-1] - GV[:, -1:] * U) / lengths  # -(u - v)/ℓ k
                return out

            return K, vjp

        return crossed

    def diagonal(self, theta: Array, X: Array) -> Array:
        log_s0, _ = self._split(theta)
        return np.full(len(X), np.exp(2.0 * log_s0))

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        self.check(theta)
        return np.zeros_like(X * g[:, None])


def _scaled_exponential(U: Array, V: Array, log_s0: float) -> Array:
    """exp(2 log_s0 - |u - v|²/2) (n, m): the exponent comes from one matrix product of width D + 2."""
    return _exponential(_left(U, log_s0), _right(V), log_s0)


def _both_sides(U: Array, log_s0: float) -> tuple[Array, Array]:
    """[U, a, 1] and [U, 1, a], so that the product of one with the other transposed is the exponent."""
    left = np.empty((len(U), U.shape[1] + 2))
    left[:, :-2], left[:, -1] = U, 1.0
    left[:, -2] = log_s0 - 0.5 * np.einsum("nd,nd->n", U, U)
    right = left.copy()
    right[:, -2:] = left[:, :-3:-1]
    return left, right


def _left(U: Array, log_s0: float) -> Array:
    out = np.empty((len(U), U.shape[1] + 2))
    out[:, :-2], out[:, -1] = U, 1.0
    out[:, -2] = 2.0 * log_s0 - 0.5 * np.einsum("nd,nd->n", U, U)
    return out


def _right(V: Array) -> Array:
    out = np.empty((len(V), V.shape[1] + 2))
    out[:, :-2], out[:, -2] = V, 1.0
    out[:, -1] = -0.5 * np.einsum("nd,nd->n", V, V)
    return out


def _exponential(left: Array, right: Array, log_s0: float) -> Array:
    from etude.models.gp.exponential import exponentials_in_place  # loads a compiler

    K: Array = left @ right.T
    # rounding may lift a near-zero distance below zero; far outside the data it could even overflow
    exponentials_in_place(K, 2.0 * log_s0, slice(None), slice(None))
    return K


def _weighted_sums(G: Array, K: Array, U: Array) -> tuple[Array, Array]:
    """T U and the column sums of T = G * K, by blocks of columns so that T is never there as a whole."""
    TU, columns = np.zeros_like(U), np.empty(len(K))
    for first in range(0, len(K), BLOCK):
        block = slice(first, first + BLOCK)
        T = G[:, block] * K[:, block]
        TU += T @ U[block]
        columns[block] = T.sum(axis=0)
    return TU, columns


@dataclass(frozen=True)
class Linear(Kernel):
    """Σ_d a_d² x_d z_d over the columns `dims`; theta = log a_d, output units per unit of x_d. No offset."""

    dims: tuple[int, ...]

    def __post_init__(self) -> None:
        check_dims(self.dims)

    def names(self) -> tuple[str, ...]:
        return tuple(f"slope[{d}]" for d in self.dims)

    def roles(self) -> tuple[Role, ...]:
        slopes: list[Role] = ["slope"] * len(self.dims)
        return tuple(slopes)

    def initial(self, half_range: Array, scale: float) -> Array:
        slopes: Array = np.log(scale / half_range[list(self.dims)] / np.sqrt(len(self.dims)))
        return slopes

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        A = active(X, self.dims) * np.exp(self.check(theta))

        def vjp(G: Array) -> Array:
            GA = G @ A
            return np.asarray(2.0 * np.einsum("nd,nd->d", A, GA))

        return (A @ A.T).T, vjp

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        A = active(X, self.dims) * np.exp(self.check(theta))

        def vjp(G: Array) -> Array:
            return np.asarray(2.0 * np.einsum("nd,nd->d", A, cholesky.transposed_times(G, A)))

        return cholesky.squared(A), vjp

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        return self.against(theta, Z)(X)

    def against(self, theta: Array, Z: Array) -> Against:
        weighted = active(Z, self.dims) * np.exp(2.0 * self.check(theta))

        def crossed(X: Array) -> tuple[Array, VJP]:
            def vjp(G: Array) -> Array:
                out = np.zeros(X.shape)
                out[:, places(self.dims)] = G @ weighted
                return out

            return active(X, self.dims) @ weighted.T, vjp

        return crossed

    def values(self, theta: Array, Z: Array) -> Of:
        weighted = active(Z, self.dims) * np.exp(2.0 * self.check(theta))
        return lambda X: np.asarray(active(X, self.dims) @ weighted.T)

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:
        slopes = (active(Z, self.dims) * np.exp(2.0 * self.check(theta))).T @ alpha
        return lambda X: np.asarray(active(X, self.dims) @ slopes)

    def features(self, theta: Array, X: Array) -> Array:
        return np.asarray(active(X, self.dims) * np.exp(self.check(theta)))

    def diagonal(self, theta: Array, X: Array) -> Array:
        return np.asarray(active(X, self.dims) ** 2 @ np.exp(2.0 * self.check(theta)))

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        out = np.zeros(X.shape)
        out[:, self.dims] = 2.0 * g[:, None] * active(X, self.dims) * np.exp(2.0 * self.check(theta))
        return out


def ard_se(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:  # noqa: ARG001
    """The squared exponential over all inputs, a length for each: thesis (2.3)."""
    return SquaredExponential(tuple(range(len(columns))))


def own_columns(columns: Sequence[Column], commands: tuple[str, ...], op: str) -> tuple[int, ...]:
    """Places of the columns of one command's joint with that op."""
    return tuple(i for i, column in enumerate(columns) if column[3] == op and commands == (column[1],))


def structured(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """SE(q) + SE(q_j) + friction_j · SE(q_j) + linear(all others) + SE(all), for the command of joint j.

    q are the columns of the first channel; joint j is the part with the command's name; friction columns have
    an op. Gravity and transmission depend on the posture; cogging and friction on the joint's own position,
    often over a short distance, so these two terms start from a short length: one sweep of the joint teaches
    them for all postures. Inputs of joints at rest (`AT_REST`) are not verified. Viscous, inertial and
    friction terms are linear, and a remainder sees everything.

    Raises:
        UsageError: several commands, or inputs without the joint or its friction columns.
    """
    posture = _posture(columns)
    return (
        SquaredExponential(posture)
        + own_friction(columns, commands)
        + SquaredExponential((*posture, *_motion(columns)))
    )


def own_friction(columns: Sequence[Column], commands: tuple[str, ...]) -> Sum:
    """SE(q_j) + friction_j · SE(q_j) + linear(all but positions), for the command of joint j.

    Raises:
        UsageError: several commands, or inputs without the joint or its friction columns.
    """
    posture, motion = _posture(columns), _motion(columns)
    position = tuple(i for i in posture if commands == (columns[i][1],))
    steps = tuple(i for i in motion if columns[i][3] and commands == (columns[i][1],))
    if not position or not steps:
        raise UsageError(
            "The structured kernel needs the command's own position and its friction among the inputs",
            where=f"commands {', '.join(commands)}",
            next_step="Turn the friction columns on, or set kernel = 'ard_se'.",
        )
    return (
        SquaredExponential(position, share=OWN_SHARE)
        + Linear(steps) * SquaredExponential(position, unit=True, share=OWN_SHARE)
        + Linear(motion)
    )


def _posture(columns: Sequence[Column]) -> tuple[int, ...]:
    return tuple(i for i, (channel, _, _, op) in enumerate(columns) if channel == columns[0][0] and not op)


def _motion(columns: Sequence[Column]) -> tuple[int, ...]:
    posture = _posture(columns)
    return tuple(i for i, column in enumerate(columns) if i not in posture and column[3] not in AT_REST)


@dataclass(frozen=True)
class RestNoise(Kernel):
    """s² x_c² δ: independent, of deviation s x_c, where x_c in [0, 1] says how much a joint rests.

    Between two samples it is 0 even if their inputs are the same, so `cross` is not `gram`. theta = log s.
    """

    column: int

    def names(self) -> tuple[str, ...]:
        return ("amplitude",)

    def roles(self) -> tuple[Role, ...]:
        return ("amplitude",)

    def initial(self, half_range: Array, scale: float) -> Array:  # noqa: ARG002
        return np.array([np.log(scale)])

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        variances = self.diagonal(theta, X)

        def vjp(G: Array) -> Array:
            return np.array([2.0 * float(G.diagonal() @ variances)])

        return np.asfortranarray(np.diag(variances)), vjp

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        self.check(theta)
        return np.zeros((len(X), len(Z))), lambda _: np.zeros(X.shape)

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:  # noqa: ARG002
        self.check(theta)
        return lambda X: np.zeros((len(X), *alpha.shape[1:]))

    def diagonal(self, theta: Array, X: Array) -> Array:
        return np.asarray(np.exp(2.0 * self.check(theta)[0]) * self._rest_column(X) ** 2)

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        out = np.zeros(X.shape)
        out[:, self.column] = 2.0 * g * np.exp(2.0 * self.check(theta)[0]) * self._rest_column(X)
        return out

    def _rest_column(self, X: Array) -> Array:
        if X.ndim != 2 or X.shape[1] <= self.column:
            raise UsageError(f"a kernel on column {self.column} needs more than inputs of shape {X.shape}")
        return np.asarray(X[:, self.column])


def rests(kernel: Kernel, theta: Array) -> tuple[tuple[int, float], ...]:
    """Of each noise at rest in a sum of kernels its column c and s²."""
    parts = kernel.shares(theta) if isinstance(kernel, Sum) else [(kernel, theta)]
    return tuple((k.column, float(np.exp(2.0 * share[0]))) for k, share in parts if isinstance(k, RestNoise))


def rest_variance(kernel: Kernel, theta: Array, X: Array) -> Array:
    """(n,) what noise at rest adds to each sample's own variance, in a sum of kernels."""
    return resting(rests(kernel, theta), X)


def resting(pairs: Sequence[tuple[int, float]], X: Array) -> Array:
    """(n,) variance of noise at rest, from the pairs of `rests`."""
    return np.asarray(sum((s * X[:, c] ** 2 for c, s in pairs), start=np.zeros(len(X))))


def mean_signal(kernel: Kernel, theta: Array, X: Array) -> float:
    """Mean of k(x, x) over inputs (n, D), without noise at rest: that is nothing to be learned."""
    return float((kernel.diagonal(theta, X) - rest_variance(kernel, theta, X)).mean())


def standing(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """The structured kernel with what friction remembers as one more friction column, and noise at rest.

    Raises:
        UsageError: inputs without a memory, or as `structured`.
    """
    return structured(columns, commands) + memory_kernel(columns, commands)


def memory_kernel(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """(1 + SE(q_j)) · memory_j + memory of all + noise at rest, for the command of joint j."""
    memory = tuple(i for i, column in enumerate(columns) if column[3] == "memory")
    joint_memory, position = own_columns(columns, commands, "memory"), own_columns(columns, commands, "")[:1]
    rest_columns = own_columns(columns, commands, "rest")
    if not (joint_memory and rest_columns and position):
        raise UsageError(
            "the kernel of joints at rest needs the memory of friction among the inputs",
            where=f"commands {', '.join(commands)}",
            next_step="Set data.presliding, or remove the candidate 'standing'.",
        )
    return (
        Linear(memory)
        # friction changes within a part of a joint's range: lengths start at a quarter of half of it
        + Linear(joint_memory) * SquaredExponential(position, unit=True, share=0.25)
        + RestNoise(rest_columns[0])
    )
