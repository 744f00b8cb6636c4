"""An identified rigid body in the operators of ONNX: Newton-Euler with each output's own parameters.

The same steps as `regressor` and `rigid_body`, of all bodies at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from etude._runtime.operators import Piece, Value, cross
from etude.types import Array
from etude_arm.inputs import FRICTION_SCALES
from etude_arm.memory import MEMORY_RATE
from etude_arm.onnx import followed
from etude_arm.physics.drive_graph import drives_of
from etude_arm.physics.kinematics import BodyMotion, body_motion
from etude_arm.physics.rigid_body import RigidBodyModel
from etude_arm.spec import PATH, PLAN

SKEW = np.zeros((3, 9))
"""v @ SKEW, as (3, 3), times w is v x w."""
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    SKEW[_k, 3 * _i + _j], SKEW[_j, 3 * _i + _k] = -1.0, 1.0
INERTIA = np.zeros((3, 18))
"""w @ INERTIA, as (3, 6), times [xx yy zz xy xz yz] is I w."""
for _row, _places in enumerate(((0, 3, 4), (3, 1, 5), (4, 5, 2))):
    for _part, _place in enumerate(_places):
        INERTIA[_part, 6 * _row + _place] = 1.0


def rigid_body_piece(mean: Any) -> Piece:
    """A `RigidBodyMean`; memory of each joint: friction, the position before, begun."""
    model: RigidBodyModel = mean.model
    reads = PLAN if mean.desired else PATH
    remembers = bool(model.way.any())
    length = np.where(model.way > 0.0, mean.spec.presliding(1.0) * model.way, 1.0)

    def draw(states: Mapping[str, Value], memory: Value | None) -> tuple[Value, Value | None]:
        q, qd, qdd = (states[name] for name in reads)
        turned, after = None, None
        if remembers and memory is not None:
            turned, after = followed(q, memory, np.zeros(len(length)), length)
        return commands(model, q, qd, qdd, turned), after

    return Piece(reads, draw, 2 * len(length) + 1 if remembers else 0, MEMORY_RATE if remembers else 0.0)


def commands(model: RigidBodyModel, q: Value, qd: Value, qdd: Value, turned: Value | None) -> Value:
    """(n, J); turned (n, J): what the narrowest friction remembers, None: it turns with speed."""
    tree, extra = model.tree, model.extra
    motion = body_motion(tree, q, qd, qdd)
    drive = drives_of(tree, model.drives, motion, qd, qdd)
    found = drive.acceleration * extra[:, 0] + drive.speed * extra[:, 1] + extra[:, -1]
    threshold = abs(drive.moment) @ model.friction_velocity
    for number, scale in enumerate(FRICTION_SCALES):
        friction = (drive.speed / (scale * threshold)).of("Tanh")
        if not number and turned is not None:
            friction = _turning(model, friction, drive.speed, turned)
        found = found + friction * extra[:, 2 + number]
    rigid: Value = (forces(model, motion) * drive.inverse).sum(1)
    return found + rigid


def _turning(model: RigidBodyModel, friction: Value, speed: Value, turned: Value) -> Value:
    """Friction, what is remembered in its place where it turns round over a way (`rigid_body.turned`)."""
    pairs = list(enumerate(model.drives))
    side = np.array([drive.side(j) * (model.way[j] > 0.0) for j, drive in pairs])
    resting = np.array([drive.resting(j, float(model.friction_velocity[j])) for j, drive in pairs])
    slow = (-(abs(speed) / np.where(side != 0.0, resting, 1.0))).of("Exp")
    by_way: Value = turned * side * (1.0 - slow)
    by_speed: Value = friction * (side == 0.0).astype(float)
    return by_speed + by_way


def forces(model: RigidBodyModel, motion: BodyMotion) -> Value:
    """(n, J, J): in each joint's coordinate, by the parameters of each output."""
    tree, bodies = model.tree, range(1, model.tree.bodies)
    B, J = len(bodies), tree.joints
    R = motion.rotation.at(bodies, 0)
    phi = model.inertial.reshape(J, B, 1, 10).transpose(1, 2, 3, 0)
    a = _local(motion.acceleration.at(bodies, 0) - tree.gravity, R)
    w, al = _local(motion.omega.at(bodies, 0), R), _local(motion.alpha.at(bodies, 0), R)
    skew, spin = _map(w, SKEW, B, 3), _map(al, INERTIA, B, 6) + _map(w, SKEW, B, 3) @ _map(w, INERTIA, B, 6)
    push = a.widened(3) * phi[:, :, :1] + (_map(al, SKEW, B, 3) + skew @ skew) @ phi[:, :, 1:4]
    turn = spin @ phi[:, :, 4:] - _map(a, SKEW, B, 3) @ phi[:, :, 1:4]
    on_path, hinge = np.zeros((B, 1, J, 1)), (~tree.joint_slides).astype(float)[:, None]
    for body in bodies:
        on_path[body - 1, :, tree.path(body)] = 1.0
    axes, anchors = (part.swapped(1, 0, 2).widened(0) for part in (motion.axis, motion.anchor))
    lever: Value = cross(axes, motion.position.at(bodies, 0).widened(2) - anchors)
    along: Value = (lever * hinge + axes * (1.0 - hinge)) * on_path
    turning: Value = axes * (on_path * hinge)
    found: Value = along @ (R @ push) + turning @ (R @ turn)
    return found.sum(0)


def _local(v: Value, rotation: Value) -> Value:
    """R' v of vectors (B, n, 3)."""
    return (v.widened(2) @ rotation).sum(2)


def _map(v: Value, table: Array, bodies: int, width: int) -> Value:
    """(B, n, 3, width) matrices that are linear in v (B, n, 3)."""
    return (v @ table).shaped(bodies, -1, 3, width)
