"""The moving joints of a compiled MJCF."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from etude_arm.loading.limbs import Moving

if TYPE_CHECKING:
    import mujoco

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
JOINT_EQUALITY = 2  # mjtEq


def moving(model: mujoco.MjModel) -> tuple[Moving, ...]:
    """Every hinge and slide of a model, from the base outwards; equalities of joints make followers."""
    leaders = _leaders(model)
    before: dict[int, str] = {0: ""}
    found = []
    for body in range(1, model.nbody):
        carrier = before[int(model.body_parentid[body])]
        first = int(model.body_jntadr[body])
        for j in range(first, first + int(model.body_jntnum[body])):
            if model.jnt_type[j] in (HINGE, SLIDE):
                name = model.joint(j).name
                lower, upper = model.jnt_range[j] if model.jnt_limited[j] else (-math.inf, math.inf)
                slides = bool(model.jnt_type[j] == SLIDE)
                follows = leaders.get(name, ("", 1.0, 0.0))
                endless = not slides and not model.jnt_limited[j]
                own = Moving(name, carrier, float(lower), float(upper), slides, endless, *follows)
                found.append(replace(own, carries=model.body(body).name))
                carrier = name
        before[body] = carrier
    return tuple(found)


def _leaders(model: mujoco.MjModel) -> dict[str, tuple[str, float, float]]:
    """Follower -> leader, factor and offset, of active equalities between two joints."""
    found = {}
    for k in range(model.neq):
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if model.eq_type[k] == JOINT_EQUALITY and second >= 0 and model.eq_active0[k]:
            offset, factor = (float(x) for x in model.eq_data[k, :2])
            zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second)]
            leader = model.joint(second).name
            found[model.joint(first).name] = (leader, factor, offset + zero[0] - factor * zero[1])
    return found
