"""Regressor of the identified model along a reference, for adaptive control: Y(q, qd, qd_r, qdd_r).

Coriolis and centrifugal terms are bilinear in the measured and the reference rate, by the Christoffel
symbols. With h(v) the terms quadratic in v, the symmetric bilinear form is (h(a + b) - h(a - b)) / 4. This
makes H' - 2 C skew-symmetric, which the proof of Slotine and Li (1987) needs. The same polarisation holds for
moment arms that change with the pose; terms linear in the rate use the reference rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.physics.mean import ArmPhysics
from etude_arm.physics.rigid_body import EXTRA_TERMS, RigidBodyModel, command_regressors

ARMATURE = EXTRA_TERMS.index("armature")
FRICTION = [i for i, term in enumerate(EXTRA_TERMS) if term.startswith("friction")]
AT_REFERENCE, AT_DIFFERENCE, AT_REST, RUBBING, UNITS = 0, 1, 2, 3, 4
"""States from which one regressor is composed; unit accelerations come last."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Regressor at one instant; J joints, n features, in command units.

    Attributes:
        features: (J, n), the command is (features * weights).sum(1).
        inertia: (J, n, J), their derivatives in the reference's acceleration.
        moment: (J, J), d length / d q of the drives.
    """

    features: Array
    inertia: Array
    moment: Array


@dataclass(frozen=True, eq=False)
class ReferenceRegressor:
    """Separate parameters for every command, in its unit, since the gains of the motors are unknown.

    Attributes:
        physics: the robot's tree, drives and friction velocity.
        combinations: (J, P + E, n) of inertial parameters and of the drive's terms; weights are N(0, 1)
            before any data. Commands with fewer features than n have zeros in the last ones.
    """

    physics: ArmPhysics
    combinations: Array

    @staticmethod
    def of(physics: ArmPhysics) -> ReferenceRegressor:
        """The regressor of a robot. UsageError if it has no model file."""
        regressors = physics.regressors()
        rigid, extra = regressors[0].rigid.shape[0], len(EXTRA_TERMS)
        most = max(r.rigid.shape[1] for r in regressors) + extra
        combinations = np.zeros((len(regressors), rigid + extra, most))
        for j, regressor in enumerate(regressors):
            count = regressor.rigid.shape[1]
            combinations[j, :rigid, :count] = regressor.rigid
            combinations[j, rigid:, count : count + extra] = np.diag(regressor.extra)
        return ReferenceRegressor(physics, combinations)

    @property
    def zero(self) -> Array:
        """(J, n) prior mean of the weights: zeros."""
        return np.zeros((len(self.combinations), self.combinations.shape[2]))

    @property
    def count(self) -> Array:
        """(J,) features of each command."""
        return np.asarray(np.any(self.combinations != 0.0, axis=1).sum(axis=1), dtype=np.float64)

    def weights(self, model: RigidBodyModel) -> Array:
        """(J, n) least-norm weights with the commands of `model`. UsageError: it has other joints or
        bodies.
        """
        parameters = np.concatenate([model.inertial, model.extra], axis=1)
        if parameters.shape != self.combinations.shape[:2]:
            raise UsageError(
                f"the model has {parameters.shape[1]} parameters of each of {len(parameters)} joints, "
                f"the robot {self.combinations.shape[1]} of each of {len(self.combinations)}",
                where=self.physics.spec.name,
                next_step="Identify a model of this robot.",
            )
        rows = zip(self.combinations, parameters, strict=True)
        return np.array([np.linalg.pinv(combination) @ values for combination, values in rows])

    def at(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Reference:
        """At measured q, qd and a reference's qd_r, qdd_r, (J,) each; friction is that at qd_r."""
        rows = self._rows(q, qd, qd_r, qdd_r)
        bent = rows[AT_REFERENCE] - rows[AT_DIFFERENCE] + rows[AT_REST]
        friction = [column - len(EXTRA_TERMS) for column in FRICTION]
        bent[:, friction] = rows[RUBBING][:, friction]
        units = rows[UNITS:] - rows[AT_REST]
        return Reference(
            features=np.einsum("jp,jpn->jn", bent, self.combinations),
            inertia=np.einsum("ijp,jpn->jni", units, self.combinations),
            moment=units[:, :, ARMATURE - len(EXTRA_TERMS)].T,
        )

    def _rows(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """(UNITS + J, J, P + E) regressors at the states named above."""
        dof = len(q)
        rate, acceleration = np.zeros((2, UNITS + dof, dof))
        rate[AT_REFERENCE], rate[AT_DIFFERENCE], rate[RUBBING] = 0.5 * (qd + qd_r), 0.5 * (qd - qd_r), qd_r
        acceleration[AT_REFERENCE], acceleration[UNITS:] = qdd_r, np.eye(dof)
        tree, drives = self.physics.geometry.tree, self.physics.geometry.drives
        motion = np.tile(q, (UNITS + dof, 1)), rate, acceleration
        rigid, extra = command_regressors(tree, drives, self.physics.friction_velocity, *motion)
        return np.concatenate([rigid, extra], axis=2)
