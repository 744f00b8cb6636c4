"""Drives in the operators of ONNX: moments, speeds, accelerations, and the way back from joints to drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from etude._runtime.operators import Operand, Value, cross, joined, stacked
from etude_arm.physics.kinematics import BodyMotion, KinematicTree
from etude_arm.physics.transmission import Drive


@dataclass(frozen=True)
class DriveGraph:
    """moment (n, A, J) and its inverse (n, J, A), arrays with n = 1 where they stand; speed, acceleration
    (n, A).
    """

    moment: Operand
    inverse: Operand
    speed: Value
    acceleration: Value


@dataclass(frozen=True)
class Site:
    """Position, velocity, acceleration (n, 3) and Jacobian (n, J, 3) of a point of a body."""

    position: Value
    velocity: Value
    acceleration: Value
    jacobian: Value


def drives_of(
    tree: KinematicTree, drives: Sequence[Drive], motion: BodyMotion, qd: Value, qdd: Value
) -> DriveGraph:
    """Of the drives along a motion (`transmission.drive_motion`)."""
    gear = np.array([drive.gear for drive in drives])
    fixed = gear[:, None] * np.stack([drive.coefficients for drive in drives])
    speed, acceleration = qd @ fixed.T, qdd @ fixed.T
    if not any(len(drive.bodies) for drive in drives):
        return DriveGraph(fixed[None], np.linalg.inv(fixed)[None], speed, acceleration)
    own = [_line(tree, drive, motion, qd * 0.0) for drive in drives]
    moment = fixed + gear[:, None] * stacked([part[0] for part in own], 1)
    return DriveGraph(
        moment,
        _eliminated(moment, len(gear)),
        speed + gear * joined([part[1] for part in own]),
        acceleration + gear * joined([part[2] for part in own]),
    )


def _line(
    tree: KinematicTree, drive: Drive, motion: BodyMotion, nothing: Value
) -> tuple[Value, Value, Value]:
    """Moment (n, J), speed and acceleration (n, 1) of the line through the drive's sites; zeros without."""
    sites = [_site(tree, motion, int(b), p) for b, p in zip(drive.bodies, drive.points, strict=True)]
    moment, speed, acceleration = nothing, nothing.at([0]), nothing.at([0])
    for first, second in pairwise(sites):
        part = _segment(first, second)
        moment, speed, acceleration = moment + part[0], speed + part[1], acceleration + part[2]
    return moment, speed, acceleration


def _site(tree: KinematicTree, motion: BodyMotion, body: int, point: Operand) -> Site:
    R, origin, velocity, acceleration, omega, alpha = (
        getattr(motion, name).at([body], 0).sum(0)
        for name in ("rotation", "position", "velocity", "acceleration", "omega", "alpha")
    )
    arm = R @ point
    position, swing = origin + arm, cross(omega, arm)
    path, slides = np.zeros((tree.joints, 1)), tree.joint_slides.astype(float)[:, None]
    path[tree.path(body)] = 1.0
    axes, anchors = (part.swapped(1, 0, 2) for part in (motion.axis, motion.anchor))
    jacobian = path * ((1.0 - slides) * cross(axes, position.widened(1) - anchors) + slides * axes)
    vjp = acceleration + cross(alpha, arm) + cross(omega, swing)
    return Site(position, velocity + swing, vjp, jacobian)


def _segment(first: Site, second: Site) -> tuple[Value, Value, Value]:
    """Moment (n, J), speed and acceleration (n, 1) of the distance between two sites."""
    gap, drift = second.position - first.position, second.velocity - first.velocity
    length = (gap * gap).sum(1).of("Sqrt").widened(1)
    direction = gap / length
    moment = ((second.jacobian - first.jacobian) * direction.widened(1)).sum(2)
    speed = (direction * drift).sum(1).widened(1)
    push = (direction * (second.acceleration - first.acceleration)).sum(1).widened(1)
    return moment, speed, push + ((drift * drift).sum(1).widened(1) - speed * speed) / length


def _eliminated(moment: Value, size: int) -> Value:
    """M^-1 (n, J, A) = M' (M M')^-1: elimination needs no pivots where a matrix is positive definite.

    Sums of products, as onnxruntime joins Transpose and MatMul to an operator that it has not for double.
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
    return (moment.widened(3) * inverse.widened(2)).sum(1)
