"""Rigid-body kinematics of a fixed-base tree, vectorised over samples, in NumPy or in the values of a graph.

MuJoCo reads the robot's URDF or MJCF once (`rigid_tree.tree_from_mujoco`). This module does not need MuJoCo,
so a saved model predicts without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from etude._runtime.operators import Operand, Value, column, cosine, cross, shaped, sine, stacked

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class KinematicTree:
    """Bodies in an order where parents come first; body 0 is the world.

    Attributes:
        parent: (B,) index of the parent body.
        position: (B, 3) and rotation: (B, 3, 3) pose in the parent's frame at joint value zero, m.
        joint_body: (J,) the body a joint moves.
        joint_axis: (J, 3) unit vector and joint_anchor: (J, 3) point, in the frame of that body.
        joint_slides: (J,) True for a sliding joint.
        joint_zero: (J,) joint value at which the body has the pose above.
        gravity: (3,) m/s^2.
        nominal: (B, 10) inertial parameters [m, m c, I about the body's origin: xx yy zz xy xz yz].

    Joint j belongs to column j of q: joints that are not axes of the robot are locked at their zero.
    """

    parent: Ints
    position: Array
    rotation: Array
    joint_body: Ints
    joint_axis: Array
    joint_anchor: Array
    joint_slides: NDArray[np.bool_]
    joint_zero: Array
    gravity: Array
    nominal: Array

    @property
    def bodies(self) -> int:
        return len(self.parent)

    @property
    def joints(self) -> int:
        return len(self.joint_body)

    def path(self, body: int) -> list[int]:
        """The joints that move `body`: its own and those of its ancestors."""
        on_path: list[int] = []
        while body > 0:
            on_path += [j for j in range(self.joints) if self.joint_body[j] == body]
            body = int(self.parent[body])
        return on_path


@dataclass(frozen=True)
class BodyMotion:
    """World-frame motion of every body and joint at n samples.

    Attributes:
        rotation: (B, n, 3, 3), position, velocity, acceleration: (B, n, 3) of the body's origin.
        omega, alpha: (B, n, 3) angular velocity and acceleration.
        axis, anchor: (J, n, 3) joint axes and a point on each.
    """

    rotation: Any
    position: Any
    velocity: Any
    acceleration: Any
    omega: Any
    alpha: Any
    axis: Any
    anchor: Any


def axis_rotation(axis: Array, angle: Operand) -> Operand:
    """Rotation matrices (n, 3, 3) about a fixed unit axis (3,) by angle (n,); Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = shaped(angle, -1, 1, 1)
    return np.eye(3) + sine(turn) * K + (1.0 - cosine(turn)) * (K @ K)


class _Frame(NamedTuple):
    """Motion of a frame that is fixed to a body: rotation (n, 3, 3), the others (n, 3)."""

    rotation: Operand
    position: Operand
    velocity: Operand
    acceleration: Operand
    omega: Operand
    alpha: Operand

    def moved(self, point: Operand) -> _Frame:
        """The frame of the same body at another point (n, 3), given in the world."""
        rotation, position, velocity, acceleration, omega, alpha = self
        arm = point - position
        swing = cross(omega, arm)
        pulled = acceleration + cross(alpha, arm) + cross(omega, swing)
        return _Frame(rotation, point, velocity + swing, pulled, omega, alpha)


def _after_hinge(
    frame: _Frame, axis: Array, anchor: Array, travel: Operand, rate: Operand, joint_acceleration: Operand
) -> _Frame:
    """The frame after a hinge: `axis` and `anchor` in the body's frame; joint values (n, 1)."""
    z, omega = frame.rotation @ axis, frame.omega
    spun = z * rate
    offset = anchor.any()  # most hinges go through the origin of their body, which then stays where it is
    there = frame.moved(frame.position + frame.rotation @ anchor) if offset else frame
    rotation = frame.rotation @ axis_rotation(axis, travel)
    alpha = frame.alpha + z * joint_acceleration + cross(omega, spun)
    turned = _Frame(rotation, there.position, there.velocity, there.acceleration, omega + spun, alpha)
    return turned.moved(there.position - rotation @ anchor) if offset else turned


def _after_slide(
    frame: _Frame, axis: Array, travel: Operand, rate: Operand, joint_acceleration: Operand
) -> _Frame:
    """The frame after a sliding joint; joint values are (n, 1)."""
    z, omega, alpha = frame.rotation @ axis, frame.omega, frame.alpha
    slid, spun = frame.moved(frame.position + z * travel), z * rate
    acceleration = slid.acceleration + z * joint_acceleration + 2.0 * cross(omega, spun)
    return _Frame(frame.rotation, slid.position, slid.velocity + spun, acceleration, omega, alpha)


def body_motion(tree: KinematicTree, q: Operand, qd: Operand, qdd: Operand) -> BodyMotion:
    """Motion of all bodies for q, qd, qdd (n, J): the forward half of recursive Newton-Euler."""
    n = 1 if isinstance(q, Value) else len(q)
    still = np.zeros((n, 3))
    frames = [_Frame(np.broadcast_to(np.eye(3), (n, 3, 3)), still, still, still, still, still)]
    axes: list[Operand] = [still] * tree.joints
    anchors: list[Operand] = [still] * tree.joints
    for body in range(1, tree.bodies):
        base = frames[tree.parent[body]]
        frame = base.moved(base.position + base.rotation @ tree.position[body])
        frame = _Frame(base.rotation @ tree.rotation[body], *frame[1:])
        for j in np.flatnonzero(tree.joint_body == body).tolist():
            axis, anchor = tree.joint_axis[j], tree.joint_anchor[j]
            axes[j] = frame.rotation @ axis
            anchors[j] = frame.position + frame.rotation @ anchor
            go = column(q, j) - tree.joint_zero[j], column(qd, j), column(qdd, j)
            slides = tree.joint_slides[j]
            frame = _after_slide(frame, axis, *go) if slides else _after_hinge(frame, axis, anchor, *go)
        frames.append(frame)

    def all_of(name: str) -> Operand:
        return stacked([getattr(frame, name) for frame in frames])

    return BodyMotion(
        rotation=all_of("rotation"),
        position=all_of("position"),
        velocity=all_of("velocity"),
        acceleration=all_of("acceleration"),
        omega=all_of("omega"),
        alpha=all_of("alpha"),
        axis=stacked(axes),
        anchor=stacked(anchors),
    )
