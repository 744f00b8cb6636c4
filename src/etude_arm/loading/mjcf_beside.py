"""What an MJCF's world holds beside the robot: planes, and shapes of bodies that carry none of its joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from etude_arm.clearance.surroundings import Wall
from etude_arm.loading.choice import Choice
from etude_arm.loading.mjcf_parts import PLANE, name_of, numbered

if TYPE_CHECKING:
    import mujoco

DIGITS = 6
"""Of places in m, and of directions."""


def planes_of(model: mujoco.MjModel) -> tuple[Wall, ...]:
    """The planes of what never moves, in the frame of the file, named after their geoms."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: list[Wall] = []
    for g in range(model.ngeom):
        if int(model.geom_type[g]) == PLANE and not model.body_weldid[model.geom_bodyid[g]]:
            name = numbered(model.geom(g).name or "plane", [wall.name for wall in found], " ")
            # people read them, and -0.0 is none of their business
            at, normal = (v.round(DIGITS) + 0.0 for v in (data.geom_xpos[g], data.geom_xmat[g][2::3]))
            found.append(Wall(name, tuple(at.tolist()), tuple(normal.tolist())))
    return tuple(found)


def beside(model: mujoco.MjModel, choice: Choice, shapes: Mapping[str, int]) -> dict[str, str]:
    """Shape -> a name for it, of bodies that hang on the world apart from the robot.

    Args:
        model: of the file. choice: of joints.
        shapes: geoms of the model by the names that they were given, "body#k".
    """
    roots = {int(model.body_rootid[model.jnt_bodyid[model.joint(name).id]]) for name in choice.joints}
    found: dict[str, str] = {}
    for shape, g in shapes.items():
        b = int(model.geom_bodyid[g])
        if int(model.body_rootid[b]) not in roots:
            own = model.geom(g).name or (name_of(model, b) if b else "box")
            # a name with # would be one of a link's shapes
            found[shape] = numbered(own.replace("#", " "), found.values(), " ")
    return found
