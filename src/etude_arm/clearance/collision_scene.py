"""Surroundings in a model file, as tables of robot.toml that a person can correct."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.clearance.defaults import ALWAYS, OVERLAP_POSES, SEED, STILL
from etude_arm.clearance.distances import Gaps
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.skeleton import STANDING, Skeleton
from etude_arm.clearance.surroundings import ADD_FLOOR, MARGIN, Box, Floor, Surroundings, Wall
from etude_arm.loading.loaded_model import Loaded

if TYPE_CHECKING:
    import mujoco

UPRIGHT = 1e-6
"""By how much the axis of a box may lean, as the sine of an angle."""
DIGITS = 6
"""Of places and sizes in m, since people read them."""


NO_FLOOR = f"No floor is assumed at height 0 m, since {{}}{ADD_FLOOR}"
NOT_THE_PLANE = "The model file's plane at height {:.4g} m is not used as the floor, because {}."
ASSUMED = "A floor is assumed at height 0 m, at the base: correct [floor], or remove it."
OF_PLANE = "The floor is the model file's plane at height {:.4g} m: correct [floor] if it is elsewhere."
BELOW = 0.005
"""m: a base that reaches deeper below a height does not stand on a floor there."""


def level(wall: Wall) -> bool:
    """Whether a plane is a floor: its normal points straight up."""
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    return bool(normal[2] > 0.0 and np.hypot(normal[0], normal[1]) < UPRIGHT)


def with_floor(
    loaded: Loaded, lower: Array, upper: Array, around: Surroundings
) -> tuple[Surroundings, tuple[str, ...]]:
    """The surroundings with a floor, if one is possible, and sentences that name it or give the reason.

    Args:
        loaded: the robot. lower, upper: (k,) limits of its joints, rad (m).
        around: the given surroundings; their own floor stays.
    """
    if around.floor is not None:
        return around, ()
    notes: list[str] = []
    heights = sorted({wall.point[2] for wall in loaded.planes if level(wall)}, reverse=True)
    for height in heights:
        why = _why_not(loaded, lower, upper, around, height)
        if not why:
            return replace(around, floor=Floor(height)), (*notes, OF_PLANE.format(height))
        notes.append(NOT_THE_PLANE.format(height, why))
    if heights:
        return around, (*notes[:-1], f"{notes[-1].removesuffix('.')}{ADD_FLOOR}")
    why = _why_not(loaded, lower, upper, around, 0.0) or _boxes_below(around)
    if why:
        return around, (NO_FLOOR.format(why),)
    return replace(around, floor=Floor(0.0)), (ASSUMED,)


def _why_not(loaded: Loaded, lower: Array, upper: Array, around: Surroundings, height: float) -> str:
    """Reason why the robot does not stand on a floor at `height` m; "" if it does."""
    bare = gaps_of(
        loaded,
        lower,
        upper,
        Surroundings(collision=replace(around.collision, ignore=()), floor=Floor(height)),
    )
    below = height - _lowest(bare.skeleton)
    if below > BELOW:
        return f"the base reaches {below:.3g} m below it"
    sunk = _sunk(bare)
    return f"{', '.join(sunk)} would always be below it" if sunk else ""


def _boxes_below(around: Surroundings) -> str:
    """A sentence if a box reaches below 0; "" otherwise."""
    deep = [box for box in around.box if box.centre[2] - 0.5 * box.size[2] < -BELOW]
    return f"{', '.join(box.name for box in deep)} would reach below it" if deep else ""


def _sunk(bare: Gaps) -> list[str]:
    """Links that a floor would touch in nearly every pose: the arm hangs, or stands on something.

    A foot that turns on the floor keeps its distance and does not count.

    Args:
        bare: gaps of the robot with that floor as its only wall.
    """
    distances = bare.to_walls(bare.skeleton.random_poses(np.random.default_rng(SEED), OVERLAP_POSES))
    held = ((distances < -BELOW).mean(axis=0) > ALWAYS) & (np.ptp(distances, axis=0) > STILL)
    return list(
        dict.fromkeys(gap.names[0] for gap, is_held in zip(bare.walled, held, strict=True) if is_held)
    )


def _lowest(skeleton: Skeleton) -> float:
    """Lowest point of the shapes that no joint moves, m; infinite without such shapes."""
    import mujoco

    data = mujoco.MjData(skeleton.model)
    mujoco.mj_kinematics(skeleton.model, data)
    heights = [
        float(
            (shape.points @ data.geom_xmat[shape.geom].reshape(3, 3)[2]).min() + data.geom_xpos[shape.geom][2]
        )
        - shape.radius
        for shape in skeleton.shapes
        if shape.part == 0
    ]
    return min(heights, default=math.inf)


def from_file(
    loaded: Loaded, lower: Array, upper: Array, around: Surroundings
) -> tuple[Surroundings, tuple[str, ...]]:
    """The surroundings with the file's boxes and walls, and sentences for a person to confirm.

    Args:
        loaded: the robot. lower, upper: (k,) limits of its joints, rad (m).
        around: the given surroundings.
    """
    walls = tuple(wall for wall in loaded.planes if not level(wall))
    boxes, others = _boxes(loaded)
    trial = replace(
        around,
        box=tuple(boxes.values()),
        wall=walls,
        collision=replace(around.collision, boxed=tuple(boxes)),
    )
    held = _touching_objects(gaps_of(loaded, lower, upper, trial)) if boxes or walls else set()
    taken = {shape: box for shape, box in boxes.items() if box.name not in held}
    free = tuple(wall for wall in walls if wall.name not in held)
    collision = replace(around.collision, boxed=tuple(taken))
    complete = replace(
        around, box=(*around.box, *taken.values()), wall=(*around.wall, *free), collision=collision
    )
    parts_of_base = [loaded.beside[shape] for shape in boxes if shape not in taken]
    out = [wall.name for wall in walls if wall.name in held]
    return complete, (
        *_object_sentences(list(taken.values()), free),
        *_base_sentences(parts_of_base, others),
        *_plane_sentences(out),
    )


def _boxes(loaded: Loaded) -> tuple[dict[str, Box], list[str]]:
    """Shapes beside the robot that are upright boxes, and the names of the others."""
    import mujoco

    if not loaded.beside:
        return {}, []
    model = loaded.model()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    boxes: dict[str, Box] = {}
    others: list[str] = []
    for shape, name in loaded.beside.items():
        box = _box(model, data, model.geom(shape).id, name)
        if box is None:
            others.append(name)
        else:
            boxes[shape] = box
    return boxes, others


def _box(model: mujoco.MjModel, data: mujoco.MjData, geom: int, name: str) -> Box | None:
    """A geom as a box with one upright axis, on any side; None for another geom."""
    import mujoco

    turn = data.geom_xmat[geom].reshape(3, 3)
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX:
        return None
    up = int(np.argmax(np.abs(turn[2])))
    if np.hypot(turn[0, up], turn[1, up]) > UPRIGHT:
        return None
    across = [(up + 1) % 3, (up + 2) % 3]
    edges = 2.0 * model.geom_size[geom][[*across, up]]
    yaw = math.atan(turn[1, across[0]] / turn[0, across[0]]) if turn[0, across[0]] else 0.5 * math.pi
    x, y, z, a, b, c = (round(float(value), DIGITS) for value in (*data.geom_xpos[geom], *edges))
    return Box(name, (x, y, z), (a, b, c), round(yaw, DIGITS))


def _touching_objects(gaps: Gaps) -> set[str]:
    """Objects, or boxes as close as these, that touch a link in nearly every pose: its base."""
    distances = gaps.of_poses(gaps.skeleton.random_poses(np.random.default_rng(SEED), OVERLAP_POSES))
    touching = set()
    for gap, column in zip(gaps.list, distances.T, strict=True):
        boxed = gap.other >= 0 and gaps.skeleton.shapes[gap.other].box
        sunk = (column < -BELOW).mean() > ALWAYS and np.ptp(column) > STILL
        if ((column < MARGIN).mean() > ALWAYS) if boxed else (gap.other < 0 and sunk):
            touching.add(gap.names[1].removesuffix(STANDING))
    return touching


def _object_sentences(boxes: Sequence[Box], walls: Sequence[Wall]) -> list[str]:
    parts = [f"box {box.name} ({_numbers(box.size, ' x ')} m at {_numbers(box.centre)})" for box in boxes]
    parts += [f"wall {wall.name} (through {_numbers(wall.point)})" for wall in walls]
    if not parts:
        return []
    return [
        f"Obstacles are taken from the model file: {'; '.join(parts)}. Correct [[box]] and [[wall]] of "
        "robot.toml."
    ]


def _base_sentences(on: Sequence[str], others: Sequence[str]) -> list[str]:
    """Sentences on objects in the file's world that no table of a robot file describes."""
    if not on and not others:
        return []
    parts = [f"{name}, below the arm" for name in on]
    parts += [f"{name}, not an upright box" for name in others]
    return [
        f"These obstacles of the model file are treated as parts of the base: {'; '.join(parts)}. Motions "
        "keep clear of them, except the links next to the base."
    ]


def _plane_sentences(walls: Sequence[str]) -> list[str]:
    if not walls:
        return []
    return [
        f"Planes of the model file that would contain the arm in every pose are ignored: {', '.join(walls)}."
    ]


def _numbers(values: Sequence[float], between: str = ", ") -> str:
    return between.join(f"{value:.4g}" for value in values)
