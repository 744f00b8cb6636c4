"""Physical parameters of a simulated quadrotor, from `data/plants/NAME.toml`; the code has none."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude_quadrotor.vehicle import Vehicle

DATA = Path(__file__).parent.parent / "data" / "plants"
Array = NDArray[np.float64]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Vector = tuple[float, float, float]
Four = tuple[Positive, Positive, Positive, Positive]


class Frame(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body: mass kg, inertia (3,) kg m^2 about x, y, z with locked rotors, arm m."""

    mass: Positive
    inertia: tuple[Positive, Positive, Positive]
    arm: Positive


class Rotor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """radius m; thrust kf W^2, N s^2; drag torque kq W^2, N m s^2."""

    radius: Positive
    thrust_constant: Positive
    torque_constant: Positive


class MotorData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """L di/dt = V - R i - Ke W and Jr dW/dt = Ke i - kq W^2, seen at the rotor; L may be 0."""

    resistance: Positive
    inductance: NonNegative
    constant: Positive
    inertia: Positive
    voltage_limit: Positive


class Air(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Aerodynamics; what is 0 is switched off.

    Attributes:
        drag: (3,) linear, body frame, N s/m; these are the true coefficients.
        quadratic: force -quadratic |v| v, N s^2/m^2.
        flapping: tilt of the rotor disc over advance ratio v / (W R), rad.
        hub: stiffness of a tilted disc against the body, N m/rad.
        inflow: share of the thrust lost per axial advance ratio v_z / (W R).
        body_lift, lowest: K_b, and the height below which the ground effect is held, m.
    """

    drag: tuple[NonNegative, NonNegative, NonNegative]
    lowest: Positive
    body_lift: NonNegative = 2.0
    quadratic: NonNegative = 0.0
    flapping: NonNegative = 0.0
    hub: NonNegative = 0.0
    inflow: NonNegative = 0.0
    ground_effect: bool = True


class Payload(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A point of `mass` kg at `place` (body frame, from the centre of the clean vehicle, m)."""

    mass: NonNegative = 0.0
    place: Vector = (0.0, 0.0, 0.0)


class Mismatch(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Factors on the constants of each rotor and motor."""

    thrust: Four = (1.0, 1.0, 1.0, 1.0)
    torque: Four = (1.0, 1.0, 1.0, 1.0)
    constant: Four = (1.0, 1.0, 1.0, 1.0)
    resistance: Four = (1.0, 1.0, 1.0, 1.0)


class ControlData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The vehicle's own controller, thesis 4.1: cascades of PID and PD; see `core.Control`."""

    inputs: Literal["voltage", "set_points"]
    position_rate: Positive
    position_xy: tuple[NonNegative, NonNegative, NonNegative]
    position_z: tuple[NonNegative, NonNegative, NonNegative]
    clip: Annotated[float, msgspec.Meta(gt=0.0, lt=9.81)]
    tilt: Annotated[float, msgspec.Meta(gt=0.0, lt=1.5)]
    attitude: tuple[Positive, NonNegative]
    yaw: tuple[Positive, Positive]
    full_tilt: Positive = 1.0
    full_yaw_rate: Positive = 1.0
    full_thrust: Positive = 1.0


class FlightParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One simulated vehicle; `noise`: level -> deviations of acceleration and angular acceleration."""

    contact_height: NonNegative
    body: Frame
    rotor: Rotor
    motor: MotorData
    air: Air
    noise: dict[str, tuple[NonNegative, NonNegative]]
    control: ControlData
    payload: Payload = Payload()
    mismatch: Mismatch = Mismatch()

    @property
    def nominal(self) -> Vehicle:
        """The nominal vehicle that the owner knows, without payload and mismatch."""
        return Vehicle(
            mass=self.body.mass,
            inertia=self.body.inertia,
            arm=self.body.arm,
            thrust_constant=self.rotor.thrust_constant,
            torque_constant=self.rotor.torque_constant,
            motor_constant=self.motor.constant,
            resistance=self.motor.resistance,
            rotor_inertia=self.motor.inertia,
            voltage_limit=self.motor.voltage_limit,
        )

    @property
    def drag_per_mass(self) -> Array:
        """(3,) true linear drag over true mass, 1/s: the coefficients that planning by flatness takes."""
        return np.array(self.air.drag) / (self.body.mass + self.payload.mass)


def load_flight_parameters(name: str, folder: Path = DATA) -> FlightParameters:
    """Parameters of the vehicle `name`; a file with `base` states only the keys that differ from that one.

    Raises:
        UsageError: no such file, not TOML, unknown key, or an impossible value.
    """
    try:
        return msgspec.convert(_table(name, folder), FlightParameters)
    except (OSError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise UsageError(
            f"the vehicle's parameters cannot be used: {error}",
            where=str(folder / f"{name}.toml"),
            next_step="Compare with quadrotor.toml, which is complete.",
        ) from error


def _table(name: str, folder: Path) -> dict[str, Any]:
    table = tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))
    base = table.pop("base", None)
    return table if base is None else _merged(_table(base, folder), table)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes`, table by table and key by key."""
    both = {
        key: base[key] | value if isinstance(value, dict) and key in base else value
        for key, value in changes.items()
    }
    return base | both
