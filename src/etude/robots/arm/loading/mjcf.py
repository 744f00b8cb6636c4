"""An MJCF, compiled by MuJoCo as it is and written anew with the chosen joints alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import UsageError
from etude.robots.arm.loading.attached import Additions
from etude.robots.arm.loading.choice import Choice, choose
from etude.robots.arm.loading.loaded import Loaded, refused
from etude.robots.arm.loading.mjcf_joints import HINGE, SLIDE, moving
from etude.robots.arm.loading.mjcf_writer import written

if TYPE_CHECKING:
    import mujoco


def load_mjcf(
    path: Path, wanted: Sequence[str] | None, given: Mapping[str, float], drives: bool, added: Additions
) -> Loaded:
    """`load.load` of an MJCF."""
    model, missing = compiled(path)
    choice = chosen_in(model, wanted, given, str(path))
    new = written(model, choice, drives, added)
    loose = "".join(f" although '{name}' leaves it free" for name in _floating(model))
    lost = [f"the shape of {what}: its mesh is missing" for what in missing]
    unseen = (f"the base is taken to be fixed{loose}", *choice.unseen, *lost, *new.unseen, *added.unseen())
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
