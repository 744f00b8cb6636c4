"""A robot of joints as sticks from joint to joint, by forward kinematics of its model file."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Figure
from etude_arm.drawn import carried_things, standing_things
from etude_arm.loading.load import load_arm
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.kinematics import body_motion
from etude_arm.rehearsal.body import tips
from etude_arm.spec import ArmSpec


def figure(spec: ArmSpec, q: Array) -> Figure:
    """Points: the base, the joints in the robot's order, then the tips of what carries no joint.

    Around it what the robot file says of the room, and what the arm carries.

    Raises:
        UsageError: the model file cannot be loaded.
    """
    geometry = read_geometry(spec)
    assert geometry is not None
    tree, still = geometry.tree, np.zeros_like(q)
    motion = body_motion(tree, q, still, still)
    bodies, carried_by = tree.joint_body.tolist(), tree.parent.tolist()
    before = [_joint_before(j, bodies, carried_by) for j in range(spec.dof)]
    last = sorted(set(range(spec.dof)) - set(before))
    loaded = load_arm(spec, shapes=False)
    reaches = tips(loaded, [spec.names[j] for j in last])
    hands = [
        motion.position[bodies[j]] + motion.rotation[bodies[j]] @ reach
        for j, reach in zip(last, reaches, strict=True)
    ]
    base = np.zeros(3) if spec.mounting is None else np.array(spec.mounting.position)
    points = np.stack([np.tile(base, (len(q), 1)), *motion.anchor, *hands], axis=1)
    ends = range(spec.dof + 1, spec.dof + 1 + len(hands))
    sticks = [(before[j] + 1, j + 1) for j in range(spec.dof)]
    sticks += [(j + 1, end) for j, end in zip(last, ends, strict=True)]
    things = (*standing_things(spec.around, spec.mounting), *carried_things(spec, loaded, q))
    return Figure(points, np.array(sticks), tuple(ends), things)


def _joint_before(j: int, bodies: list[int], carried_by: list[int]) -> int:
    """The joint that carries joint j; -1: the base."""
    same = [i for i in range(j) if bodies[i] == bodies[j]]
    if same:
        return same[-1]
    body = carried_by[bodies[j]]
    while body > 0:
        own = [i for i, other in enumerate(bodies) if other == body]
        if own:
            return own[-1]
        body = carried_by[body]
    return -1
