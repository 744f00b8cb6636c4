"""Rigid-body models from URDF or MJCF files, without their meshes, joints matched by name.

Only masses, joints and limits are of use here, so visuals, collision shapes and meshes are left aside: a file
loads although its `package://` meshes are elsewhere.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING, Any

from etude.errors import UsageError
from etude.robots.arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco


def load_mujoco_model(spec: ArmSpec) -> mujoco.MjModel:
    """The MuJoCo model of the robot's `model_file`, without meshes and contacts.

    Raises:
        UsageError: no model file, unreadable, a joint of the robot is missing in it, or its base floats.
    """
    if spec.model_file is None:
        raise UsageError(
            f"robot '{spec.name}' has no model_file",
            next_step="Add a URDF or MJCF, or choose a model without one.",
        )
    model = compile_model(spec.model_file)
    joint_rows(model, spec)
    return model


def joint_rows(model: mujoco.MjModel, spec: ArmSpec) -> tuple[list[int], list[int]]:
    """(addresses in qpos, addresses in qvel) of the robot's axes; other joints of the model are not named."""
    import mujoco

    names = {model.joint(i).name: i for i in range(model.njnt)}
    missing = [name for name in spec.names if name not in names]
    where = str(spec.model_file)
    if missing:
        raise UsageError(
            f"the model has no joint {', '.join(missing)}",
            where=where,
            next_step=f"Its joints are {', '.join(names)}: use these names in the robot file.",
        )
    for name, i in names.items():
        if mujoco.mjtJoint(model.jnt_type[i]) in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            raise UsageError(
                f"joint '{name}' of the model is free or a ball joint",
                where=where,
                next_step="Fix the base: only hinge and slide joints have an inverse dynamics here.",
            )
    rows = [names[name] for name in spec.names]
    return [int(model.jnt_qposadr[i]) for i in rows], [int(model.jnt_dofadr[i]) for i in rows]


def compile_model(path: Path) -> mujoco.MjModel:
    """The MuJoCo model of a URDF or MJCF file, without meshes and contacts. Errors as load_mujoco_model."""
    import mujoco

    root = parsed(path)
    try:
        spec = mujoco.MjSpec.from_string(_bare_urdf(root)) if root.tag == "robot" else _bare_mjcf(path)
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        return spec.compile()
    except ValueError as problem:
        raise UsageError(
            f"MuJoCo cannot load the model: {str(problem).strip()}",
            where=str(path),
            next_step="Every moving link needs a mass and an inertia of its own.",
        ) from None


def parsed(path: Path) -> ET.Element:
    try:
        root = ET.parse(path).getroot()
    except FileNotFoundError:
        raise UsageError(f"there is no model file {path}", next_step="Check the path.") from None
    except (ET.ParseError, OSError, UnicodeDecodeError) as problem:
        raise UsageError(f"not a readable URDF or MJCF file: {problem}", where=str(path)) from None
    if any("xacro" in element.tag for element in root.iter()):
        raise UsageError(
            "this is a xacro file",
            where=str(path),
            next_step="Expand it first: xacro arm.urdf.xacro > arm.urdf.",
        )
    if root.tag not in ("robot", "mujoco"):
        raise UsageError(
            f"the root element is <{root.tag}>; URDF has <robot>, MJCF has <mujoco>", where=str(path)
        )
    return root


def _bare_urdf(root: ET.Element) -> str:
    """URDF text of links and joints alone; tiny bounds make massless frames acceptable."""
    bare = ET.Element("robot", name=root.get("name", "robot"))
    compiler = {"boundmass": "1e-9", "boundinertia": "1e-12", "balanceinertia": "true"}
    ET.SubElement(ET.SubElement(bare, "mujoco"), "compiler", compiler)
    for element in root:
        if element.tag == "link":
            link = ET.SubElement(bare, "link", name=element.get("name", ""))
            link.extend(element.findall("inertial"))
        elif element.tag == "joint":
            bare.append(element)
    return ET.tostring(bare, encoding="unicode")


def _bare_mjcf(path: Path) -> Any:
    """The MjSpec of an MJCF file, without what would have to be loaded from other files."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    meshes = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
    missing = [mesh for mesh in spec.meshes if mesh.file and not _mesh_file(spec, path, mesh.file).is_file()]
    if missing or spec.hfields:
        for geom in [g for g in spec.geoms if g.type in meshes or g.meshname]:
            spec.delete(geom)
        for asset in [*spec.meshes, *spec.hfields]:
            spec.delete(asset)
    for material in list(spec.materials):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    return spec


def _mesh_file(spec: Any, path: Path, name: str) -> Path:
    return path.parent / str(spec.meshdir) / name
