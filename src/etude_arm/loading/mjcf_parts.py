"""The parts of a compiled MJCF that move as one, and the shapes that count of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import chain, count
from typing import TYPE_CHECKING

from etude_arm.loading.choice import Choice
from etude_arm.loading.names import free_name

if TYPE_CHECKING:
    import mujoco

SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}  # mjtGeom
PLANE, MESH = 0, 7
BESIDE = -1
"""A part of its own: bodies that hang on the world apart from the robot."""


def shapes_of_bodies(
    model: mujoco.MjModel, choice: Choice, unseen: list[str]
) -> tuple[dict[int, list[int]], tuple[str, ...]]:
    """Geoms to keep by body: those that collide; of a part without any, all. Of bodies beside the robot only
    those that collide, but where nothing in the file does.
    """
    parts: dict[int, list[int]] = {}
    roots = {0, *(int(model.body_rootid[model.jnt_bodyid[model.joint(j).id]]) for j in choice.joints)}
    for b in range(model.nbody):
        part = part_of(model, choice, b) if int(model.body_rootid[b]) in roots else BESIDE
        parts.setdefault(part, []).append(b)
    some = bool(model.geom_contype.any())
    kept: dict[int, list[int]] = {}
    drawn, notes = [], []
    for part, bodies in parts.items():
        geoms = [g for b in bodies for g in geoms_of(model, b) if int(model.geom_type[g]) in SHAPES]
        solid = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        for g in solid if part == BESIDE and some else solid or geoms:
            kept.setdefault(int(model.geom_bodyid[g]), []).append(g)
        if part == BESIDE and some:
            notes += _only_drawn(model, geoms, solid)
        if part > 0 and geoms and not solid:
            drawn.append(name_of(model, part))
        if part > 0 and not geoms:
            unseen.append(f"the shape of body '{name_of(model, part)}': the file has none")
        moving = [b for b in bodies if model.body_weldid[b]]  # what never moves is the room's: mjcf_beside
        if any(int(model.geom_type[g]) == PLANE for b in moving for g in geoms_of(model, b)):
            notes.append(f"A plane that body '{name_of(model, part)}' carries is left out: it has no end.")
    if drawn and some:  # a file in which nothing collides means nothing by it
        notes.append(f"What is drawn of {', '.join(drawn)} is taken as shape: nothing of it collides.")
    return kept, tuple(notes)


def _only_drawn(model: mujoco.MjModel, geoms: Sequence[int], solid: Sequence[int]) -> list[str]:
    """A sentence for bodies beside the robot of which nothing collides: marks, and targets to reach."""
    own, hard = ([int(model.geom_bodyid[g]) for g in some] for some in (geoms, solid))
    names = dict.fromkeys(name_of(model, b) for b in own if b not in hard)
    return [f"What is only drawn beside the robot is left out: {', '.join(names)}."] if names else []


def part_of(model: mujoco.MjModel, choice: Choice, b: int) -> int:
    """The first body of what moves as one with body b."""
    while b and not any(model.joint(j).name in choice.joints for j in joints_of(model, b)):
        b = int(model.body_parentid[b])
    return b


def joints_of(model: mujoco.MjModel, b: int) -> range:
    return range(int(model.body_jntadr[b]), int(model.body_jntadr[b]) + int(model.body_jntnum[b]))


def geoms_of(model: mujoco.MjModel, b: int) -> range:
    return range(int(model.body_geomadr[b]), int(model.body_geomadr[b]) + int(model.body_geomnum[b]))


def name_of(model: mujoco.MjModel, b: int) -> str:
    """Of a body; one that has none is called after its number."""
    name = str(model.body(b).name)
    return name or free_name(f"body{b}", {model.body(k).name for k in range(model.nbody)})


def numbered(name: str, taken: Collection[str], between: str = "") -> str:
    """The name, with a number from 2 on if it is taken."""
    more = (f"{name}{between}{k}" for k in count(2))
    return next(one for one in chain((name,), more) if one not in taken)
