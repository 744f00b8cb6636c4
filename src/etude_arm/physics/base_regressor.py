"""The identified model's regressor of one output as features of a linear regression."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from etude_arm.physics.identification import output_priors
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.rigid_body import command_regressors
from etude_arm.physics.transmission import Drive
from etude_arm.spec import ArmSpec

Array = NDArray[np.float64]
Pair = tuple[Array, Array]

ANGLE_STEP = 1e-3  # rad or m
SPEED_STEP = 5e-3  # of the friction velocity, over which tanh changes
PULL_STEP = 1.0  # rad/s^2; the regressor is linear in it
# central differences of fourth order: step, weight
STENCIL = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))


@dataclass(frozen=True)
class MotionRegressor:
    """Regressors of all outputs at rows [q, qd, qdd, ...] and their derivatives.

    The last results are cached, since the outputs of a robot use the same inputs one after another.

    Attributes:
        tree, drives: the robot's geometry.
        friction_velocity: (dof,) v0 of the friction columns, rad/s.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array
    _last: dict[str, tuple[bytes, Pair]] = field(default_factory=dict, repr=False, compare=False)

    def value(self, X: Array) -> Pair:
        """Rigid (n, J, P) and extra (n, J, E) at X (n, D), D >= 3 J."""
        return self._memoized("value", X)

    def slopes(self, X: Array) -> Pair:
        """Derivatives (3 J, n, J, P) and (3 J, n, J, E) in the columns of q, qd and qdd.

        Computed by differences of fourth order, with an error of about 1e-9. The regressor is quadratic in
        qd, linear in qdd and smooth in q, so only q and the friction terms have an error.
        """
        return self._memoized("slopes", X)

    def _memoized(self, name: str, X: Array) -> Pair:
        key = X.tobytes()
        if name not in self._last or self._last[name][0] != key:
            self._last[name] = key, self._value(X) if name == "value" else self._slopes(X)
        return self._last[name][1]

    def _value(self, X: Array) -> Pair:
        motion = np.split(X[:, : 3 * self.tree.joints], 3, axis=1)
        return command_regressors(self.tree, self.drives, self.friction_velocity, *motion)

    def _slopes(self, X: Array) -> Pair:
        dof = self.tree.joints
        steps = [np.full(dof, ANGLE_STEP), SPEED_STEP * self.friction_velocity, np.full(dof, PULL_STEP)]
        slopes = [self._slope(X, column, step) for column, step in enumerate(np.concatenate(steps))]
        rigid, extra = zip(*slopes, strict=True)
        return np.stack(rigid), np.stack(extra)

    def _slope(self, X: Array, column: int, step: float) -> Pair:
        """Derivatives (n, J, P) and (n, J, E) in one column of X."""
        moved = np.tile(X, (len(STENCIL), 1, 1))
        moved[:, :, column] += step * np.array([[factor] for factor, _ in STENCIL])
        weights = np.array([weight for _, weight in STENCIL]) / step
        rigid, extra = self._value(moved.reshape(-1, X.shape[1]))
        shape = (len(STENCIL), len(X), self.tree.joints, -1)
        return (
            np.tensordot(weights, rigid.reshape(shape), axes=1),
            np.tensordot(weights, extra.reshape(shape), axes=1),
        )


@dataclass(frozen=True)
class BaseRegressor:
    """Features (n, 1 + r + E) of output `joint`: nominal model, base parameters, drive and friction terms.

    Inputs are rows [q, qd, qdd, ...]; further columns of a feature map are ignored.

    Attributes:
        motion: the regressors of all outputs.
        joint: which output.
        rigid: (P, 1 + r) combinations of inertial parameters, and extra: (E,) factors of the other terms,
            each in command units at its prior deviation, so that all weights are N(0, 1).
    """

    motion: MotionRegressor
    joint: int
    rigid: Array
    extra: Array

    def transform(self, X: Array) -> Array:
        """Features at X (n, D), D >= 3 dof."""
        rigid, extra = self.motion.value(X)
        return np.concatenate([rigid[:, self.joint] @ self.rigid, extra[:, self.joint] * self.extra], axis=1)

    def pullback(self, X: Array, G: Array) -> Array:
        """Gradient (n, D) of sum(G * transform(X)) with respect to X; G is (n, 1 + r + E)."""
        rigid, extra = self.motion.slopes(X)
        combinations = self.rigid.shape[1]
        in_rigid, in_extra = G[:, :combinations] @ self.rigid.T, G[:, combinations:] * self.extra
        out = np.zeros_like(X)
        out[:, : len(rigid)] = np.einsum("cnp,np->nc", rigid[:, :, self.joint], in_rigid)
        out[:, : len(rigid)] += np.einsum("cne,ne->nc", extra[:, :, self.joint], in_extra)
        return out


def base_regressors(
    spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array
) -> tuple[BaseRegressor, ...]:
    """One regressor per output, scaled by the prior deviations of identification."""
    motion = MotionRegressor(tree, drives, friction_velocity)
    regressors = []
    for j, prior in enumerate(output_priors(spec, tree, drives, friction_velocity)):
        rigid = prior.gain * np.column_stack([prior.nominal, prior.directions])
        regressors.append(BaseRegressor(motion, j, rigid, prior.extra))
    return tuple(regressors)
