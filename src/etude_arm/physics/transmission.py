"""Transmissions from commands to joints: gears, coupled tendons, linear actuators between two bodies.

The moment matrix M (actuators x joints) is d length / d q; joint torques are M^T f and actuator speeds M qd.
The moment of a linear actuator depends on the pose. Identification in the actuator's coordinate therefore
need not learn this known geometry. One formula serves NumPy and the values of a graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from etude._runtime.operators import (
    Operand,
    Value,
    column,
    cross,
    joined,
    picked,
    root,
    stacked,
    swapped,
    widened,
)
from etude.errors import NumericalError
from etude_arm.physics.kinematics import BodyMotion, KinematicTree

Array = NDArray[np.float64]

RESTING = 0.1
"""Part of v0 below which a joint is at rest: 0.2 % of its velocity limit."""


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
        """1 or -1: direction of a drive of that joint alone; 0 for other drives."""
        turns = self.gear * self.coefficients
        alone = not len(self.bodies) and np.count_nonzero(turns) == 1
        return float(np.sign(turns[joint])) if alone else 0.0

    def resting(self, joint: int, v0: float) -> float:
        """Speed of the drive below which that joint is at rest; v0 is that of its friction."""
        return RESTING * v0 * abs(self.gear * float(self.coefficients[joint]))


@dataclass(frozen=True)
class DriveMotion:
    """Moment M (n, A, J) of every drive, n = 1 if it is constant; its speed and acceleration (n, A); A =
    J.
    """

    moment: Operand
    speed: Operand
    acceleration: Operand

    def inverse(self, size: int) -> Operand:
        """M^-1 (n, J, A) of the drives."""
        return (
            _eliminated(self.moment, size) if isinstance(self.moment, Value) else np.linalg.inv(self.moment)
        )

    def to_drive(self, torque: Array) -> Array:
        """Actuator forces f with M^T f = torque; torque is (n, J) or (n, J, P), one column for each
        regressor.
        """
        columns = torque if torque.ndim == 3 else torque[..., None]
        turned = np.swapaxes(self.moment, 1, 2)
        try:
            # constant moments: one inverse for all instants takes half of the time
            stands = len(turned) < len(columns)
            force = np.linalg.inv(turned) @ columns if stands else np.linalg.solve(turned, columns)
        except np.linalg.LinAlgError as error:
            raise NumericalError(
                "The drives cannot hold the robot in some configuration",
                where="their moment arms form a singular matrix",
                next_step="Check the actuators and tendons in the model file, or remove them from it.",
            ) from error
        return np.asarray(force if torque.ndim == 3 else force[..., 0])


@dataclass(frozen=True)
class Geometry:
    """The geometry and the nominal parameters of a robot, from its model file.

    Attributes:
        tree: bodies and joints, with the file's inertial parameters as the nominal ones.
        drives: one per axis; the joint itself where the file has no actuator.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]


def joint_drives(joints: int) -> tuple[Drive, ...]:
    """The geometry of a robot whose commands act on its joints directly."""
    none = np.zeros((0, 3))
    return tuple(Drive(1.0, row, np.zeros(0, dtype=np.int64), none) for row in np.eye(joints))


def drive_motion(
    tree: KinematicTree, drives: Sequence[Drive], motion: BodyMotion, qd: Operand, qdd: Operand
) -> DriveMotion:
    """Moments, speeds and accelerations of the drives along a body motion; exact, no differences."""
    gear = np.array([drive.gear for drive in drives])
    fixed = gear[:, None] * np.stack([drive.coefficients for drive in drives])
    speed, acceleration = qd @ fixed.T, qdd @ fixed.T
    if not any(len(drive.bodies) for drive in drives):
        return DriveMotion(fixed[None], speed, acceleration)
    lines = [_line(tree, drive, motion, qd * 0.0) for drive in drives]
    moment, own_speed, own_acceleration = zip(*lines, strict=True)
    return DriveMotion(
        fixed + gear[:, None] * stacked(moment, 1),
        speed + gear * joined(own_speed),
        acceleration + gear * joined(own_acceleration),
    )


def _line(tree: KinematicTree, drive: Drive, motion: BodyMotion, nothing: Operand) -> tuple[Operand, ...]:
    """Moment (n, J), speed and acceleration (n, 1) of the line through the drive's sites; zeros without."""
    sites = [_site(tree, motion, int(b), p) for b, p in zip(drive.bodies, drive.points, strict=True)]
    total = nothing, column(nothing, 0), column(nothing, 0)
    for first, second in pairwise(sites):
        total = tuple(part + more for part, more in zip(total, _segment(first, second), strict=True))
    return total


@dataclass(frozen=True)
class _Site:
    """Position, velocity, acceleration (n, 3) and Jacobian (n, J, 3) of a body-fixed point."""

    position: Operand
    velocity: Operand
    acceleration: Operand
    jacobian: Operand


def _site(tree: KinematicTree, motion: BodyMotion, body: int, point: Array) -> _Site:
    rotation, origin, velocity = (
        picked(part, body) for part in (motion.rotation, motion.position, motion.velocity)
    )
    acceleration, omega, alpha = (
        picked(part, body) for part in (motion.acceleration, motion.omega, motion.alpha)
    )
    arm = rotation @ point
    position, swing = origin + arm, cross(omega, arm)
    path, slides = np.zeros((tree.joints, 1)), tree.joint_slides.astype(float)[:, None]
    path[tree.path(body)] = 1.0
    axes, anchors = swapped(motion.axis, 1, 0, 2), swapped(motion.anchor, 1, 0, 2)
    jacobian = path * ((1.0 - slides) * cross(axes, widened(position, 1) - anchors) + slides * axes)
    return _Site(position, velocity + swing, acceleration + cross(alpha, arm) + cross(omega, swing), jacobian)


def _segment(first: _Site, second: _Site) -> tuple[Operand, Operand, Operand]:
    """Moment (n, J), speed and acceleration (n, 1) of the distance between two sites."""
    gap, drift = second.position - first.position, second.velocity - first.velocity
    length = widened(root((gap * gap).sum(1)), 1)
    direction = gap / length
    moment = ((second.jacobian - first.jacobian) * widened(direction, 1)).sum(2)
    speed = widened((direction * drift).sum(1), 1)
    push = widened((direction * (second.acceleration - first.acceleration)).sum(1), 1)
    return moment, speed, push + (widened((drift * drift).sum(1), 1) - speed * speed) / length


def _eliminated(moment: Value, size: int) -> Value:
    """M^-1 (n, J, A) = M' (M M')^-1: elimination of a positive definite matrix needs no pivots.

    Written as sums of products, since onnxruntime fuses Transpose and MatMul to an operator without double
    precision.
    """
    square = (moment.widened(2) * moment.widened(1)).sum(3)
    left = [square.at([i], 1).sum(1) for i in range(size)]
    right: list[Operand] = [left[0] * 0.0 + row for row in np.eye(size)]
    for k in range(size):
        pivot = left[k].at([k])
        left[k], right[k] = left[k] / pivot, right[k] / pivot
        for i in set(range(size)) - {k}:
            factor = left[i].at([k])
            left[i], right[i] = left[i] - factor * left[k], right[i] - factor * right[k]
    inverse = joined([row.widened(1) for row in right], 1)
    pseudo_inverse: Value = (moment.widened(3) * inverse.widened(2)).sum(1)
    return pseudo_inverse
