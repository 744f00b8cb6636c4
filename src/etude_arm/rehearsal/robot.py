"""RehearsedRobot: any robot of joints, made from its own model file, under the feedback of its drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.plant.following import Following
from etude_arm.plant.trace import LoopInputs, Running, Trace
from etude_arm.rehearsal.body import bare_body, from_file, said_of_drives
from etude_arm.rehearsal.model import Made
from etude_arm.rehearsal.motors import armature_of, motors_of, torque_limit
from etude_arm.rehearsal.overlay import Simulate
from etude_arm.rehearsal.scales import effort, scales_of
from etude_arm.rehearsal.words import sentences, too_heavy
from etude_arm.spec import FORCES, ArmSpec


@dataclass(frozen=True, eq=False)
class RehearsedRobot(Following):
    """A robot as its model file and its drives make it (implements `protocols.Robot`).

    Attributes:
        made: its bodies, loop, drives and payload.
        assumed: one sentence for each assumption, with the figures.
        lead_in: s at rest in the first desired position before t = 0, kept in the log.
        sensor: (J,) command units that the logged command reads too much; (): nothing.
    """

    made: Made
    assumed: tuple[str, ...] = ()
    lead_in: float = 2.0
    sensor: tuple[float, ...] = ()

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.spec.name

    @property
    def spec(self) -> ArmSpec:  # type: ignore[override]
        return self.made.spec

    @property
    def physics(self) -> Made:
        return self.made

    @property
    def substeps(self) -> int:
        return round(1.0 / (self.spec.rate * self.made.loop.timestep))

    @property
    def deviation(self) -> Array:
        return self.made.loop.encoder_noise * self.made.motors.tick

    def whole(self, inputs: LoopInputs) -> Trace:
        return self.begin(inputs.q_des[0]).advance(inputs)

    def begin(self, q: Array) -> Running:
        from etude_arm.rehearsal.loops import RehearsedRun

        return RehearsedRun(self.made, q)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        made, torque = self.made, self._frictionless(q, qd, qdd)
        return np.asarray((torque + made.motors.friction(qd, made.loop.friction)) / made.motors.gain)

    def inverse_along(self, q: Array, qd: Array, qdd: Array) -> Array:
        """With bristles that bend and slip along the way; the steady friction of `inverse` has none."""
        if self.made.loop.friction != "lugre":
            return self.inverse(q, qd, qdd)
        torque = self._frictionless(q, qd, qdd)
        return np.asarray((torque + self.made.motors.bristles(q, qd)) / self.made.motors.gain)

    def _frictionless(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, J) N m of bodies and rotors along the motion."""
        for name, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
            self.check(name, rows, len(q))
        return effort(self.made.rigid, self.made.spec, (q, qd, qdd))

    def altered(self, name: str, value: float) -> RehearsedRobot:
        if not (math.isfinite(value) and (value > 0.0 or (value == 0.0 and name == "payload"))):
            raise UsageError(f"{name} = {value} is not possible", where=self.name)
        if name == "payload":
            return replace(self, made=replace(self.made, payload=self.made.payload + value))
        return replace(self, made=replace(self.made, motors=self.made.motors.rougher(value)))


def rehearsed(spec: ArmSpec) -> RehearsedRobot:
    """The robot that `spec` and its model file describe, with defaults where both are silent.

    Raises:
        UsageError: no model file or one that cannot be loaded, a rate that the physics cannot keep, or a
            robot that cannot carry its own weight.
    """
    loop, loaded = settled(spec), from_file(spec)
    said, body = said_of_drives(loaded, spec), bare_body(loaded, spec)
    for name in spec.names:
        body.joint(name).armature = 0.0
    model = body.compile()
    light = scales_of(model, spec, np.zeros(spec.dof))
    torque = torque_limit(spec, said, light.gravity)
    too_heavy(spec, light.gravity, torque)
    armature = armature_of(spec, said, light.median, torque)
    scales = replace(light, felt=scales_of(model, spec, armature).felt)
    motors = motors_of(spec, loop, scales, torque, armature)
    made = Made(spec, loaded, loop, motors)
    return RehearsedRobot(made, sentences(spec, loop, motors, said, scales))


def settled(spec: ArmSpec) -> Simulate:
    """The loop with its place decided. UsageError if its rate is no multiple of the robot's."""
    loop = spec.simulate or Simulate()
    if not loop.loop:
        loop = replace(loop, loop="inside" if spec.command_unit in (*FORCES, "A") else "outside")
    steps = 1.0 / (spec.rate * loop.timestep)
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise UsageError(
            f"a rate of {spec.rate:g} Hz is no whole number of time steps of {loop.timestep:g} s",
            where=spec.name,
            next_step="Set timestep in [simulate] to a whole part of 1 / rate.",
        )
    return loop
