"""Where the floor is: the model file's own plane, or height 0 where the base can stand there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from etude.types import Array
from etude_arm.clearance.gaps import Gaps
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.settled import ALWAYS, FEW, SEED, STILL
from etude_arm.clearance.skeleton import Skeleton
from etude_arm.clearance.surroundings import ADD_FLOOR, Floor, Surroundings, Wall
from etude_arm.loading.loaded import Loaded

NO_FLOOR = f"No floor is assumed at height 0 m, since {{}}{ADD_FLOOR}"
NOT_THE_PLANE = "The model file's plane at height {:.4g} m is not taken as the floor, since {}."
ASSUMED = "A floor is assumed at height 0 m, where the base stands: correct [floor], or take it out."
OF_PLANE = "The floor is the model file's plane at height {:.4g} m: correct [floor] if it is elsewhere."
BELOW = 0.005
"""m: a base that reaches deeper below a height does not stand on a floor there."""
UPRIGHT = 1e-6
"""By how much the normal of a floor may lean, as the sine of an angle."""


def level(wall: Wall) -> bool:
    """Whether a plane is a floor: it looks straight up."""
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    return bool(normal[2] > 0.0 and np.hypot(normal[0], normal[1]) < UPRIGHT)


def with_floor(
    loaded: Loaded, lower: Array, upper: Array, around: Surroundings
) -> tuple[Surroundings, tuple[str, ...]]:
    """The surroundings with a floor, if there can be one, and sentences that say which, or why none.

    Args:
        loaded: the robot. lower, upper: (k,) its limits.
        around: what is given, whose own floor stays.
    """
    if around.floor is not None:
        return around, ()
    said: list[str] = []
    heights = sorted({wall.point[2] for wall in loaded.planes if level(wall)}, reverse=True)
    for height in heights:
        why = _why_not(loaded, lower, upper, around, height)
        if not why:
            return replace(around, floor=Floor(height)), (*said, OF_PLANE.format(height))
        said.append(NOT_THE_PLANE.format(height, why))
    if heights:
        return around, (*said[:-1], f"{said[-1].removesuffix('.')}{ADD_FLOOR}")
    why = _why_not(loaded, lower, upper, around, 0.0) or _boxes_below(around)
    if why:
        return around, (NO_FLOOR.format(why),)
    return replace(around, floor=Floor(0.0)), (ASSUMED,)


def _why_not(loaded: Loaded, lower: Array, upper: Array, around: Surroundings, height: float) -> str:
    """Why the robot does not stand on a floor at that height; "" if it does."""
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
    return f"{', '.join(sunk)} would always be in it" if sunk else ""


def _boxes_below(around: Surroundings) -> str:
    """Of boxes that stand on something lower than 0."""
    deep = [box for box in around.box if box.centre[2] - 0.5 * box.size[2] < -BELOW]
    return f"{', '.join(box.name for box in deep)} would reach below it" if deep else ""


def _sunk(bare: Gaps) -> list[str]:
    """Links that a floor would hold in nearly every pose: the arm hangs, or stands on something.

    A foot that turns on the floor, and so keeps its distance, is none of them.

    Args:
        bare: the robot's, with that floor as its only wall.
    """
    distances = bare.to_walls(bare.skeleton.random_poses(np.random.default_rng(SEED), FEW))
    held = ((distances < -BELOW).mean(axis=0) > ALWAYS) & (np.ptp(distances, axis=0) > STILL)
    return list(
        dict.fromkeys(gap.names[0] for gap, is_held in zip(bare.walled, held, strict=True) if is_held)
    )


def _lowest(skeleton: Skeleton) -> float:
    """m, of the shapes that no joint moves; infinite if there are none."""
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
