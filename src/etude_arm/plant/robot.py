"""ArmRobot: a simulated arm that follows a trajectory and returns a Log, with changes and faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from msgspec.structs import replace as struct_replace

from etude.errors import UsageError
from etude.types import Array
from etude_arm.plant.feedback_loop import Following
from etude_arm.plant.parameters import ArmParameters, load_parameters, plant_names
from etude_arm.plant.trace import LoopInputs, Running, Trace
from etude_arm.spec import ArmSpec

Engine = Literal["compiled", "mujoco"]


def with_payload(arm: ArmParameters, mass: float) -> ArmParameters:
    """The arm with a point mass (kg) at the end of its last link.

    Raises:
        UsageError: a mass below zero or not finite.
    """
    if not (math.isfinite(mass) and mass >= 0.0):
        raise UsageError(f"a payload of {mass} kg is not possible", next_step="Give 0 kg or more.")
    hand = arm.links[-1]
    total = hand.mass + mass
    center = (hand.mass * hand.center + mass * hand.length) / total
    shift, reach = center - hand.center, hand.length - center
    across = hand.inertia_across + hand.mass * shift**2 + mass * reach**2  # parallel axes
    loaded = struct_replace(hand, mass=total, center=center, inertia_across=across)
    return struct_replace(arm, links=(*arm.links[:-1], loaded))


def with_friction(arm: ArmParameters, factor: float) -> ArmParameters:
    """The arm with Coulomb, static and viscous friction of every motor times `factor`.

    Raises:
        UsageError: a factor that is not a positive number.
    """
    if not (math.isfinite(factor) and factor > 0.0):
        raise UsageError(f"friction cannot change by a factor of {factor}", next_step="Give a positive one.")
    motors = tuple(
        struct_replace(m, coulomb=factor * m.coulomb, static=factor * m.static, viscous=factor * m.viscous)
        for m in arm.motors
    )
    return struct_replace(arm, motors=motors)


@dataclass(frozen=True, eq=False)
class ArmRobot(Following):
    """A simulated arm under its own PD control (implements `protocols.Robot`).

    Attributes:
        name: the plant's name.
        spec: description by its owner.
        parameters: its true parameters.
        engine: "compiled", or "mujoco", independent of it; they agree to 0.001 deg over a minute.
        lead_in: s at rest in the first desired position before t = 0, kept in the log.
        sensor: (J,) offset of the logged command, command units; (): none.
    """

    name: str
    spec: ArmSpec
    parameters: ArmParameters
    engine: Engine = "compiled"
    lead_in: float = 2.0
    sensor: tuple[float, ...] = ()

    @property
    def physics(self) -> ArmParameters:
        return self.parameters

    @property
    def deviation(self) -> float:
        """Of the encoder's noise, rad."""
        return self.parameters.controller.encoder_noise

    def altered(self, name: str, value: float) -> ArmRobot:
        parameters = {"payload": with_payload, "friction": with_friction}[name](self.parameters, value)
        return replace(self, parameters=parameters)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        from etude_arm.plant.compiled import inverse

        for name, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
            self.check(name, rows, len(q))
        return inverse(self.parameters, q, qd, qdd)

    @property
    def substeps(self) -> int:
        return round(1.0 / (self.spec.rate * self.parameters.timestep))

    def whole(self, inputs: LoopInputs) -> Trace:
        """One engine's closed loop; its heavy package is imported only when chosen."""
        if self.engine == "mujoco":
            from etude_arm.plant.mujoco_engine import simulate as simulate_in_mujoco

            return simulate_in_mujoco(self.parameters, inputs)
        from etude_arm.plant.compiled import simulate

        return simulate(self.parameters, inputs)

    def begin(self, q: Array) -> Running:
        if self.engine != "compiled":
            raise UsageError(
                "this engine runs a trajectory as a whole only", where=self.name, next_step='Use "compiled".'
            )
        from etude_arm.plant.compiled import RunningArm

        return RunningArm(self.parameters, q)


def simulated_robot(name: str, spec: ArmSpec, engine: Engine = "compiled") -> ArmRobot:
    """The arm with the parameters of `plant/data/NAME.toml` and the description `spec`.

    Raises:
        UsageError: unknown plant or engine, other joints, or a rate that does not divide that of the physics.
    """
    if name not in plant_names():
        raise UsageError(
            f"there is no simulated robot {name!r}", next_step=f"Choose one of: {', '.join(plant_names())}."
        )
    if engine not in ("compiled", "mujoco"):
        raise UsageError(f"there is no engine {engine!r}", next_step="Choose one of: mujoco, compiled.")
    parameters = load_parameters(name)
    _check_spec(name, spec, parameters)
    return ArmRobot(name, spec, parameters, engine)


def _check_spec(name: str, spec: ArmSpec, arm: ArmParameters) -> None:
    joints = tuple(motor.joint for motor in arm.motors)
    if spec.names != joints:
        raise UsageError(
            f"the robot's joints {', '.join(spec.names)} are not those of the plant {name}",
            where=spec.name,
            next_step=f"Name them {', '.join(joints)}, in this order.",
        )
    steps = 1.0 / (spec.rate * arm.timestep)
    # rates in files are rounded: 1e-6 of a step counts as a whole step
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise UsageError(
            f"a control rate of {spec.rate:g} Hz is no multiple of the plant's time step {arm.timestep:g} s",
            where=spec.name,
            next_step="Choose a rate such as 100 Hz.",
        )
