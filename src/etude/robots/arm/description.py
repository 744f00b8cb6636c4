"""Brings a robot of joints into a campaign folder, so that the folder needs nothing outside itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from etude.contracts import Described
from etude.errors import UsageError
from etude.robots.arm.robot_file import read_robot, robot_to_toml
from etude.robots.arm.spec import ArmSpec

ROBOT_FILE = "robot.toml"
MODEL_NAME = "robot_model"
DEEPEST = 20
"""Levels of includes; more is a circle."""


def read(path: Path) -> tuple[ArmSpec, tuple[str, ...]]:
    """The robot of a robot file, a URDF or an MJCF; and what a person should confirm of it."""
    if path.suffix.lower() == ".toml":
        return read_robot(path), ()
    from etude.robots.arm.urdf import spec_from_model

    found = spec_from_model(path)
    return found.spec, found.confirm


def describe(path: Path) -> Described:
    """robot.toml and a whole copy of the model file that it points to.

    Raises:
        UsageError: no robot, or a model file that cannot be read or completed.
    """
    spec, confirm = read(path)
    files = {}
    if spec.model_file is not None:
        name = f"{MODEL_NAME}{spec.model_file.suffix}"
        files[name] = model_bytes(spec.model_file)
        spec = replace(spec, model_file=Path(name))
    text = robot_to_toml(spec, comments=tuple(f"Confirm: {sentence}" for sentence in confirm))
    return Described({ROBOT_FILE: text.encode(), **files}, confirm)


def model_bytes(path: Path) -> bytes:
    """The model file's bytes, with MJCF includes put in their places; meshes are not needed and not copied.

    Raises:
        UsageError: unreadable XML, a missing include, or includes in a circle.
    """
    data = path.read_bytes()
    if b"<include" not in data:
        return data
    root = _parse(path)
    _expand(root, path.parent, 0)
    return bytes(ElementTree.tostring(root, encoding="utf-8"))


def _expand(element: ElementTree.Element, folder: Path, depth: int) -> None:
    """Replaces each <include file="..."> below `element` by the children of that file's root.

    `folder` is the main file's: MuJoCo means every path from there, in included files too.
    """
    if depth > DEEPEST:
        raise UsageError("the model's files include each other in a circle", where=str(folder))
    children: list[ElementTree.Element] = []
    for child in element:
        if child.tag == "include":
            included = _parse(folder / child.attrib.get("file", ""))
            _expand(included, folder, depth + 1)
            children += list(included)
        else:
            _expand(child, folder, depth)
            children.append(child)
    element[:] = children


def _parse(path: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise UsageError(f"the model file cannot be read: {error}", where=str(path)) from None
