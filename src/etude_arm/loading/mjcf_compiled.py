"""An MJCF as MuJoCo compiles it: without pictures, without what is missing, every joint with a name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import UsageError
from etude_arm.loading.loaded import refused
from etude_arm.loading.mjcf_joints import HINGE, SLIDE
from etude_arm.loading.mjcf_parts import numbered

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Compiled:
    """The model, and what became of the file.

    Attributes:
        model: of the whole file.
        shapeless: bodies that lack a mesh, as "body 'name'".
        notes: a sentence for meshes that are missing, and one for joints that got a name here.
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

    gone: list[str] = []
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        shapeless, gone = _without_pictures(spec, path)
        named = name_joints(spec)
        notes = [_missing(gone)] if gone else []
        notes += (
            [f"Joints without a name are called after their bodies: {', '.join(named)}."] if named else []
        )
        return Compiled(spec.compile(), tuple(shapeless), tuple(notes))
    except ValueError as problem:
        error = refused(problem, str(path))
        if not gone:
            raise error from None
        raise UsageError(error.fact, where=str(path), next_step=_missing(gone)) from None


def _missing(gone: list[str]) -> str:
    few = f"{', '.join(gone[:5])}{' and others' if len(gone) > 5 else ''}"
    return f"Meshes are missing: {few}. They belong where the file's meshdir says."


def _without_pictures(spec: Any, path: Path) -> tuple[list[str], list[str]]:
    """Deletes what would have to be loaded from files but has no mass or shape.

    Returns the bodies that lack their mesh, and the files that are missing.
    """
    for material in list(spec.materials):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    gone = {m.name or Path(m.file).stem: m for m in spec.meshes if m.file and not _there(spec, path, m.file)}
    files = [str(mesh.file) for mesh in gone.values()]
    lost = [geom for geom in spec.geoms if geom.meshname in gone or geom.hfieldname]
    bodies = list(dict.fromkeys(f"body '{geom.parent.name}'" for geom in lost))
    for item in [*lost, *gone.values(), *spec.hfields]:
        spec.delete(item)
    return bodies, files


def _there(spec: Any, path: Path, name: str) -> bool:
    return (path.parent / str(spec.meshdir) / name).is_file()


def name_joints(spec: Any) -> list[str]:
    """Gives joints without a name one after their body, the same in every run; those of hinges and slides."""
    taken, given = {joint.name for joint in spec.joints}, []
    for joint in spec.joints:
        if not joint.name:
            joint.name = numbered(f"{joint.parent.name or 'body'}_joint", taken)
            taken.add(joint.name)
            given += [joint.name] if int(joint.type) in (SLIDE, HINGE) else []
    return given
