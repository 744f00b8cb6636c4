"""Lagrangian prior of one command as a kernel of the family, with additions for real robots.

Kinetic and potential energy are polynomials in sin q, cos q (q itself of a slide) and the velocities, drawn
from a Gaussian process. Lagrange's equation gives the command. Source: Giacomuzzo, Carli, Romeres and Dalla
Libera, A Black-Box Physics-Informed Estimator Based on Gaussian Process Regression for Robot Inverse Dynamics
Identification, T-RO 2024; here in closed form, and links share the factors of their kinetic energy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from etude.errors import UsageError
from etude.models.forms import Form, Lookup, Metadata
from etude.models.gp.kernel_algebra import VJP, Kernel, Role
from etude.models.gp.kernels import own_friction
from etude.types import Array, Code, Column
from etude_lagrangian.joints import Joints, joints_of
from etude_lagrangian.kernel_parameters import Parameters


@dataclass(frozen=True)
class Lagrangian(Kernel):
    """The prior of the command of one joint; each command has energies of its own.

    Attributes:
        joints: columns of the inputs. own: number of the command's joint.
    """

    form: ClassVar[str] = "Lagrangian"
    joints: Joints
    own: int

    def __post_init__(self) -> None:
        if not 0 <= self.own < self.joints.count:
            raise UsageError(f"joint {self.own} is none of the {self.joints.count} joints")

    @cached_property
    def parameters(self) -> Parameters:
        """What theta is."""
        return Parameters(self.joints.slides, self.own)

    def names(self) -> tuple[str, ...]:
        return self.parameters.names()

    def roles(self) -> tuple[Role, ...]:
        return self.parameters.roles()

    def initial(self, half_range: Array, scale: float) -> Array:
        J = self.joints.count
        members = np.arange(1.0, J + 1.0)[:, None]  # joints that move a link
        v = np.broadcast_to(scale / np.sqrt(2.0 * members * (J - self.own)), (J, J))
        halves = (half_range[list(self.joints.positions)], half_range[list(self.joints.accelerations)])
        return self.parameters.start(*halves, np.array([scale, *[1.0] * J]), v)

    def gram(self, theta: Array, X: Array) -> tuple[Array, VJP]:
        from etude_lagrangian.one_output import LOWER

        p, F = self._packed(theta, X)
        half = np.tril(self._values(p, F, F, LOWER, len(X)))
        K = half + np.tril(half, -1).T

        def vjp(G: Array) -> Array:
            folded = np.ascontiguousarray(np.tril(G) + np.triu(G, 1).T)
            return self.parameters.pulled(p, self._gradients(p, F, F, LOWER, folded)[1])

        return K.T, vjp

    def cross(self, theta: Array, X: Array, Z: Array) -> tuple[Array, VJP]:
        from etude_lagrangian.one_output import EVERY

        p, F = self._packed(theta, X)
        fixed = self.joints.packed(Z)

        def vjp(G: Array) -> Array:
            dF, _ = self._gradients(p, F, fixed, EVERY, np.ascontiguousarray(G))
            return self.joints.pulled(F, dF, X.shape[1])

        return self._values(p, F, fixed, EVERY, len(Z)), vjp

    def diagonal(self, theta: Array, X: Array) -> Array:
        from etude_lagrangian.one_output import SELF

        p, F = self._packed(theta, X)
        return self._values(p, F, F, SELF, 1)[:, 0]

    def diagonal_gradient(self, theta: Array, X: Array, g: Array) -> Array:
        from etude_lagrangian.one_output import SELF

        p, F = self._packed(theta, X)
        dF, _ = self._gradients(p, F, F, SELF, np.ascontiguousarray(2.0 * g[:, None]))
        return self.joints.pulled(F, dF, X.shape[1])

    def at(self, theta: Array, Z: Array) -> Callable[[Array], Array]:
        """x (D,) -> k(x, Z) (m,), for one input at a time, often."""
        from etude_lagrangian.one_output import EVERY

        p, fixed = self._packed(theta, Z)
        return lambda x: self._values(p, self.joints.packed(x[None]), fixed, EVERY, len(Z))[0]

    def c_block(self, name: str, theta: Array, Z: Array) -> Code:
        """C99 of covariances with points Z (n, D); see `gp.c99.BlockKernel`."""
        from etude_lagrangian.c99 import kernel_code

        return kernel_code(name, self, theta, Z)

    def _packed(self, theta: Array, X: Array) -> tuple[Array, Array]:
        return self.parameters.array(self.check(theta)), self.joints.packed(X)

    def _values(self, p: Array, F: Array, Z: Array, pairs: int, columns: int) -> Array:
        from etude_lagrangian.one_output import sweep

        K = np.zeros((F.shape[2], columns))
        sweep(self.own, p, F, Z, pairs, K, False, F, p)
        return K

    def _gradients(self, p: Array, F: Array, Z: Array, pairs: int, G: Array) -> tuple[Array, Array]:
        from etude_lagrangian.one_output import sweep

        dF, dp = np.zeros_like(F), np.zeros_like(p)
        sweep(self.own, p, F, Z, pairs, G, True, dF, dp)
        return dF, dp


@dataclass(frozen=True)
class CommandPrior:
    """The factory of the kernel of one command."""

    def __call__(self, columns: Sequence[Column], commands: tuple[str, ...]) -> Kernel:
        """The Lagrangian prior of joint j's command, with friction: SE(q_j) + friction_j · SE(q_j) + linear.

        Friction is not conservative, so the prior alone is useless on a geared robot. All joints take part in
        the linear term, since the wrists of some robots are coupled.

        Raises:
            UsageError: several commands, or inputs without joints or friction columns.
        """
        joints, names = joints_of(columns)
        if len(commands) != 1 or commands[0] not in names:
            raise UsageError(
                "the Lagrangian prior is of the command of one joint",
                where=f"commands {', '.join(commands)}; joints {', '.join(names)}",
                next_step="Set kernel = 'ard_se', or sharing = 'separate'.",
            )
        return Lagrangian(joints, names.index(commands[0])) + own_friction(columns, commands)


gip_lin = CommandPrior()


def _restored(metadata: Metadata, _: Lookup) -> Lagrangian:
    joints = {name: tuple(values) for name, values in metadata["joints"].items()}
    return Lagrangian(Joints(**joints), int(metadata["own"]))


FORM = Form((), ("joints", "own"), _restored)
"""How the kernel is stored."""
