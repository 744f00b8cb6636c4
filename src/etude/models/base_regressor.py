"""The identified model's regressor of one output as features of a linear regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.models.base_parameters import spread_states
from etude.models.kinematics import KinematicTree
from etude.models.rigid_body import IdentificationPrior, command_regressors
from etude.models.transmission import Drive
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]

ANGLE_STEP = 1e-3  # rad or m
SPEED_STEP = 5e-3  # of the friction velocity, over which tanh changes
PULL_STEP = 1.0  # rad/s^2; the regressor is linear in it
STENCIL = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))


@dataclass(frozen=True)
class BaseRegressor:
    """Features (n, 1 + r + E) of output `joint`: nominal model, base parameters, drive and friction terms.

    Inputs are rows [q, qd, qdd, ...]; further columns, as a feature map may append, are not read.

    Attributes:
        tree, drives: the robot's geometry.
        friction_velocity: (dof,) v0 of the friction columns, rad/s.
        joint: which output.
        rigid: (P, 1 + r) combinations of inertial parameters, and extra: (E,) factors of the other terms,
            each in command units at its prior deviation, so that all weights are N(0, 1).
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array
    joint: int
    rigid: Array
    extra: Array

    def transform(self, X: Array) -> Array:
        """Features at X (n, D), D >= 3 dof."""
        motion = np.split(X[:, : 3 * self.tree.joints], 3, axis=1)
        rigid, extra = command_regressors(self.tree, self.drives, self.friction_velocity, *motion)
        return np.concatenate([rigid[:, self.joint] @ self.rigid, extra[:, self.joint] * self.extra], axis=1)

    def pullback(self, X: Array, G: Array) -> Array:
        """Gradient (n, D) of sum(G * transform(X)), by differences of fourth order: good to about 1e-9.

        The regressor is a polynomial of second degree in qd, linear in qdd and smooth in q, so only the
        steps in q and the friction terms leave an error at all.
        """
        out, dof = np.zeros_like(X), self.tree.joints
        steps = np.concatenate(
            [np.full(dof, ANGLE_STEP), SPEED_STEP * self.friction_velocity, np.full(dof, PULL_STEP)]
        )
        shifts = np.zeros((len(steps), len(STENCIL), X.shape[1]))
        for column, step in enumerate(steps):
            shifts[column, :, column] = [step * factor for factor, _ in STENCIL]
        for column, step in enumerate(steps):
            moved = (X + shifts[column][:, None]).reshape(-1, X.shape[1])
            values = self.transform(moved).reshape(len(STENCIL), len(X), -1)
            sums = np.einsum("snp,np->sn", values, G)
            out[:, column] = np.array([weight for _, weight in STENCIL]) @ sums / step
        return out


def base_regressors(
    spec: RobotSpec, tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array
) -> tuple[BaseRegressor, ...]:
    """One per output, scaled by what identification assumes of its parameters before any data."""
    spread = command_regressors(tree, drives, friction_velocity, *spread_states(spec, 64 + 24 * tree.bodies))
    made = []
    for j in range(spec.dof):
        prior = IdentificationPrior.of_output(tree, spread[0][:, j], spread[1][:, j], float(spec.command[j]))
        rigid = prior.gain * np.column_stack([prior.nominal, prior.directions])
        made.append(BaseRegressor(tree, drives, friction_velocity, j, rigid, prior.extra))
    return tuple(made)
