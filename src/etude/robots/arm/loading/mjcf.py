"""An MJCF, compiled by MuJoCo as it is and written anew with the chosen joints alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import UsageError
from etude.robots.arm.loading.choice import Choice, Moving, choose
from etude.robots.arm.loading.loaded import Loaded, refused
from etude.robots.arm.loading.mjcf_writer import written

if TYPE_CHECKING:
    import mujoco

HINGE, SLIDE = 3, 2  # mjtJoint
JOINT_EQUALITY = 2  # mjtEq


def load_mjcf(
    path: Path, wanted: Sequence[str] | None, given: Mapping[str, float], drives: bool = False
) -> Loaded:
    """`load.load` of an MJCF."""
    model, missing = compiled(path)
    choice = chosen_in(model, wanted, given, str(path))
    new = written(model, choice, drives)
    loose = "".join(f" although '{name}' leaves it free" for name in _floating(model))
    lost = [f"the shape of {what}: its mesh is missing" for what in missing]
    unseen = (f"the base is taken to be fixed{loose}", *choice.unseen, *lost, *new.unseen)
    notes = (*choice.notes, *new.notes)
    return Loaded(new.xml, new.assets, choice.joints, choice.held, notes, unseen, new.excluded, str(path))


def chosen_in(
    model: mujoco.MjModel, wanted: Sequence[str] | None, given: Mapping[str, float], where: str
) -> Choice:
    """The choice of joints in an MJCF; a base that the file leaves free is fixed only if joints are named."""
    floating = _floating(model)
    if floating and wanted is None:
        raise UsageError(
            f"the base is not fixed: joint '{floating[0]}' is free or a ball joint",
            where=where,
            next_step="Only hinge and slide joints on a fixed base have an inverse dynamics here. If the "
            "base stands still, choose the arm with --joints.",
        )
    return choose(moving(model), wanted, given, where)


def _floating(model: mujoco.MjModel) -> list[str]:
    return [model.joint(j).name for j in range(model.njnt) if model.jnt_type[j] not in (HINGE, SLIDE)]


def compiled(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """The model of an MJCF file as MuJoCo has it, and the bodies that lack a mesh.

    Raises:
        UsageError: MuJoCo cannot load it.
    """
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        missing = _without_pictures(spec, path)
        return spec.compile(), missing
    except ValueError as problem:
        raise refused(problem, str(path)) from None


def _without_pictures(spec: Any, path: Path) -> list[str]:
    """Deletes what would have to be loaded from files but has no mass or shape; names what lacks its mesh."""
    for material in list(spec.materials):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    gone = {m.name or Path(m.file).stem: m for m in spec.meshes if m.file and not _there(spec, path, m.file)}
    lost = [geom for geom in spec.geoms if geom.meshname in gone or geom.hfieldname]
    bodies = list(dict.fromkeys(f"body '{geom.parent.name}'" for geom in lost))
    for item in [*lost, *gone.values(), *spec.hfields]:
        spec.delete(item)
    return bodies


def _there(spec: Any, path: Path, name: str) -> bool:
    return (path.parent / str(spec.meshdir) / name).is_file()


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
                found.append(Moving(name, carrier, float(lower), float(upper), slides, endless, *follows))
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
