"""Rigid-body kinematics of a fixed-base tree, vectorised over samples, in plain NumPy.

MuJoCo reads the robot's URDF or MJCF once (`rigid_tree.tree_from_mujoco`); afterwards nothing here needs it,
so that a saved model predicts without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def cross(a: Array, b: Array) -> Array:
    """a x b of vectors (..., 3), to the bit as np.cross, which spends most of a tick on its generality."""
    parts = [a[..., i] * b[..., j] - a[..., j] * b[..., i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return np.stack(parts, axis=-1)


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

    Joint j belongs to column j of q: joints that are no axis of the robot have been locked at their zero.
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
        """The joints that move `body`, i.e. its own and its ancestors'."""
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

    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    omega: Array
    alpha: Array
    axis: Array
    anchor: Array


def axis_rotation(axis: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about a fixed unit axis (3,) by angle (n,); Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * K + versine * (K @ K))


@dataclass
class _Frame:
    """Motion of one body-fixed frame while joints are being applied to it."""

    rotation: Array
    position: Array
    velocity: Array
    acceleration: Array
    omega: Array
    alpha: Array

    def shifted(self, point: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of the body-fixed point that is at `point` (n, 3) now."""
        arm = point - self.position
        swing = cross(self.omega, arm)
        return self.velocity + swing, self.acceleration + cross(self.alpha, arm) + cross(self.omega, swing)


def _after_hinge(frame: _Frame, axis: Array, anchor: Array, turn: Array, rate: Array, pull: Array) -> _Frame:
    """The frame after a hinge: `axis` and `anchor` in the body's frame, `turn` (n, 3, 3), rate and pull
    (n, 1).
    """
    z = frame.rotation @ axis
    pivot = frame.position + frame.rotation @ anchor
    velocity, acceleration = frame.shifted(pivot)
    moved = _Frame(
        frame.rotation @ turn,
        pivot,
        velocity,
        acceleration,
        frame.omega + z * rate,
        frame.alpha + z * pull + cross(frame.omega, z * rate),
    )
    origin = pivot - moved.rotation @ anchor
    moved.velocity, moved.acceleration = moved.shifted(origin)
    moved.position = origin
    return moved


def _after_slide(frame: _Frame, axis: Array, shift: Array, rate: Array, pull: Array) -> _Frame:
    """The frame after a sliding joint; shift, rate, pull are (n, 1)."""
    z = frame.rotation @ axis
    origin = frame.position + z * shift
    velocity, acceleration = frame.shifted(origin)
    return _Frame(
        frame.rotation,
        origin,
        velocity + z * rate,
        acceleration + z * pull + 2.0 * cross(frame.omega, z * rate),
        frame.omega,
        frame.alpha,
    )


def body_motion(tree: KinematicTree, q: Array, qd: Array, qdd: Array) -> BodyMotion:
    """Motion of all bodies for q, qd, qdd (n, J): the forward half of recursive Newton-Euler."""
    n = len(q)
    still = np.zeros((n, 3))
    frames = [_Frame(np.broadcast_to(np.eye(3), (n, 3, 3)), still, still, still, still, still)]
    axes, anchors = np.zeros((tree.joints, n, 3)), np.zeros((tree.joints, n, 3))
    for body in range(1, tree.bodies):
        base = frames[tree.parent[body]]
        origin = base.position + base.rotation @ tree.position[body]
        velocity, acceleration = base.shifted(origin)
        frame = _Frame(
            base.rotation @ tree.rotation[body], origin, velocity, acceleration, base.omega, base.alpha
        )
        for j in np.flatnonzero(tree.joint_body == body):
            axis, anchor = tree.joint_axis[j], tree.joint_anchor[j]
            axes[j] = frame.rotation @ axis
            anchors[j] = frame.position + frame.rotation @ anchor
            travel, rate, pull = q[:, j] - tree.joint_zero[j], qd[:, j, None], qdd[:, j, None]
            if tree.joint_slides[j]:
                frame = _after_slide(frame, axis, travel[:, None], rate, pull)
            else:
                frame = _after_hinge(frame, axis, anchor, axis_rotation(axis, travel), rate, pull)
        frames.append(frame)

    def stacked(name: str) -> Array:
        return np.stack([getattr(frame, name) for frame in frames])

    return BodyMotion(
        rotation=stacked("rotation"),
        position=stacked("position"),
        velocity=stacked("velocity"),
        acceleration=stacked("acceleration"),
        omega=stacked("omega"),
        alpha=stacked("alpha"),
        axis=axes,
        anchor=anchors,
    )
