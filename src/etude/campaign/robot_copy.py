"""Brings a robot into a campaign folder, so that the folder needs nothing outside itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from etude.campaign.folder import ROBOT
from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.robots.toml_file import load_robot, robot_to_toml
from etude.storage import write_atomic

MODEL_SUFFIXES = (".urdf", ".xml", ".mjcf")
DEEPEST = 20
"""Levels of includes; more is a circle."""


def robot_from(robot: str) -> tuple[RobotSpec, tuple[str, ...]]:
    """The robot of a built-in name, a TOML, or a URDF or MJCF; and what a person should confirm of it."""
    if Path(robot).suffix.lower() in MODEL_SUFFIXES:
        from etude.robots.model_file import spec_from_model

        found = spec_from_model(Path(robot))
        return found.spec, found.confirm
    return load_robot(robot), ()


def copy_robot(path: Path, spec: RobotSpec, confirm: tuple[str, ...]) -> list[Path]:
    """Copies the model file into `path`, then writes a robot.toml that points to the copy; returns both."""
    files = []
    if spec.model_file is not None:
        copy = path / f"robot_model{spec.model_file.suffix}"
        write_atomic(copy, model_bytes(spec.model_file))
        files.append(copy)
        spec = replace(spec, model_file=copy.resolve())
    text = robot_to_toml(spec, folder=path, comments=tuple(f"Confirm: {sentence}" for sentence in confirm))
    write_atomic(path / ROBOT, text.encode())
    return [path / ROBOT, *files]


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
