"""One TOML file per robot of joints: strict reading, exact writing.

kind = "arm"                # optional
name = "arm"
command_unit = "N m"        # of the learned output: N m, N, A, V or pwm
rate = 100.0                # logging and control rate, Hz
model_file = "arm.urdf"     # optional, relative to this file
plant = "arm4"              # optional, simulated stand-in
confirm = ["..."]           # optional: what was assumed; take a line out once you know that it is right
[simulate]                  # optional, as [[motor]]: of the stand-in made from model_file; rehearsal.overlay
[[axis]]                    # one table per joint, in the order of every array's columns
name = "elbow"
lower = -1.0                # rad (m for a sliding joint)
upper = 1.0
velocity = 2.0              # largest |qd|, rad/s
acceleration = 4.0          # largest |qdd|, rad/s^2
command = 150.0             # largest |command|, in command_unit
unit = "m"                  # optional: of a sliding joint
jerk = 20.0                 # optional: largest |qddd|, rad/s^3
torque = 60.0               # optional: largest |command| that a motion may ask, if less than `command`
torque_rate = 1000.0        # optional: the same of its rate, command_unit/s
envelope = { offset = -0.3, slope = 12.0, lower = -2.7, upper = 2.7 } # optional: see `velocity_envelope`
[held]                      # optional: the model file's other joints, and where they stand, rad or m
gripper = 0.02
[mounting]                  # optional: the base in the room, z up
position = [0.0, 0.0, 0.8]  # m
rotation = [0.0, 0.0, 0.0]  # roll, pitch, yaw, rad
[tool]                      # optional, and [payload] alike: fields of loading.attached.Attached
mass = 0.9                  # kg
centre = [0.0, 0.0, 0.06]   # of mass, m in the frame of the link that the last axis moves
shape = "cylinder"          # box, cylinder or sphere; without inertia = [...] it gives the inertia
size = [0.04, 0.12]         # radius and length, m
[gains]                     # optional: of the robot's own feedback
kp = [900.0]                # command units per rad (m), one for each joint
[floor], [[box]], ...       # optional: what stands around, see `clearance.surroundings`
[cartesian]                 # optional: speeds and places in space, see `space.table`
[[limit]]                   # optional: limits of one's own, see `etude.limits.robot_file_limits`
"""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from etude.errors import UsageError
from etude.limits.robot_file_limits import read_limits
from etude.plugins import require_inside
from etude.toml_tables import decoded, from_table, read_text, write_values
from etude_arm.clearance.surroundings import (
    ADD_FLOOR,
    Box,
    Collision,
    Column,
    Floor,
    Room,
    Search,
    Surroundings,
    Wall,
)
from etude_arm.description_checks import check_spec, unit_suspicion
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.rehearsal.overlay import MotorTable, Simulate
from etude_arm.space.table import Cartesian
from etude_arm.spec import ArmSpec, Axis, Gains

KIND = "arm"
KINDS = (KIND, "joints", "")
"""What `kind` may say in a file: files of 0.1 say nothing."""


@dataclass(frozen=True, kw_only=True)
class RobotTable:
    """The whole file. `units_checked` confirms limits that look like degrees."""

    kind: str = ""
    name: str
    command_unit: str
    rate: float
    model_file: str | None = None
    plant: str | None = None
    units_checked: bool = False
    confirm: tuple[str, ...] = ()
    axis: tuple[Axis, ...] = field(metadata={"label": "joint"})
    held: dict[str, float] = field(default_factory=dict)
    mounting: Mounting | None = None
    tool: Attached | None = None
    payload: Attached | None = None
    gains: Gains | None = None
    collision: Collision | None = None
    floor: Floor | None = None
    box: tuple[Box, ...] = ()
    wall: tuple[Wall, ...] = ()
    room: Room | None = None
    column: Column | None = None
    search: Search | None = None
    cartesian: Cartesian | None = None
    simulate: Simulate | None = None
    motor: tuple[MotorTable, ...] = ()
    limit: tuple[dict[str, Any], ...] = ()


def read_robot(path: Path) -> ArmSpec:
    """The robot of a TOML file.

    Raises:
        UsageError: the file is missing, a key is unknown, or a limit is missing, invalid or in degrees.
    """
    return parse_robot(read_text(path, "robot file"), where=path.name, folder=path.parent)


def parse_robot(text: str, *, where: str, folder: Path) -> ArmSpec:
    """The robot described by TOML text; a relative model_file starts at `folder`. Errors as read_robot."""
    table = from_table(RobotTable, decoded(text, where), where)
    if table.kind not in KINDS:
        raise UsageError(
            f"kind = '{table.kind}' is not a robot with joints", where=where, next_step="Leave it out."
        )
    model_file = None if table.model_file is None else _model_file(folder / table.model_file, where)
    names = [one.name for one in fields(Surroundings)]
    try:
        tables = {name: getattr(table, name) for name in names}
        around = Surroundings(**{**tables, "collision": table.collision or Collision()})
    except UsageError as error:
        raise UsageError(error.fact, where=where, next_step="Give each a different name.") from None
    same = ("plant", "held", "mounting", "tool", "payload", "cartesian", "gains", "simulate")
    values = {**{name: getattr(table, name) for name in same}, "motors": table.motor, "confirm": _open(table)}
    values["limits"] = read_limits(table.limit, where)
    head = (table.name, table.axis, table.command_unit, table.rate, model_file)
    spec = ArmSpec(*head, **values, around=around)
    _check_search(spec, where)
    return check_spec(spec, where=where, units_checked=table.units_checked)


def _model_file(path: Path, where: str) -> Path:
    """The path, absolute. It and what it names lie in the folder of a campaign that is not trusted."""
    path = path.resolve()
    require_inside([path])
    if not path.is_file():
        raise UsageError(
            f"model_file {path} does not exist",
            where=where,
            next_step="Correct the path (relative to this file), or remove model_file.",
        )
    require_inside(_named_files(path))
    return path


MJCF_FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of <compiler> that names of files may be relative to."""


def _named_files(path: Path) -> Iterator[Path]:
    """Files that exist and that the model at `path` names, with those that MJCF files among them name.

    A name that may mean several files gives each. An unreadable file names none: its reader says so.
    """
    root = _xml(path)
    if root is not None and root.tag == "robot":
        yield from _of_urdf(root, path)
    elif root is not None:
        yield from _of_mjcf(root, path, (), {path.resolve()})


def _xml(path: Path) -> ET.Element | None:
    try:
        return ET.parse(path).getroot()
    except (OSError, ValueError, ET.ParseError):
        return None


def _of_urdf(root: ET.Element, path: Path) -> Iterator[Path]:
    names = tuple(mesh.get("filename", "") for mesh in root.iter("mesh"))
    if not names:
        return
    from etude_arm.loading.mesh_paths import MeshPaths  # `status` loads little

    paths = MeshPaths(path, (), names)
    for name in names:
        if file := paths.find(name):
            yield file


def _of_mjcf(root: ET.Element, path: Path, above: Sequence[Path], followed: set[Path]) -> Iterator[Path]:
    """above: folders that names in the files that include this one are relative to; followed: files done."""
    named = [Path(one.get(key, "")) for one in root.iter("compiler") for key in MJCF_FOLDERS]
    starts = tuple(dict.fromkeys((*above, path.parent)))
    folders = tuple(dict.fromkeys((*starts, *(start / one for start in starts for one in named))))
    names = [name for one in root.iter() for key, name in one.attrib.items() if key.startswith("file")]
    for file in (folder / name for name in names for folder in folders):
        with contextlib.suppress(OSError, ValueError):
            if not file.is_file():
                continue
            yield file
            inner = None if file.resolve() in followed else _xml(file)
            followed.add(file.resolve())
            if inner is not None:
                yield from _of_mjcf(inner, file, folders, followed)


def _open(table: RobotTable) -> tuple[str, ...]:
    """Lines still to be confirmed; a floor that was added since answers its line."""
    return tuple(line for line in table.confirm if table.floor is None or not line.endswith(ADD_FLOOR))


def _check_search(spec: ArmSpec, where: str) -> None:
    """Raises UsageError unless home and box have a number for each joint, and home is inside its limits."""
    search = spec.around.search
    if search is None:
        return
    sides = {"home": search.home, "lower": search.lower or search.home, "upper": search.upper or search.home}
    for name, values in sides.items():
        if len(values) != spec.dof:
            raise UsageError(
                f"{name} has {len(values)} numbers, the robot has {spec.dof} joints",
                where=f"{where} [search]",
                next_step="State one for each joint, or remove [search], which is then computed.",
            )
    for axis, low, pose, high in zip(spec.axes, sides["lower"], search.home, sides["upper"], strict=True):
        if not (axis.lower <= low <= pose <= high <= axis.upper):
            raise UsageError(
                f"home of joint '{axis.name}' is not inside its box, or the box not inside its limits: home "
                f"{pose:g}, box {low:g} to {high:g}, limits {axis.lower:g} to {axis.upper:g}",
                where=f"{where} [search]",
                next_step="Correct it, or remove [search], which is then computed.",
            )


def robot_to_toml(spec: ArmSpec, *, folder: Path | None = None) -> str:
    """TOML text that `parse_robot` reads back to the same spec.

    Args:
        spec: the robot.
        folder: where the text will be stored; a model_file below it is written as a relative path.
    """
    model_file = spec.model_file
    if model_file is not None and folder is not None and model_file.is_relative_to(folder.resolve()):
        model_file = model_file.relative_to(folder.resolve())
    table = RobotTable(
        kind=KIND,
        name=spec.name,
        command_unit=spec.command_unit,
        rate=spec.rate,
        model_file=None if model_file is None else str(model_file),
        plant=spec.plant,
        units_checked=bool(unit_suspicion(spec)),
        axis=spec.axes,
        held=dict(spec.held),
        mounting=spec.mounting,
        tool=spec.tool,
        payload=spec.payload,
        gains=spec.gains,
        confirm=spec.confirm,
        **_tables(spec.around),
        cartesian=spec.cartesian,
        simulate=spec.simulate,
        motor=spec.motors,
        limit=tuple(one.table() for one in spec.limits),
    )
    return write_values(table)


def _tables(around: Surroundings) -> dict[str, Any]:
    """The surroundings by the names of their tables; None for a default."""
    tables = {one.name: getattr(around, one.name) for one in fields(Surroundings)}
    return tables | {"collision": None if around.collision == Collision() else around.collision}
