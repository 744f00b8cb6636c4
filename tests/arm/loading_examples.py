"""A small URDF with everything that files have, and robots of packages that contain their files."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path

import pytest

INERTIAL = """<inertial><origin xyz="0.1 0 0.02"/><mass value="{mass}"/>
  <inertia ixx="0.011" iyy="0.02" izz="0.021" ixy="0.001" ixz="0" iyz="0.002"/></inertial>"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 0.2) for y in (-0.1, 0.1) for z in (-0.05, 0.05))
LIMIT = '<limit lower="-1.5" upper="2" velocity="3" effort="40"/>'


def link(name: str, mass: float = 0.0, shape: str = "", drawn: str = "") -> str:
    inertial = INERTIAL.format(mass=mass) if mass else ""
    collision = f'<collision><origin xyz="0.1 0 0"/><geometry>{shape}</geometry></collision>' if shape else ""
    visual = f"<visual><geometry>{drawn}</geometry></visual>" if drawn else ""
    return f'<link name="{name}">{inertial}{visual}{collision}</link>'


def joint(
    name: str, parent: str, child: str, kind: str = "revolute", more: str = "", limit: str = LIMIT
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 0.05 -0.02" rpy="0.3 -0.2 0.9"/><axis xyz="0.2 1 -0.4"/>{limit}{more}</joint>'
    )


MESH = '<mesh filename="package://arm/meshes/cube.obj" scale="1 1 2"/>'
BOX = '<box size="0.2 0.1 0.1"/>'
ARM = (
    link("base", shape='<cylinder radius="0.1" length="0.2"/>')
    + link("upper", 3.0, MESH, drawn=BOX)
    + link("fore", 1.5, '<sphere radius="0.07"/>')
    + link("hand", 0.5, BOX)
    + link("left", 0.1, BOX)
    + link("right", 0.1, BOX)
    + joint("shoulder", "base", "upper")
    + joint("elbow", "upper", "fore", more='<safety_controller soft_lower_limit="-1" soft_upper_limit="3"/>')
    + joint("wrist", "fore", "hand", "continuous", limit='<limit velocity="3" effort="40"/>')
    + joint("finger_left", "hand", "left", "prismatic", limit='<limit lower="0.01" upper="0.04" effort="9"/>')
    + joint(
        "finger_right",
        "hand",
        "right",
        "prismatic",
        '<mimic joint="finger_left" multiplier="-1" offset="0.005"/>',
    )
)


def robot(text: str = ARM) -> str:
    return f'<robot name="arm">{text}</robot>'


def write(folder: Path, text: str = ARM) -> Path:
    """The URDF in a package of its own, with its mesh."""
    path = folder / "arm" / "urdf" / "arm.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(robot(text))
    (folder / "arm" / "meshes").mkdir(exist_ok=True)
    (folder / "arm" / "meshes" / "cube.obj").write_text(CUBE)
    return path


def example_robot(name: str) -> Path:
    """A robot of the package example-robot-data; the test is skipped where it is not installed."""
    try:
        files = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")
    return Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots"))) / name


def bullet_robot(name: str) -> Path:
    """A robot of the package pybullet; the test is skipped where it is not installed."""
    found = find_spec("pybullet_data")
    if found is None or not found.submodule_search_locations:
        pytest.skip("pybullet is not installed: pip install pybullet")
    return Path(next(iter(found.submodule_search_locations))) / name
