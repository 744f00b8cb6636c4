"""An identified rigid body in the operators of ONNX: Newton-Euler with each output's own parameters.

The formulas are those of `regressor`, `transmission` and `rigid_body`, of all bodies at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from etude._runtime.operators import Piece, Value, cosine, cross, sine
from etude_arm.memory import MEMORY_RATE
from etude_arm.onnx import followed
from etude_arm.physics.kinematics import BodyMotion, body_motion
from etude_arm.physics.regressor import wrench_maps
from etude_arm.physics.rigid_body import NARROW, RigidBodyModel, drive_terms
from etude_arm.physics.transmission import drive_motion
from etude_arm.spec import FIRST_WAVE, PATH, PLAN, RIPPLES


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
    """(n, J) commands; turned (n, J): friction memory, None: friction by speed."""
    tree, extra = model.tree, model.extra
    motion = body_motion(tree, q, qd, qdd)
    drive = drive_motion(tree, model.drives, motion, qd, qdd)
    terms = drive_terms(drive, model.friction_velocity)
    if turned is not None:
        terms[NARROW] = _turning(model, terms[NARROW], drive.speed, turned)
    command: Value = (forces(model, motion) * drive.inverse(tree.joints)).sum(1) + extra[:, -1]
    for number, term in enumerate(terms):
        command = command + term * extra[:, number]
    if model.ripple is not None:
        for number in range(RIPPLES):
            angle, weights = q * float(number + FIRST_WAVE), model.ripple[:, 2 * number : 2 * number + 2]
            command = command + sine(angle) * weights[:, 0] + cosine(angle) * weights[:, 1]
    return command


def _turning(model: RigidBodyModel, friction: Value, speed: Value, turned: Value) -> Value:
    """Friction; the friction memory replaces it where it depends on distance (`rigid_body.turned`)."""
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
    force, moment = wrench_maps(a, w, al, B, -1)
    push, turn = force @ phi[:, :, :4], moment @ phi[:, :, 1:]
    on_path, hinge = np.zeros((B, 1, J, 1)), (~tree.joint_slides).astype(float)[:, None]
    for body in bodies:
        on_path[body - 1, :, tree.path(body)] = 1.0
    axes, anchors = (part.swapped(1, 0, 2).widened(0) for part in (motion.axis, motion.anchor))
    lever: Value = cross(axes, motion.position.at(bodies, 0).widened(2) - anchors)
    along: Value = (lever * hinge + axes * (1.0 - hinge)) * on_path
    turning: Value = axes * (on_path * hinge)
    contributions: Value = along @ (R @ push) + turning @ (R @ turn)
    return contributions.sum(0)


def _local(v: Value, rotation: Value) -> Value:
    """R' v of vectors (B, n, 3)."""
    return (v.widened(2) @ rotation).sum(2)
