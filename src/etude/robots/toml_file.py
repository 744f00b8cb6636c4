"""One TOML file per robot: strict reading, exact writing, built-in robots by name.

name = "arm"
command_unit = "N m"        # of the learned output: N m, N, A, V or pwm
rate = 100.0                # logging and control rate, Hz
model_file = "arm.urdf"     # optional, relative to this file
plant = "arm4"              # optional, simulated stand-in
[[axis]]                    # one table per joint, in the order of every array's columns
name = "elbow"
lower = -1.0                # rad (m for a sliding joint)
upper = 1.0
velocity = 2.0              # largest |qd|, rad/s
acceleration = 4.0          # largest |qdd|, rad/s^2
command = 150.0             # largest |command|, in command_unit

A flying vehicle has kind = "vehicle" and the keys of `flight_file`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec

from etude.errors import UsageError
from etude.robots.checks import check_spec, unit_suspicion
from etude.robots.flight_file import KIND, flight_from_table, flight_to_toml
from etude.robots.flight_spec import FlightSpec
from etude.robots.spec import Axis, RobotSpec

BUILT_IN = Path(__file__).parent / "data"


class AxisTable(msgspec.Struct, forbid_unknown_fields=True):
    """One [[axis]] table; the fields of `spec.Axis`."""

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    command: float


class RobotTable(msgspec.Struct, forbid_unknown_fields=True):
    """The whole file. `units_checked` vouches for limits that would otherwise be suspected to be degrees."""

    name: str
    command_unit: str
    rate: float
    axis: list[AxisTable]
    model_file: str | None = None
    plant: str | None = None
    units_checked: bool = False


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """The robot of a TOML file, or a built-in one by name.

    Raises:
        UsageError: no such file or name, unknown key, missing or impossible limit, limits in degrees.
    """
    path = Path(name_or_path)
    if path.suffix.lower() != ".toml" and not path.is_file():
        path = _built_in(str(name_or_path))
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise UsageError(
            f"there is no robot file {path}",
            next_step=f"Give a TOML file or one of: {', '.join(robot_names())}.",
        ) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise UsageError(
            f"the robot file cannot be read: {problem}",
            where=str(path),
            next_step="Check that it is a text file that you may read, or restore it from a copy.",
        ) from None
    return parse_robot(text, where=path.name, folder=path.parent)


def robot_names() -> tuple[str, ...]:
    """Names of the built-in robots."""
    return tuple(sorted(path.stem for path in BUILT_IN.glob("*.toml")))


def _built_in(name: str) -> Path:
    if name in robot_names():
        return BUILT_IN / f"{name}.toml"
    raise UsageError(
        f"unknown robot '{name}'",
        next_step=f"Give the path of a robot TOML, or one of: {', '.join(robot_names())}.",
    )


def parse_robot(text: str, *, where: str, folder: Path) -> RobotSpec:
    """The robot described by TOML text; a relative model_file starts at `folder`. Errors as load_robot."""
    try:
        data = msgspec.toml.decode(text)
    except msgspec.DecodeError as problem:
        raise UsageError(
            f"not valid TOML: {problem}",
            where=where,
            next_step="Correct that place, or restore the file from a copy.",
        ) from None
    return robot_from_table(data, where=where, folder=folder)


def robot_from_table(data: dict[str, Any], *, where: str, folder: Path) -> RobotSpec:
    """The robot described by a decoded TOML table, checked. Errors as load_robot."""
    if data.get("kind") == KIND:
        return vehicle_spec(flight_from_table(data, where=where))
    _check_keys(data, RobotTable, where)
    axes = data["axis"]
    if not isinstance(axes, list) or not all(isinstance(a, dict) for a in axes):
        raise UsageError("axis must be an array of tables", where=where, next_step="Write [[axis]].")
    for number, axis in enumerate(axes):
        label = f"joint '{axis['name']}'" if "name" in axis else f"axis number {number + 1}"
        _check_keys(axis, AxisTable, f"{where}, {label}")
    try:
        table = msgspec.convert(data, RobotTable)
    except msgspec.ValidationError as problem:
        raise UsageError(f"wrong type: {problem}", where=where) from None
    return check_spec(_spec(table, where, folder), where=where, units_checked=table.units_checked)


def vehicle_spec(flight: FlightSpec) -> RobotSpec:
    """The vehicle as a robot of three axes, the coordinates of its centre in the box.

    Its trajectory is a function of time to (x, y, z); limits of acceleration and command are its own.
    """
    axes = tuple(
        Axis(name, low, high, flight.speed, math.inf, math.inf)
        for name, low, high in zip("xyz", flight.lower, flight.upper, strict=True)
    )
    return RobotSpec(flight.name, axes, flight.command_unit, flight.rate, None, flight.plant, flight)


def _check_keys(data: dict[str, Any], table: type[msgspec.Struct], where: str) -> None:
    fields = msgspec.structs.fields(table)
    names = [field.name for field in fields]
    for key in data:
        if key not in names:
            raise UsageError(
                f"unknown key '{key}'", where=where, next_step=f"Valid keys: {', '.join(names)}."
            )
    missing = [field.name for field in fields if field.required and field.name not in data]
    if missing:
        raise UsageError(
            f"missing {', '.join(missing)}", where=where, next_step="No limit is guessed: state each of them."
        )


def _spec(table: RobotTable, where: str, folder: Path) -> RobotSpec:
    model_file = None if table.model_file is None else (folder / table.model_file).resolve()
    if model_file is not None and not model_file.is_file():
        raise UsageError(
            f"model_file {model_file} does not exist",
            where=where,
            next_step="Correct the path (relative to this file), or leave model_file out.",
        )
    axes = tuple(Axis(a.name, a.lower, a.upper, a.velocity, a.acceleration, a.command) for a in table.axis)
    return RobotSpec(table.name, axes, table.command_unit, table.rate, model_file, table.plant)


def robot_to_toml(spec: RobotSpec, *, folder: Path | None = None, comments: tuple[str, ...] = ()) -> str:
    """TOML text that `parse_robot` reads back to the same spec.

    Args:
        spec: the robot.
        folder: where the text will be stored; a model_file below it is written as a relative path.
        comments: lines to put on top, e.g. limits that a person should confirm.
    """
    if spec.flight is not None:
        return "".join(f"# {comment}\n" for comment in comments) + flight_to_toml(spec.flight)
    lines = [f"# {comment}" for comment in comments]
    lines += [f"name = {_quoted(spec.name)}", f"command_unit = {_quoted(spec.command_unit)}"]
    lines.append(f"rate = {float(spec.rate)!r}")
    if spec.model_file is not None:
        model_file = spec.model_file
        if folder is not None and model_file.is_relative_to(folder.resolve()):
            model_file = model_file.relative_to(folder.resolve())
        lines.append(f"model_file = {_quoted(str(model_file))}")
    if spec.plant is not None:
        lines.append(f"plant = {_quoted(spec.plant)}")
    if unit_suspicion(spec):
        lines.append("units_checked = true")
    for axis in spec.axes:
        lines += ["", "[[axis]]", f"name = {_quoted(axis.name)}"]
        lines += [
            f"{limit} = {float(getattr(axis, limit))!r}"
            for limit in ("lower", "upper", "velocity", "acceleration", "command")
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    # A JSON string is a valid TOML basic string, but for the one control character that JSON leaves as it is.
    return msgspec.json.encode(text).decode().replace("\x7f", "\\u007f")
