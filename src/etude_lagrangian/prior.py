"""Prior of all commands together: one Lagrangian, and friction terms for each command."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernel_algebra import Kernel, Role, Sum
from etude.types import Array, Index
from etude_lagrangian.joints import Joints
from etude_lagrangian.kernel import Lagrangian
from etude_lagrangian.kernel_parameters import Parameters


@dataclass(frozen=True)
class JointPrior:
    """J commands in one unit: commands of one energy, and independent additions.

    theta is that of the Lagrangian, then those of the additions. Entries of matrices are ordered by command,
    then by instant; `used` holds the positions of those that count among all J n.

    Attributes:
        joints: columns of the inputs. additions: a kernel for each command.
    """

    joints: Joints
    additions: tuple[Kernel, ...]

    def __post_init__(self) -> None:
        if len(self.additions) != self.joints.count:
            raise UsageError(f"{self.joints.count} joints need as many additions, not {len(self.additions)}")

    @cached_property
    def parameters(self) -> Parameters:
        """What the Lagrangian's part of theta is."""
        return Parameters(self.joints.slides)

    @cached_property
    def size(self) -> int:
        """Length of theta."""
        return len(self.parameters.names()) + sum(kernel.size for kernel in self.additions)

    def roles(self) -> tuple[Role, ...]:
        """Of each entry of theta."""
        return (*self.parameters.roles(), *(role for kernel in self.additions for role in kernel.roles()))

    def initial(self, half_range: Array, scale: Array) -> Array:
        """theta (P,) to train from, for inputs of half range (D,) and commands of deviation `scale` (J,)."""
        J = self.joints.count
        parts = np.array([len(k.parts) if isinstance(k, Sum) else 1 for k in self.additions])
        share = scale / np.sqrt(1.0 + parts)
        members = np.arange(1.0, J + 1.0)[:, None]  # joints that move a link
        v = share / np.sqrt(2.0 * members * J)
        # 1/20: a joint that hardly needs a command still starts with a part in the energy
        factors = np.maximum(0.05, (share / share.max()) ** 2)
        halves = (half_range[list(self.joints.positions)], half_range[list(self.joints.accelerations)])
        lagrangian = self.parameters.start(*halves, np.append(share.max(), factors), v)
        addition_scale = share * np.sqrt(parts)
        return np.concatenate(
            [
                lagrangian,
                *(
                    k.initial(half_range, s)
                    for k, s in zip(self.additions, addition_scale.tolist(), strict=True)
                ),
            ]
        )

    def split(self, theta: Array) -> tuple[Array, list[Array]]:
        """The array of the Lagrangian's parameters, and theta of each addition."""
        sizes = [len(self.parameters.names()), *(kernel.size for kernel in self.additions)]
        lagrangian, *thetas = np.split(theta, np.cumsum(sizes)[:-1])
        return self.parameters.array(lagrangian), thetas

    def one(self, theta: Array, j: int) -> tuple[Kernel, Array]:
        """Kernel and theta of command j alone: the same covariances, those with other commands forgotten."""
        p, thetas = self.split(theta)
        kernel = Lagrangian(self.joints, j)
        return kernel + self.additions[j], np.concatenate([kernel.parameters.theta(p), thetas[j]])

    def cross(self, theta: Array, X: Array, Z: Array, used: Index) -> Array:
        """(J T, u): all commands at X (T, D) with the entries that count at Z (n, D)."""
        from etude_lagrangian.all_outputs import EVERY, sweep_all

        J, (p, thetas) = self.joints.count, self.split(theta)
        F = self.joints.packed(X)
        fixed = F if X is Z else self.joints.packed(Z)
        K = np.empty((J, len(X), J, len(Z)))
        sweep_all(p, F, fixed, EVERY, K, False, F, p)
        for j, (kernel, addition_theta) in enumerate(zip(self.additions, thetas, strict=True)):
            K[j, :, j] += kernel.value(addition_theta, X, Z)
        flat = K.reshape(J * len(X), J * len(Z))
        return flat if len(used) == flat.shape[1] else flat[:, used]

    def gram(self, theta: Array, X: Array, used: Index) -> Array:
        """(u, u), Fortran order, of the entries that count at X (n, D)."""
        K = self.cross(theta, X, X, used)
        return (K if len(used) == len(K) else K[used]).T

    def gram_gradient(self, theta: Array, X: Array, used: Index, G: Array) -> Array:
        """(P,) of sum(G * gram), for symmetric G (u, u)."""
        from etude_lagrangian.all_outputs import LOWER, sweep_all

        J, n, (p, thetas) = self.joints.count, len(X), self.split(theta)
        weights = G
        if len(used) < J * n:
            weights = np.zeros((J * n, J * n))
            weights[np.ix_(used, used)] = G
        square = weights.reshape(J, n, J, n)
        F, dp = self.joints.packed(X), np.zeros_like(p)
        multiplicity = np.tril(np.full((n, n), 2.0), -1) + np.eye(n)
        sweep_all(p, F, F, LOWER, square * multiplicity[:, None, :], True, np.zeros_like(F), dp)
        gradients = [self.parameters.pulled(p, dp)]
        for j, (kernel, addition_theta) in enumerate(zip(self.additions, thetas, strict=True)):
            gradients.append(kernel.gram(addition_theta, X)[1](square[j, :, j]))
        return np.concatenate(gradients)

    def diagonal(self, theta: Array, X: Array) -> Array:
        """(T, J) prior variances at X (T, D)."""
        from etude_lagrangian.all_outputs import SELF, sweep_all

        J, (p, thetas) = self.joints.count, self.split(theta)
        F, K = self.joints.packed(X), np.empty((self.joints.count, len(X), self.joints.count, 1))
        sweep_all(p, F, F, SELF, K, False, F, p)
        lagrangian = K[np.arange(J), :, np.arange(J), 0].T
        additions = [
            k.diagonal(addition_theta, X) for k, addition_theta in zip(self.additions, thetas, strict=True)
        ]
        return np.asarray(lagrangian + np.column_stack(additions))
