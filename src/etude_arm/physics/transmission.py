"""How a command's force reaches the joints: gears, coupled tendons, linear actuators between two bodies.

The moment matrix M (actuators x joints) holds d length / d q; joint torques are M^T f and actuator speeds M
qd. A linear actuator's moment changes with the configuration, and identification in its own coordinate
leaves that known geometry out of what has to be learned.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from etude._runtime.operators import cross
from etude.errors import NumericalError
from etude_arm.physics.kinematics import BodyMotion, KinematicTree

Array = NDArray[np.float64]

RESTING = 0.1
"""Part of v0 below which a joint rests: .2 % of its velocity limit."""


@dataclass(frozen=True)
class Drive:
    """The actuator of one axis: length = gear * (coefficients @ q + length of the polyline through its
    sites).

    Attributes:
        gear: signed gear ratio.
        coefficients: (J,) constant part of the moment: a joint actuator or a tendon that couples joints.
        bodies, points: (S,), (S, 3) the sites of a spatial tendon, each in its body's frame; S = 0 without
        one.
    """

    gear: float
    coefficients: Array
    bodies: NDArray[np.int64]
    points: Array

    def side(self, joint: int) -> float:
        """1 or -1: how a drive that is that joint's alone turns with it; 0 of all others."""
        turns = self.gear * self.coefficients
        alone = not len(self.bodies) and np.count_nonzero(turns) == 1
        return float(np.sign(turns[joint])) if alone else 0.0

    def resting(self, joint: int, v0: float) -> float:
        """Speed of the drive, lone or not, below which that joint rests; v0 is that of its friction."""
        return RESTING * v0 * abs(self.gear * float(self.coefficients[joint]))


@dataclass(frozen=True)
class DriveMotion:
    """Moment M (n, A, J) of every drive, its speed (n, A) and acceleration (n, A); A = J."""

    moment: Array
    speed: Array
    acceleration: Array

    def to_drive(self, torque: Array) -> Array:
        """Actuator forces f with M^T f = torque; torque is (n, J) or (n, J, P), one column for each
        regressor.
        """
        columns = torque if torque.ndim == 3 else torque[..., None]
        try:
            force = np.linalg.solve(np.swapaxes(self.moment, 1, 2), columns)
        except np.linalg.LinAlgError as error:
            raise NumericalError(
                "The drives cannot hold the robot in some configuration",
                where="their moment arms form a singular matrix",
                next_step="Check the actuators and tendons in the model file, or remove them from it.",
            ) from error
        return np.asarray(force if torque.ndim == 3 else force[..., 0])


@dataclass(frozen=True)
class Geometry:
    """What a model file says of a robot without any data.

    Attributes:
        tree: bodies and joints, with the file's inertial parameters as the nominal ones.
        drives: one per axis; the joint itself where the file has no actuator.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]


def joint_drives(joints: int) -> tuple[Drive, ...]:
    """The transmission of a robot whose commands act on its joints directly."""
    none = np.zeros((0, 3))
    return tuple(Drive(1.0, row, np.zeros(0, dtype=np.int64), none) for row in np.eye(joints))


def drive_motion(
    tree: KinematicTree, drives: tuple[Drive, ...], motion: BodyMotion, qd: Array, qdd: Array
) -> DriveMotion:
    """Moments, speeds and accelerations of the drives along a body motion; exact, no differences."""
    moments, speeds, accelerations = [], [], []
    for drive in drives:
        moment = np.broadcast_to(drive.coefficients, qd.shape)
        speed, acceleration = qd @ drive.coefficients, qdd @ drive.coefficients
        sites = [_site(tree, motion, int(b), p) for b, p in zip(drive.bodies, drive.points, strict=True)]
        for first, second in pairwise(sites):
            part = _segment(first, second)
            moment, speed, acceleration = moment + part[0], speed + part[1], acceleration + part[2]
        moments.append(drive.gear * moment)
        speeds.append(drive.gear * speed)
        accelerations.append(drive.gear * acceleration)
    return DriveMotion(np.stack(moments, axis=1), np.stack(speeds, axis=1), np.stack(accelerations, axis=1))


@dataclass(frozen=True)
class _Site:
    """Position, velocity, acceleration (n, 3) and Jacobian (n, 3, J) of a body-fixed point."""

    position: Array
    velocity: Array
    acceleration: Array
    jacobian: Array


def _site(tree: KinematicTree, motion: BodyMotion, body: int, point: Array) -> _Site:
    arm = motion.rotation[body] @ point
    position = motion.position[body] + arm
    omega, alpha = motion.omega[body], motion.alpha[body]
    swing = cross(omega, arm)
    jacobian = np.zeros((len(position), 3, tree.joints))
    for j in tree.path(body):
        axis = motion.axis[j]
        jacobian[:, :, j] = axis if tree.joint_slides[j] else cross(axis, position - motion.anchor[j])
    acceleration = motion.acceleration[body] + cross(alpha, arm) + cross(omega, swing)
    return _Site(position, motion.velocity[body] + swing, acceleration, jacobian)


def _segment(first: _Site, second: _Site) -> tuple[Array, Array, Array]:
    """Moment (n, J), speed (n,) and acceleration (n,) of the distance between two sites."""
    gap, drift = second.position - first.position, second.velocity - first.velocity
    length = np.linalg.norm(gap, axis=1)
    direction = gap / length[:, None]
    moment = np.einsum("ni,nij->nj", direction, second.jacobian - first.jacobian)
    speed = np.sum(direction * drift, axis=1)
    push = np.sum(direction * (second.acceleration - first.acceleration), axis=1)
    return moment, speed, push + (np.sum(drift**2, axis=1) - speed**2) / length
