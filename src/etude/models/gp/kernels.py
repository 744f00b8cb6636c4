"""The kernels that compose (`kernel_algebra` adds and multiplies them), and the structured default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.models.gp import lower_half
from etude.models.gp.inputs import active, check_dims, places
from etude.models.gp.kernel_algebra import Against, Kernel, Of, Product, Pull, Role, Sum
from etude.models.gp.squared_exponential import SquaredExponential
from etude.types import Array, Column

OWN_SHARE = 0.25
"""First length of what depends on the joint's own position alone, as a part of the half range."""

AT_REST = ("memory", "rest")
"""Ops of inputs that say what holds a joint at rest, for kernels of standing joints (`rest.standing`)."""

__all__ = ["Kernel", "Linear", "Product", "SquaredExponential", "Sum", "ard_se", "structured"]


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

    def gram(self, theta: Array, X: Array) -> tuple[Array, Pull]:
        A = active(X, self.dims) * np.exp(self.check(theta))

        def pull(G: Array) -> Array:
            GA = G @ A
            return np.asarray(2.0 * np.einsum("nd,nd->d", A, GA))

        return (A @ A.T).T, pull

    def gram_lower(self, theta: Array, X: Array) -> tuple[Array, Pull]:
        A = active(X, self.dims) * np.exp(self.check(theta))

        def pull(G: Array) -> Array:
            return np.asarray(2.0 * np.einsum("nd,nd->d", A, lower_half.transposed_times(G, A)))

        return lower_half.squared(A), pull

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, Pull]:
        return self.against(theta, Z)(X)

    def against(self, theta: Array, Z: Array) -> Against:
        weighted = active(Z, self.dims) * np.exp(2.0 * self.check(theta))

        def crossed(X: Array) -> tuple[Array, Pull]:
            def pull(G: Array) -> Array:
                out = np.zeros(X.shape)
                out[:, places(self.dims)] = G @ weighted
                return out

            return active(X, self.dims) @ weighted.T, pull

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
    them for all postures. Inputs of joints at rest (`AT_REST`) are not looked at. Viscous, inertial and
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
    own = tuple(i for i in posture if commands == (columns[i][1],))
    steps = tuple(i for i in motion if columns[i][3] and commands == (columns[i][1],))
    if not own or not steps:
        raise UsageError(
            "The structured kernel needs the command's own position and its friction among the inputs",
            where=f"commands {', '.join(commands)}",
            next_step="Turn the friction columns on, or set kernel = 'ard_se'.",
        )
    return (
        SquaredExponential(own, share=OWN_SHARE)
        + Linear(steps) * SquaredExponential(own, unit=True, share=OWN_SHARE)
        + Linear(motion)
    )


def _posture(columns: Sequence[Column]) -> tuple[int, ...]:
    return tuple(i for i, (channel, _, _, op) in enumerate(columns) if channel == columns[0][0] and not op)


def _motion(columns: Sequence[Column]) -> tuple[int, ...]:
    posture = _posture(columns)
    return tuple(i for i, column in enumerate(columns) if i not in posture and column[3] not in AT_REST)
