"""Physical parameters of a simulated arm, read from `plant/data/NAME.toml`; the code has none."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any

import msgspec

from etude.errors import UsageError

DATA = Path(__file__).parent / "data"
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class Sine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """amplitude * sin(wavenumber * length + phase), of the actuator's length in m (rad on a hinge)."""

    amplitude: NonNegative = 0.0
    wavenumber: NonNegative = 0.0
    phase: float = 0.0


class Link(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A link along its own x axis: kg, m, kg m^2; inertias about the centre of mass, along and across x."""

    name: str
    mass: Positive
    length: Positive
    center: Positive
    inertia_along: NonNegative
    inertia_across: NonNegative


class Motor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A DC motor with LuGre friction on a hinge (N m, rad) or on a linear actuator (N, m).

    Attributes:
        joint: the joint it drives.
        stall, no_load: force at rest, and speed without load and friction, at full supply.
        coulomb, static, stribeck: LuGre's g(v) = coulomb + (static - coulomb) exp(-(v / stribeck)^2).
        stiffness, micro_damping, viscous: LuGre's sigma_0, sigma_1, sigma_2.
        armature: rotor inertia seen at the output.
        fixed, moving: pivots (x, z) of a linear actuator in the frames of the link before and after the
            joint; both None for a motor on the hinge itself.
        gear: +1, or -1 where extension closes the joint.
        cogging: force ripple.
        friction_ripple: relative variation of both friction levels along the travel.
    """

    joint: str
    stall: Positive
    no_load: Positive
    coulomb: Positive
    static: Positive
    stribeck: Positive
    stiffness: Positive
    micro_damping: NonNegative
    armature: NonNegative
    viscous: NonNegative
    fixed: tuple[float, float] | None = None
    moving: tuple[float, float] | None = None
    gear: float = 1.0
    cogging: Sine = Sine()
    friction_ripple: Sine = Sine()

    def electrical(self, supply: float) -> tuple[float, float]:
        """Motor constant K (V s per unit of length, N/A) and resistance R (ohm) at `supply` V.

        At the no-load speed the back-EMF K v balances the supply; at rest the force is K supply / R.
        """
        constant = supply / self.no_load
        return constant, constant * supply / self.stall

    def __post_init__(self) -> None:
        if (self.fixed is None) != (self.moving is None):
            raise ValueError(f"motor {self.joint}: a linear actuator needs both pivots, fixed and moving")
        if self.static < self.coulomb or self.friction_ripple.amplitude >= 1.0:
            raise ValueError(f"motor {self.joint}: needs static >= coulomb and friction_ripple below 1")


class Controller(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """PD control of the arm's electronics: supply in V, integer commands, encoder, velocity filter."""

    supply: Positive
    resolution: Annotated[int, msgspec.Meta(gt=0)]
    encoder_bits: Annotated[int, msgspec.Meta(gt=0, le=32)]
    encoder_noise_degrees: NonNegative
    velocity_filter: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
    kp: tuple[float, ...]
    kd: tuple[float, ...]

    @property
    def encoder_tick(self) -> float:
        """Resolution of the encoder, rad."""
        return float(2.0 * math.pi / 2**self.encoder_bits)

    @property
    def encoder_noise(self) -> float:
        """Standard deviation of the encoder's noise, rad."""
        return math.radians(self.encoder_noise_degrees)


class ArmParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A waist about the vertical and a planar chain of links, one motor per joint, waist first.

    Attributes:
        rigid_body: file name of the links' MJCF in data/; the MuJoCo engine adds the motors.
        timestep: of the physics, s.
        gravity: m/s^2.
        column_inertia: of the first body about the vertical, kg m^2.
        shoulder: (x, z) of the first link's joint in the column's frame, m.
    """

    rigid_body: str
    timestep: Positive
    gravity: float
    column_inertia: NonNegative
    shoulder: tuple[float, float]
    links: tuple[Link, ...]
    motors: tuple[Motor, ...]
    controller: Controller

    def __post_init__(self) -> None:
        dof = len(self.motors)
        if dof != len(self.links) + 1 or dof != len(self.controller.kp) or dof != len(self.controller.kd):
            raise ValueError("an arm needs one motor, one kp and one kd for the waist and for each link")
        if self.motors[0].fixed is not None or any(m.fixed is None for m in self.motors[1:]):
            raise ValueError("the first motor sits on the waist's hinge, the others are linear actuators")


def plant_names(folder: Path = DATA) -> tuple[str, ...]:
    """Names of the simulated arms."""
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def load_parameters(name: str, folder: Path = DATA) -> ArmParameters:
    """Parameters of the plant `name`; a file with `base` states only what differs from that plant.

    Raises:
        UsageError: no such file, not TOML, unknown key, or an impossible value.
    """
    try:
        return msgspec.convert(_table(name, folder), ArmParameters)
    except (OSError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise UsageError(
            f"the plant parameters cannot be used: {error}",
            where=str(folder / f"{name}.toml"),
            next_step="Compare with arm4.toml, which is complete.",
        ) from error


def _table(name: str, folder: Path) -> dict[str, Any]:
    table = tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))
    base = table.pop("base", None)
    return table if base is None else _merge(_table(base, folder), table)


def _merge(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Base with changes; motors are matched by joint, everything else is replaced as a whole."""
    changed = {motor["joint"]: motor for motor in changes.get("motors", [])}
    unknown = changed.keys() - {motor["joint"] for motor in base["motors"]}
    if unknown:
        raise msgspec.ValidationError(f"motors of unknown joints {sorted(unknown)}")
    motors = [motor | changed.get(motor["joint"], {}) for motor in base["motors"]]
    return base | changes | {"motors": motors}
