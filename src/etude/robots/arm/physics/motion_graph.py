"""Motion of all bodies of an arm in the operators of ONNX: the same steps as `kinematics`, body by body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.operators import Operand, Value, cross, stacked
from etude.robots.arm.physics.kinematics import KinematicTree


@dataclass(frozen=True)
class Frame:
    """Motion in the world of a frame fixed to a body: (n, 3, 3) and (n, 3), arrays where it stands."""

    rotation: Operand
    position: Operand
    velocity: Operand
    acceleration: Operand
    omega: Operand
    alpha: Operand

    def shifted(self, point: Operand) -> tuple[Operand, Operand]:
        """Velocity and acceleration of the body-fixed point that is at `point` now."""
        arm = point - self.position
        swing = cross(self.omega, arm)
        return self.velocity + swing, self.acceleration + cross(self.alpha, arm) + cross(self.omega, swing)

    def moved(self, point: Operand) -> Frame:
        """The frame of the same body there."""
        velocity, acceleration = self.shifted(point)
        return replace(self, position=point, velocity=velocity, acceleration=acceleration)


@dataclass(frozen=True)
class Moving:
    """All of a tree: rotation (n, B, 3, 3), position, acceleration, omega, alpha (n, B, 3) of the bodies but
    the world; axes, anchors (n, J, 3) of the joints; frames: one by one, the world's first.
    """

    rotation: Value
    position: Value
    acceleration: Value
    omega: Value
    alpha: Value
    axes: Value
    anchors: Value
    frames: tuple[Frame, ...]


def motion(tree: KinematicTree, q: Value, qd: Value, qdd: Value) -> Moving:
    """Of all bodies and joints, at q, qd, qdd (n, J)."""
    still = np.zeros((1, 3))
    frames = [Frame(np.eye(3)[None], still, still, still, still, still)]
    axes: list[Operand] = [still] * tree.joints
    anchors: list[Operand] = [still] * tree.joints
    for body in range(1, tree.bodies):
        base = frames[tree.parent[body]]
        frame = base.moved(base.position + base.rotation @ tree.position[body])
        frame = replace(frame, rotation=base.rotation @ tree.rotation[body])
        for j in np.flatnonzero(tree.joint_body == body).tolist():
            axes[j] = frame.rotation @ tree.joint_axis[j]
            anchors[j] = frame.position + frame.rotation @ tree.joint_anchor[j]
            travel = q.at([j]) - float(tree.joint_zero[j])
            frame = _after(tree, j, frame, (axes[j], anchors[j]), (travel, qd.at([j]), qdd.at([j])))
        frames.append(frame)
    like = q.at([0, 0, 0])
    parts = ("position", "acceleration", "omega", "alpha")
    own = {name: stacked([getattr(frame, name) for frame in frames[1:]], like, 1) for name in parts}
    flat = stacked([frame.rotation for frame in frames[1:]], q.at([0] * 9).shaped(-1, 3, 3), 1)
    both = {"axes": stacked(axes, like, 1), "anchors": stacked(anchors, like, 1)}
    return Moving(rotation=flat, frames=tuple(frames), **own, **both)


def _after(
    tree: KinematicTree, j: int, frame: Frame, at: tuple[Operand, Operand], go: tuple[Value, Value, Value]
) -> Frame:
    """The frame after a joint with axis and anchor in the world; go: its travel, rate and pull (n, 1)."""
    (z, pivot), (travel, rate, pull) = at, go
    spun = z * rate
    across = cross(frame.omega, spun)
    if tree.joint_slides[j]:
        slid = frame.moved(frame.position + z * travel)
        push = slid.acceleration + z * pull + 2.0 * across
        return replace(slid, velocity=slid.velocity + spun, acceleration=push)
    x, y, w = tree.joint_axis[j]
    K = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    turn = travel.of("Sin") @ K.reshape(1, 9) + (1.0 - travel.of("Cos")) @ (K @ K).reshape(1, 9)
    rotation = frame.rotation @ (turn + np.eye(3).reshape(9)).shaped(-1, 3, 3)
    hinged = replace(
        frame.moved(pivot),
        rotation=rotation,
        omega=frame.omega + spun,
        alpha=frame.alpha + z * pull + across,
    )
    return hinged.moved(pivot - rotation @ tree.joint_anchor[j])
