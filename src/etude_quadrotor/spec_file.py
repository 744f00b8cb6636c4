"""TOML file of a multirotor: strict reading, exact writing.

kind = "quadrotor"               # or "vehicle"
name = "quadrotor"
commands = ["front_right", "back_right", "back_left", "front_left"]
command_unit = "V"               # V, or 1 for normalised set-points
command_lower = [0.0, 0.0, 0.0, 0.0]  # as many as commands, four or more
command_upper = [11.1, 11.1, 11.1, 11.1]
rate = 10.0                      # Hz of the samples a model learns from; logs may be faster
lower = [-10.0, -10.0, 0.3]      # box of the vehicle's centre, m, z up
upper = [10.0, 10.0, 5.0]
speed = 6.0                      # largest |v|, m/s
margin = 0.5                     # m kept from every wall for the tracking error
vertical_margin = 0.3            # optional: the same from floor and ceiling, m
ground = 0.05                    # optional: height of its centre where it stands, m
climb = 3.0                      # optional: fastest that the autopilot flies up, m/s (MPC_Z_VEL_MAX_UP)
descent = 1.5                    # optional: and down (MPC_Z_VEL_MAX_DN)
attitude_gain = 6.5              # optional: P of its attitude, 1/s (MC_ROLL_P)
velocity_damping = 0.2           # optional: D of its horizontal velocity (MPC_XY_VEL_D_ACC)
radius = 1.5                     # optional: of a cylinder about the z axis, m
tilt = 0.5                       # optional: largest angle of the thrust from the vertical, rad
thrust = [4.0, 16.0]             # optional: least and largest thrust per mass, m/s^2
plant = "quadrotor"              # optional: simulated stand-in
rotors = [[0.1, -0.1, 1.0], ...] # of other than four in an X: x, y (m) and spin of each command's rotor;
                                 # x forward, y left, spin +1 against the clock seen from above, else -1
thrust_curve = 0.3               # optional: PX4's THR_MDL_FAC in the flights
[vehicle]                        # optional: the fields of `vehicle.Vehicle`, for the analytic inverse model
[[limit]]                        # optional: limits of one's own, see `etude.limits.robot_file_limits`
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from etude.errors import UsageError
from etude.limits.robot_file_limits import read_limits
from etude.toml_tables import decoded, read_text
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY, SPINS, Rotor, Vehicle

KIND = "quadrotor"
KINDS = (KIND, "vehicle")
"""Names of the kind in a file; "vehicle" is the older one."""
LEAST = 4
"""Least number of motors: fewer cannot produce thrust and three moments independently."""
APART = 1e-3
"""Relative to the largest singular value of an allocation, with rotors within a unit circle: smaller ones
count as 0.
"""
FORCES = ("thrust", "roll moment", "pitch moment", "yaw moment")
"""Rows of an allocation."""
UNITS = ("V", "1")
Three = tuple[float, float, float]


class QuadrotorTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """The whole file. `units_checked` confirms values that would otherwise be suspected of another unit."""

    kind: str
    name: str
    commands: tuple[str, ...]
    command_unit: str
    command_lower: tuple[float, ...]
    command_upper: tuple[float, ...]
    rate: float
    lower: Three
    upper: Three
    speed: float
    margin: float
    vertical_margin: float | None = None
    ground: float | None = None
    climb: float = 3.0
    descent: float = 1.5
    attitude_gain: float = 6.5
    velocity_damping: float | None = None
    radius: float | None = None
    tilt: float | None = None
    thrust: tuple[float, float] | None = None
    plant: str | None = None
    rotors: tuple[Rotor, ...] = ()
    thrust_curve: float = 0.0
    units_checked: bool = False
    vehicle: dict[str, Any] | None = None
    limit: tuple[dict[str, Any], ...] = ()


def read_spec(path: Path) -> QuadrotorSpec:
    """The vehicle in a TOML file. Errors as `spec_from_table`, and for a file that cannot be read."""
    return spec_from_table(decoded(read_text(path, "robot file"), path.name), where=path.name)


def spec_from_table(data: dict[str, Any], *, where: str) -> QuadrotorSpec:
    """The vehicle described by a decoded TOML table, checked.

    Raises:
        UsageError: unknown or missing key, an impossible limit, a figure that looks like another unit.
    """
    if data.get("kind") not in KINDS:
        raise UsageError(
            f"kind = {data.get('kind')!r} is no {KIND}", where=where, next_step=f'Write kind = "{KIND}".'
        )
    table, vehicle = _converted(data, where)
    spec = QuadrotorSpec(
        name=table.name,
        lower=table.lower,
        upper=table.upper,
        speed=table.speed,
        command_names=table.commands,
        command_unit=table.command_unit,
        command_lower=table.command_lower,
        command_upper=table.command_upper,
        rate=table.rate,
        radius=table.radius,
        tilt=table.tilt,
        thrust=table.thrust,
        margin=table.margin,
        vertical_margin=table.vertical_margin,
        ground=table.ground,
        climb=table.climb,
        descent=table.descent,
        attitude_gain=table.attitude_gain,
        velocity_damping=QuadrotorSpec.velocity_damping
        if table.velocity_damping is None
        else table.velocity_damping,
        damping_stated=table.velocity_damping is not None,
        vehicle=vehicle,
        plant=table.plant,
        rotors=table.rotors,
        thrust_curve=table.thrust_curve,
        limits=read_limits(table.limit, where),
    )
    check_spec(spec, where=where)
    suspicion = unit_suspicion(spec)
    if suspicion and not table.units_checked:
        raise UsageError(
            suspicion, where=where, next_step="If the figure is right, set units_checked = true."
        )
    return spec


def _converted(data: dict[str, Any], where: str) -> tuple[QuadrotorTable, Vehicle | None]:
    """The table, and its [vehicle]. UsageError: a key or a type that they do not have."""
    try:
        table = msgspec.convert(data, QuadrotorTable)
        vehicle = None if table.vehicle is None else msgspec.convert(table.vehicle, Vehicle)
    except msgspec.ValidationError as problem:
        named = ", ".join(field.name for field in msgspec.structs.fields(QuadrotorTable))
        raise UsageError(
            f"this file does not describe a vehicle: {problem}",
            where=where,
            next_step=f"The keys are {named}.",
        ) from None
    if table.vehicle is not None:
        _refuse_unknown(table.vehicle, where)
    return table, vehicle


def _refuse_unknown(table: dict[str, Any], where: str) -> None:
    valid_keys = [field.name for field in fields(Vehicle) if field.name != "layout"]
    for key in table:
        if key not in valid_keys:
            raise UsageError(
                f"unknown key '{key}'",
                where=f"{where} [vehicle]",
                next_step=f"Valid keys: {', '.join(valid_keys)}.",
            )


def check_spec(spec: QuadrotorSpec, *, where: str = "") -> None:
    """Raises a UsageError that names an impossible limit, an empty room, or a vehicle that cannot lift its
    weight.
    """
    numbers = {
        "rate": spec.rate,
        "speed": spec.speed,
        "climb": spec.climb,
        "descent": spec.descent,
        "attitude_gain": spec.attitude_gain,
        "radius": spec.radius,
        "tilt": spec.tilt,
        **({} if spec.vehicle is None else _vehicle_numbers(spec.vehicle)),
    }
    for name, value in numbers.items():
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise UsageError(f"{name} must be a number above zero, not {value}", where=where)
    for margin in spec.margins:
        if not (math.isfinite(margin) and margin >= 0.0):
            raise UsageError(f"a margin must be 0 or more, not {margin}", where=where)
    if spec.command_unit not in UNITS:
        raise UsageError(f"unknown command_unit '{spec.command_unit}'", where=where, next_step="Use V or 1.")
    if not 0.0 <= spec.thrust_curve <= 1.0:
        raise UsageError(f"thrust_curve must be from 0 to 1, not {spec.thrust_curve:g}", where=where)
    if not 0.0 <= spec.velocity_damping <= 2.0:  # PX4's own range
        raise UsageError(f"velocity_damping must be from 0 to 2, not {spec.velocity_damping:g}", where=where)
    _check_commands(spec, where)
    _check_rotors(spec, where)
    _check_room(spec, where)
    for name, low, high in zip(spec.command_names, spec.command_lower, spec.command_upper, strict=True):
        _check_order(f"command {name}", low, high, where)
    if spec.thrust is not None:
        _check_order("thrust", *spec.thrust, where)
        if not spec.thrust[0] < GRAVITY < spec.thrust[1]:
            raise UsageError(
                f"with a thrust of {spec.thrust[0]:g} to {spec.thrust[1]:g} m/s^2 it cannot hover",
                where=f"{where} thrust",
                next_step=f"The limits are per mass and have {GRAVITY} between them.",
            )
    vehicle = spec.airframe
    if vehicle is not None and vehicle.hover_voltage >= vehicle.voltage_limit:
        raise UsageError(
            f"it would hover at {vehicle.hover_voltage:.3g} V, over its limit of {vehicle.voltage_limit:g} V",
            where=f"{where} [vehicle]",
            next_step="Check mass, thrust_constant, motor_constant and resistance; all are SI.",
        )


def _check_commands(spec: QuadrotorSpec, where: str) -> None:
    names, count = spec.command_names, len(spec.command_names)
    if count < LEAST:
        raise UsageError(
            f"a flat multirotor has {LEAST} motors or more, this vehicle has {count} commands",
            where=where,
            next_step="Tricopters, helicopters, VTOLs and planes are not supported.",
        )
    if len(set(names)) < count or "" in names:
        raise UsageError(f"the {count} commands need {count} different names", where=f"{where} commands")
    for key, values in (("command_lower", spec.command_lower), ("command_upper", spec.command_upper)):
        if len(values) != count:
            raise UsageError(
                f"{key} has {len(values)} limits for {count} commands",
                where=f"{where} {key}",
                next_step="Give one for each command, in their order.",
            )
    if spec.plant is not None and count != LEAST:
        raise UsageError(
            f"the simulated vehicles have {LEAST} motors, this one has {count}",
            where=f"{where} plant",
            next_step="Remove plant, and use logs of the real vehicle.",
        )


def _check_rotors(spec: QuadrotorSpec, where: str) -> None:
    """Raises a UsageError if rotors do not match the commands, or cannot produce thrust and moments
    independently.
    """
    place, count = f"{where} rotors", len(spec.command_names)
    if not spec.rotors:
        if spec.body is not None and count != LEAST:
            raise UsageError(
                f"[vehicle] does not state the positions of its {count} rotors",
                where=where,
                next_step="Write rotors = [[x, y, spin], ...], one for each command, in m.",
            )
        return
    if len(spec.rotors) != count:
        raise UsageError(
            f"there are {len(spec.rotors)} rotors for {count} commands",
            where=place,
            next_step="Write one [x, y, spin] for each of the commands, in their order.",
        )
    if any(spin not in SPINS or not math.isfinite(x + y) for x, y, spin in spec.rotors):
        raise UsageError(
            "a rotor is [x, y, spin]: two numbers in m, and 1 or -1",
            where=place,
            next_step="1: it turns anticlockwise, seen from above.",
        )
    lacking = lacking_forces(spec.rotors)
    if lacking:
        raise UsageError(
            f"the allocation matrix is singular: these rotors cannot make {lacking}",
            where=place,
            next_step="Check positions and spins: not all in one line, and some in each direction.",
        )


def lacking_forces(rotors: Sequence[Rotor]) -> str:
    """Names of thrust or moments that the rotors cannot produce independently; "" if there are none."""
    x, y, spins = np.array(rotors).T
    size = float(np.hypot(x, y).max()) or 1.0
    allocation = np.stack([np.ones(len(x)), y / size, -x / size, -spins])
    left, values, _ = np.linalg.svd(allocation, full_matrices=True)
    lost = np.pad(values, (0, len(FORCES) - len(values))) < APART * values[0]
    if not lost.any():
        return ""
    parts = np.linalg.norm(left[:, lost], axis=1)
    names = [name for name, part in zip(FORCES, parts, strict=True) if part > 0.1]
    return f"{' and '.join(names)} apart from one another" if len(names) > 1 else f"any {names[0]}"


def _vehicle_numbers(vehicle: Vehicle) -> dict[str, float]:
    plain = {k: v for k, v in vars(vehicle).items() if isinstance(v, float)}
    return {**plain, **{f"inertia {axis}": value for axis, value in zip("xyz", vehicle.inertia, strict=True)}}


def _check_room(spec: QuadrotorSpec, where: str) -> None:
    for axis, low, high, margin in zip("xyz", spec.lower, spec.upper, spec.margins, strict=True):
        _check_order(f"{axis} of the box", low, high, where)
        if high - low <= 2.0 * margin:
            raise UsageError(
                f"the box is {high - low:g} m wide in {axis}, less than two margins of {margin:g} m",
                where=f"{where} margin",
                next_step="Enlarge it, or reduce the margin if the controller can keep a smaller one.",
            )
    lowest = spec.lower[2] + spec.margins[2]
    if spec.ground is not None and not (math.isfinite(spec.ground) and spec.ground < lowest):
        raise UsageError(
            f"the ground at {spec.ground:g} m is not below {lowest:g} m, the lowest that a flight may be",
            where=f"{where} ground",
            next_step="It is the height of the vehicle's centre on the ground.",
        )
    if spec.radius is not None and spec.radius <= spec.margin:
        raise UsageError(
            f"the margin of {spec.margin:g} m fills the cylinder of radius {spec.radius:g} m",
            where=f"{where} margin",
            next_step="Enlarge it, or reduce the margin if the controller can keep a smaller one.",
        )


def _check_order(name: str, low: float, high: float, where: str) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise UsageError(
            f"{name} runs from {low} to {high}: the lower limit must be below the upper", where=where
        )


def unit_suspicion(spec: QuadrotorSpec) -> str:
    """A sentence if a figure looks like degrees, millimetres, grams or millivolts, else an empty string."""
    if spec.tilt is not None and spec.tilt > 0.5 * math.pi:
        return f"a tilt of {spec.tilt:g} looks like degrees, not radians"
    if max(map(abs, (*spec.lower, *spec.upper))) > 1000.0 or spec.speed > 100.0:
        return "the box or the speed looks like millimetres, not metres"
    if spec.command_unit == "V" and max(spec.command_upper) > 200.0:
        return f"a command of {max(spec.command_upper):g} looks like millivolts, not volts"
    widest = max((math.hypot(x, y) for x, y, _ in spec.rotors), default=0.0)
    if widest > 5.0:
        return f"a rotor {widest:g} from the centre looks like millimetres, not metres"
    vehicle = spec.vehicle
    if vehicle is not None and vehicle.mass > 25.0:
        return f"a mass of {vehicle.mass:g} looks like grams, not kilograms"
    if vehicle is not None and vehicle.arm > 5.0:
        return f"an arm of {vehicle.arm:g} looks like millimetres, not metres"
    return ""


def spec_to_toml(spec: QuadrotorSpec) -> str:
    """TOML text that reads back to the same spec."""
    vehicle = {} if spec.vehicle is None else msgspec.to_builtins(spec.vehicle)
    vehicle.pop("layout", None)
    table = QuadrotorTable(
        kind=KIND,
        name=spec.name,
        commands=spec.command_names,
        command_unit=spec.command_unit,
        command_lower=spec.command_lower,
        command_upper=spec.command_upper,
        rate=spec.rate,
        lower=spec.lower,
        upper=spec.upper,
        speed=spec.speed,
        margin=spec.margin,
        vertical_margin=spec.vertical_margin,
        ground=spec.ground,
        climb=spec.climb,
        descent=spec.descent,
        attitude_gain=spec.attitude_gain,
        velocity_damping=spec.velocity_damping if spec.damping_stated else None,
        radius=spec.radius,
        tilt=spec.tilt,
        thrust=spec.thrust,
        plant=spec.plant,
        rotors=spec.rotors,
        thrust_curve=spec.thrust_curve,
        units_checked=bool(unit_suspicion(spec)),
    )
    lines = [
        f"{key} = {_text(value)}" for key, value in msgspec.to_builtins(table).items() if value is not None
    ]
    if vehicle:
        lines += ["", "[vehicle]", *(f"{key} = {_text(value)}" for key, value in vehicle.items())]
    for limit in spec.limits:
        lines += ["", "[[limit]]", *(f"{key} = {_text(value)}" for key, value in limit.table().items())]
    return "\n".join(lines) + "\n"


def _text(value: Any) -> str:
    # JSON's strings, numbers and arrays are TOML too, but for one control character
    return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
