"""Noise of joints at rest, as a kernel: what friction holds there says little of the dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel, Of, Pull, Role, Sum
from etude.models.gp.kernels import Linear, SquaredExponential, own_columns, structured
from etude.types import Array, Column


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

    def gram(self, theta: Array, X: Array) -> tuple[Array, Pull]:
        own = self.diagonal(theta, X)

        def pull(G: Array) -> Array:
            return np.array([2.0 * float(G.diagonal() @ own)])

        return np.asfortranarray(np.diag(own)), pull

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, Pull]:
        self.check(theta)
        return np.zeros((len(X), len(Z))), lambda _: np.zeros(X.shape)

    def sums(self, theta: Array, Z: Array, alpha: Array) -> Of:  # noqa: ARG002
        self.check(theta)
        return lambda X: np.zeros((len(X), *alpha.shape[1:]))

    def diagonal(self, theta: Array, X: Array) -> Array:
        return np.asarray(np.exp(2.0 * self.check(theta)[0]) * self._rest(X) ** 2)

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        out = np.zeros(X.shape)
        out[:, self.column] = 2.0 * g * np.exp(2.0 * self.check(theta)[0]) * self._rest(X)
        return out

    def _rest(self, X: Array) -> Array:
        if X.ndim != 2 or X.shape[1] <= self.column:
            raise UsageError(f"a kernel on column {self.column} needs more than inputs of shape {X.shape}")
        return np.asarray(X[:, self.column])


def rests(kernel: Kernel, theta: Array) -> tuple[tuple[int, float], ...]:
    """Of each noise at rest in a sum of kernels its column c and s²."""
    parts = kernel.shares(theta) if isinstance(kernel, Sum) else [(kernel, theta)]
    return tuple((k.column, float(np.exp(2.0 * own[0]))) for k, own in parts if isinstance(k, RestNoise))


def rest_variance(kernel: Kernel, theta: Array, X: Array) -> Array:
    """(n,) what noise at rest adds to each sample's own variance, in a sum of kernels."""
    return resting(rests(kernel, theta), X)


def resting(found: Sequence[tuple[int, float]], X: Array) -> Array:
    """(n,) the same of what `rests` found."""
    return np.asarray(sum((s * X[:, c] ** 2 for c, s in found), start=np.zeros(len(X))))


def mean_signal(kernel: Kernel, theta: Array, X: Array) -> float:
    """Mean of k(x, x) over inputs (n, D), without noise at rest: that is nothing to be learned."""
    return float((kernel.diagonal(theta, X) - rest_variance(kernel, theta, X)).mean())


def standing(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """The structured kernel with what friction remembers as one more friction column, and noise at rest.

    Raises:
        UsageError: inputs without a memory, or as `structured`.
    """
    return structured(columns, commands) + remembering(columns, commands)


def remembering(columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
    """(1 + SE(q_j)) · memory_j + memory of all + noise at rest, for the command of joint j."""
    memory = tuple(i for i, column in enumerate(columns) if column[3] == "memory")
    own, position = own_columns(columns, commands, "memory"), own_columns(columns, commands, "")[:1]
    rest = own_columns(columns, commands, "rest")
    if not (own and rest and position):
        raise UsageError(
            "a kernel of standing joints needs what friction remembers among the inputs",
            where=f"commands {', '.join(commands)}",
            next_step="Set data.presliding, or leave the candidate 'standing' out.",
        )
    return (
        Linear(memory)
        + Linear(own) * SquaredExponential(position, unit=True, share=0.25)
        + RestNoise(rest[0])
    )
