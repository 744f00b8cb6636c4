"""The parts of a compiled MJCF that move as one, and the shapes that count of each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from etude.robots.arm.loading.choice import Choice

if TYPE_CHECKING:
    import mujoco

SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}  # mjtGeom
PLANE = 0


def shapes_of_bodies(
    model: mujoco.MjModel, choice: Choice, unseen: list[str]
) -> tuple[dict[int, list[int]], tuple[str, ...]]:
    """Geoms to keep by body: those that collide; of a part without any, all."""
    parts: dict[int, list[int]] = {}
    for b in range(model.nbody):
        parts.setdefault(part_of(model, choice, b), []).append(b)
    kept: dict[int, list[int]] = {}
    drawn, notes = [], []
    for part, bodies in parts.items():
        geoms = [g for b in bodies for g in geoms_of(model, b) if int(model.geom_type[g]) in SHAPES]
        solid = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        for g in solid or geoms:
            kept.setdefault(int(model.geom_bodyid[g]), []).append(g)
        if part and geoms and not solid:
            drawn.append(name_of(model, part))
        if part and not geoms:
            unseen.append(f"the shape of body '{name_of(model, part)}': the file has none")
        moving = [b for b in bodies if model.body_weldid[b]]  # what never moves is the room's: mjcf_beside
        if any(int(model.geom_type[g]) == PLANE for b in moving for g in geoms_of(model, b)):
            notes.append(f"A plane that body '{name_of(model, part)}' carries is left out: it has no end.")
    if drawn and model.geom_contype.any():  # a file in which nothing collides means nothing by it
        notes.append(f"What is drawn of {', '.join(drawn)} is taken as shape: nothing of it collides.")
    return kept, tuple(notes)


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
    return model.body(b).name or f"body{b}"
