"""MJCF compilation without textures and missing assets, with a name for every joint."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import UsageError
from etude_arm.loading.joint_choice import Choice, Moving
from etude_arm.loading.loaded_model import refused
from etude_arm.loading.parsing import free_name

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Compiled:
    """The compiled model, and notes on its file.

    Attributes:
        model: of the whole file.
        shapeless: bodies that lack a mesh, as "body 'name'".
        notes: a sentence on missing meshes, and one on joints that were given a name.
    """

    model: mujoco.MjModel
    shapeless: tuple[str, ...]
    notes: tuple[str, ...]


def compiled(path: Path) -> Compiled:
    """The model of an MJCF file.

    Raises:
        UsageError: MuJoCo cannot load it.
    """
    import mujoco

    missing: list[str] = []
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        shapeless, missing = _without_pictures(spec, path)
        named = name_joints(spec)
        notes = [_missing(missing)] if missing else []
        notes += (
            [f"Joints without a name are called after their bodies: {', '.join(named)}."] if named else []
        )
        return Compiled(spec.compile(), tuple(shapeless), tuple(notes))
    except ValueError as problem:
        error = refused(problem, str(path))
        if not missing:
            raise error from None
        raise UsageError(error.fact, where=str(path), next_step=_missing(missing)) from None


def _missing(files: list[str]) -> str:
    few = f"{', '.join(files[:5])}{' and others' if len(files) > 5 else ''}"
    return f"Meshes are missing: {few}. They belong in the folder that the file states as meshdir."


def _without_pictures(spec: Any, path: Path) -> tuple[list[str], list[str]]:
    """Deletes elements that need other files but have no mass or shape.

    Returns the bodies that lack their mesh, and the files that are missing.
    """
    for material in list(spec.materials):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    missing = {
        m.name or Path(m.file).stem: m for m in spec.meshes if m.file and not _there(spec, path, m.file)
    }
    files = [str(mesh.file) for mesh in missing.values()]
    lost = [geom for geom in spec.geoms if geom.meshname in missing or geom.hfieldname]
    bodies = list(dict.fromkeys(f"body '{geom.parent.name}'" for geom in lost))
    for item in [*lost, *missing.values(), *spec.hfields]:
        spec.delete(item)
    return bodies, files


def _there(spec: Any, path: Path, name: str) -> bool:
    return (path.parent / str(spec.meshdir) / name).is_file()


def name_joints(spec: Any) -> list[str]:
    """Gives joints without a name one after their body, the same in every run; those of hinges and slides."""
    taken, names = {joint.name for joint in spec.joints}, []
    for joint in spec.joints:
        if not joint.name:
            joint.name = numbered(f"{joint.parent.name or 'body'}_joint", taken)
            taken.add(joint.name)
            names += [joint.name] if int(joint.type) in (SLIDE, HINGE) else []
    return names


FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
JOINT_EQUALITY = 2  # mjtEq


def moving(model: mujoco.MjModel) -> tuple[Moving, ...]:
    """Every hinge and slide of a model, from the base outwards; equalities of joints make followers."""
    leaders = _leaders(model)
    before: dict[int, str] = {0: ""}
    joints = []
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
                joint = Moving(name, carrier, float(lower), float(upper), slides, endless, *follows)
                joints.append(replace(joint, carries=model.body(body).name))
                carrier = name
        before[body] = carrier
    return tuple(joints)


def _leaders(model: mujoco.MjModel) -> dict[str, tuple[str, float, float]]:
    """Follower -> leader, factor and offset, of active equalities between two joints."""
    leaders = {}
    for k in range(model.neq):
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if model.eq_type[k] == JOINT_EQUALITY and second >= 0 and model.eq_active0[k]:
            offset, factor = (float(x) for x in model.eq_data[k, :2])
            zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second)]
            leader = model.joint(second).name
            leaders[model.joint(first).name] = (leader, factor, offset + zero[0] - factor * zero[1])
    return leaders


SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}  # mjtGeom
PLANE, MESH = 0, 7  # MuJoCo's numbers of geom types (mjtGeom)
BESIDE = -1
"""An object beside the robot: bodies of the world that are not part of the arm."""


def shapes_of_bodies(
    model: mujoco.MjModel, choice: Choice, unverified: list[str]
) -> tuple[dict[int, list[int]], tuple[str, ...]]:
    """Geoms to keep by body: collision geoms, or all geoms of a part without any. Of bodies beside the robot
    only collision geoms, unless the file has none.
    """
    parts: dict[int, list[int]] = {}
    roots = {0, *(int(model.body_rootid[model.jnt_bodyid[model.joint(j).id]]) for j in choice.joints)}
    for b in range(model.nbody):
        part = part_of(model, choice, b) if int(model.body_rootid[b]) in roots else BESIDE
        parts.setdefault(part, []).append(b)
    some = bool(model.geom_contype.any())
    chosen: dict[int, list[int]] = {}
    drawn, notes = [], []
    for part, bodies in parts.items():
        geoms = [g for b in bodies for g in geoms_of(model, b) if int(model.geom_type[g]) in SHAPES]
        solid = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        for g in solid if part == BESIDE and some else solid or geoms:
            chosen.setdefault(int(model.geom_bodyid[g]), []).append(g)
        if part == BESIDE and some:
            notes += _only_drawn(model, geoms, solid)
        if part > 0 and geoms and not solid:
            drawn.append(name_of(model, part))
        if part > 0 and not geoms:
            unverified.append(f"the shape of body '{name_of(model, part)}': the file has none")
        moving = [b for b in bodies if model.body_weldid[b]]  # fixed bodies: see mjcf_beside
        if any(int(model.geom_type[g]) == PLANE for b in moving for g in geoms_of(model, b)):
            notes.append(
                f"A plane that body '{name_of(model, part)}' carries is ignored, because it is infinite."
            )
    if drawn and some:  # a file without collision geoms does not exclude collisions on purpose
        notes.append(
            f"The visual geometry of {', '.join(drawn)} is used as shape, because they have no "
            "collision geometry."
        )
    return chosen, tuple(notes)


def _only_drawn(model: mujoco.MjModel, geoms: Sequence[int], solid: Sequence[int]) -> list[str]:
    """A sentence on bodies beside the robot without collision geoms, such as marks and targets."""
    bodies, hard = ([int(model.geom_bodyid[g]) for g in some] for some in (geoms, solid))
    names = dict.fromkeys(name_of(model, b) for b in bodies if b not in hard)
    return [f"Visual geometry outside the robot is ignored: {', '.join(names)}."] if names else []


def part_of(model: mujoco.MjModel, choice: Choice, b: int) -> int:
    """The first body of the rigid part that contains body b."""
    while b and not any(model.joint(j).name in choice.joints for j in joints_of(model, b)):
        b = int(model.body_parentid[b])
    return b


def joints_of(model: mujoco.MjModel, b: int) -> range:
    return range(int(model.body_jntadr[b]), int(model.body_jntadr[b]) + int(model.body_jntnum[b]))


def geoms_of(model: mujoco.MjModel, b: int) -> range:
    return range(int(model.body_geomadr[b]), int(model.body_geomadr[b]) + int(model.body_geomnum[b]))


def name_of(model: mujoco.MjModel, b: int) -> str:
    """The name of a body; its number if it has no name."""
    name = str(model.body(b).name)
    return name or free_name(f"body{b}", {model.body(k).name for k in range(model.nbody)})


def numbered(name: str, taken: Collection[str], between: str = "") -> str:
    """The name, with a number from 2 on if it is taken."""
    more = (f"{name}{between}{k}" for k in count(2))
    return next(one for one in chain((name,), more) if one not in taken)
