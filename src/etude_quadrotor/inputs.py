"""Inputs of a vehicle's models: one map from states to X, for planned and measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from etude.codes import Notice, Warn
from etude.errors import DataError, UsageError
from etude.types import Array, Code, Column, Index, Log, Motion, Planned, Row, Samples
from etude_quadrotor.channels import BATTERY, PLANNED, STATES
from etude_quadrotor.flatness import ORDERS, Drag, FlatMotion, flat_motion, roll_pitch_yaw

if TYPE_CHECKING:
    from etude_quadrotor.physics.drag import DragModel

Acceleration = Literal["specific_force", "kinematic"]

SOURCES = {"specific_force": "specific_force", "kinematic": "body_acceleration"}
CHANNELS = {channel.name: channel for channel in (*STATES, BATTERY)}
OPTIONAL = ("altitude", "body_velocity")
"""Optional channels, by the configuration keys of the same name."""


@dataclass(frozen=True)
class QuadrotorInputs:
    """x = [altitude, acceleration (3), rates (3), angular acceleration (3), body velocity (3), voltage].

    Thesis 5 has (h, a, omega, alpha) with the acceleration a of the motion, which needs the attitude. The
    specific force replaces both, and the velocity determines the drag. Implements `protocols.Inputs`.

    Attributes:
        altitude: the altitude is an input.
        acceleration: "specific_force", as an accelerometer reads; "kinematic", without gravity.
        body_velocity: the velocity is an input.
        drag: (dx, dy, dz) 1/s for the lean of plans; learned by `fitted`.
        left_out: configured inputs that some flight lacks, found by `fitted`.
        battery_voltage: the battery's voltage may be an input, if flights show that it helps.
        volts: V for plans, and for logs without voltage; learned by `fitted`. None: no input.
        lateral: full drag for feedforward; None if no flight has the velocity.
        commands: number of commands.
    """

    altitude: bool = True
    acceleration: Acceleration = "specific_force"
    body_velocity: bool = True
    drag: Drag = (0.0, 0.0, 0.0)
    left_out: tuple[str, ...] = ()
    battery_voltage: bool = True
    volts: float | None = None
    lateral: DragModel | None = field(default=None, compare=False, repr=False)
    commands: int = 4

    def __post_init__(self) -> None:
        if self.acceleration not in SOURCES:
            raise UsageError(f"acceleration must be one of {', '.join(SOURCES)}, not {self.acceleration!r}")

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the channels in the order of the columns."""
        first = ("altitude",) if self.altitude else ()
        last = ("body_velocity",) if self.body_velocity else ()
        slow = () if self.volts is None else (BATTERY.name,)
        return (*first, SOURCES[self.acceleration], "rates", "angular_acceleration", *last, *slow)

    @property
    def columns(self) -> Sequence[Column]:
        """The D inputs: 9, 10, 12 or 13, and the voltage."""
        channels = [CHANNELS[name] for name in self.parts]
        return [
            (c.name, part, unit, "") for c in channels for part, unit in zip(c.parts, c.units, strict=True)
        ]

    @property
    def orders(self) -> int:
        """Orders of the motion, up to snap."""
        return ORDERS

    @property
    def rate(self) -> float:
        """0, because the inputs have no memory."""
        return 0.0

    @property
    def notes(self) -> tuple[Notice, ...]:
        """A notice if configured inputs are missing."""
        names = tuple(name.replace("_", " ") for name in self.left_out)
        return (Notice(Warn.INPUTS_MISSING, {"inputs": names}),) if names else ()

    def states(self, motion: Motion) -> Log:
        """Log of a perfect flight of the plan: states, position, and the commands of an autopilot.

        Attitude, rates and thrust are those of a vehicle with `drag` and heading 0.

        Raises:
            UnsafeTrajectoryError: the plan is singular (see `flat_motion`).
        """
        flat = flat_motion(motion, self.drag)
        log = Log(motion.t, {}, {}, "planned")
        for channel in STATES:
            log = log.put(channel, flat.states[channel.name])
        for channel, values in zip(PLANNED, _planned(flat), strict=True):
            log = log.put(channel, values)
        if self.volts is None:
            return log
        return log.put(replace(BATTERY, nominal=(self.volts,)), np.full((len(log), 1), self.volts))

    def _with_volts(self, states: Mapping[str, Array], count: int) -> Mapping[str, Array]:
        """The states, with the usual voltage if it was not measured."""
        if self.volts is None or BATTERY.name in states:
            return states
        return {**states, BATTERY.name: np.full((count, 1), self.volts)}

    def of_log(self, log: Log) -> Array:
        """X (T, D). DataError: the log lacks an input; names the option that removes it."""
        for name in self.parts:
            if name not in log and name != BATTERY.name:
                fact = f"the flight lacks its {name.replace('_', ' ')}"
                raise DataError(fact, where=log.source, next_step=WITHOUT.get(name, f"Log the {name}."))
        return self._stacked(self._with_volts(log.values, len(log)))

    def _stacked(self, states: Mapping[str, Array]) -> Array:
        return np.concatenate([states[name] for name in self.parts], axis=1)

    def plan(self, motion: Motion, keep: Index | None = None) -> Planned:
        """X (K, D) at the instants `keep`, unit gains, and the exact vector-Jacobian product through
        flatness.

        Singular samples are not refused here, because the limits of a search exclude them.
        """
        sampled = motion if keep is None else Motion(motion.t[keep], motion.orders[:, keep])
        flat = flat_motion(sampled, self.drag, check=False)

        def vjp(in_X: Array, in_gains: Array) -> Array:  # noqa: ARG001  # gains are constant
            gradient = flat.vjp(self._split(in_X))
            if keep is None:
                return gradient
            whole = np.zeros(motion.orders.shape)
            np.add.at(whole.swapaxes(0, 1), keep, gradient.swapaxes(0, 1))
            return whole

        states = self._with_volts(flat.states, len(sampled.t))
        return Planned(self._stacked(states), np.ones((len(sampled.t), self.commands)), vjp)

    def _split(self, in_X: Array) -> dict[str, Array]:
        """A gradient (K, D) by channel."""
        widths = [len(CHANNELS[name].parts) for name in self.parts]
        if in_X.shape[1] != sum(widths):
            raise UsageError(
                "a gradient in X has a column for each input", where=f"{in_X.shape}, {sum(widths)}"
            )
        return dict(zip(self.parts, np.split(in_X, np.cumsum(widths)[:-1], axis=1), strict=True))

    def step(self, row: Row, memory: Array | None) -> tuple[Array, Array]:  # noqa: ARG002
        """x (D,) of one instant; the inputs have no memory."""
        states = row if self.volts is None else {BATTERY.name: np.array([self.volts]), **row}
        return np.concatenate([states[name] for name in self.parts]), np.zeros(0)

    def rates(self, motion: Motion) -> tuple[Array, Array] | None:  # noqa: ARG002
        """None: unknown."""
        return None

    def fitted(self, samples: Samples) -> QuadrotorInputs:
        """The inputs with the drag and usual voltage of the flights, and without inputs that some flight
        lacks.
        """
        from etude_quadrotor.battery import usual_voltage
        from etude_quadrotor.physics.drag import train_drag

        missing = [name for name in OPTIONAL if getattr(self, name) and name not in samples.log]
        lateral = train_drag(samples) if "body_velocity" in samples.log else None
        return replace(
            self,
            altitude=self.altitude and "altitude" not in missing,
            body_velocity=self.body_velocity and "body_velocity" not in missing,
            left_out=tuple(dict.fromkeys([*self.left_out, *missing])),
            volts=usual_voltage(samples) if self.battery_voltage else None,
            drag=(0.0, 0.0, 0.0) if lateral is None else lateral.coefficients,
            lateral=lateral,
        )

    def arrays(self) -> Mapping[str, Array]:
        """Values set by `fitted`: inputs kept and left out as 0 or 1 for each of `OPTIONAL`, drag."""
        arrays = {
            "inputs": np.array([float(getattr(self, option)) for option in OPTIONAL]),
            "left_out": np.array([float(name in self.left_out) for name in OPTIONAL]),
            "drag": np.array(self.drag),
        }
        if self.volts is not None:
            arrays["volts"] = np.array(self.volts)
        if self.lateral is not None:
            arrays |= {f"lateral.{name}": values for name, values in self.lateral.arrays().items()}
        return arrays

    def restore(self, arrays: Mapping[str, Array]) -> QuadrotorInputs:
        """The same inputs with the values of `arrays`."""
        from etude_quadrotor.physics.drag import DragModel

        dx, dy, dz = arrays["drag"].tolist()
        altitude, body_velocity = arrays["inputs"].astype(bool).tolist()
        pairs = zip(OPTIONAL, arrays["left_out"], strict=True)
        lateral = {n.removeprefix("lateral."): v for n, v in arrays.items() if n.startswith("lateral.")}
        return replace(
            self,
            altitude=altitude,
            body_velocity=body_velocity,
            left_out=tuple(name for name, out in pairs if out),
            volts=float(arrays["volts"]) if "volts" in arrays else None,
            drag=(dx, dy, dz),
            lateral=DragModel.restored(lateral) if lateral else None,
        )

    def drag_c(self, name: str) -> Code | None:
        """C99 of the lateral force per mass (`abilities.SupportsDrag`); None without a velocity."""
        return None if self.lateral is None else self.lateral.c(name)

    def c(self, name: str) -> Code:
        """C99 of the inputs."""
        from etude_quadrotor.c99 import inputs_code

        return inputs_code(name, self)


def _planned(flat: FlatMotion) -> tuple[Array, ...]:
    """The values of `PLANNED`."""
    position, velocity, acceleration = flat.motion.orders[:3]
    attitude = roll_pitch_yaw(flat.R_world_body)
    return position, velocity, acceleration, attitude, flat.states["rates"], flat.thrust[:, None]


WITHOUT = {
    "altitude": "Set altitude = false.",
    "body_velocity": "Set body_velocity = false.",
    "body_acceleration": 'Set acceleration = "specific_force".',
}
