"""RehearsedRobot: simulation of any robot of joints from its model file, under its drives' feedback."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from etude.errors import UsageError
from etude.types import Array
from etude_arm.plant.feedback_loop import Following
from etude_arm.plant.trace import LoopInputs, Running, Trace
from etude_arm.rehearsal.body import bare_body, from_file, stated_of_drives
from etude_arm.rehearsal.drive_model import RunParameters
from etude_arm.rehearsal.motors import Motors, Scales, armature_of, effort, motors_of, scales_of, torque_limit
from etude_arm.rehearsal.overlay import Simulate
from etude_arm.spec import FORCES, ArmSpec


@dataclass(frozen=True, eq=False)
class RehearsedRobot(Following):
    """A robot simulated from its model file and its drives (implements `protocols.Robot`).

    Attributes:
        parameters: its bodies, loop, drives and payload.
        assumed: one sentence for each assumption, with the figures.
        lead_in: s at rest in the first desired position before t = 0, kept in the log.
        sensor: (J,) offset of the logged command, command units; (): none.
    """

    parameters: RunParameters
    assumed: tuple[str, ...] = ()
    lead_in: float = 2.0
    sensor: tuple[float, ...] = ()

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.spec.name

    @property
    def spec(self) -> ArmSpec:  # type: ignore[override]
        return self.parameters.spec

    @property
    def physics(self) -> RunParameters:
        return self.parameters

    @property
    def substeps(self) -> int:
        return round(1.0 / (self.spec.rate * self.parameters.loop.timestep))

    @property
    def deviation(self) -> Array:
        return self.parameters.loop.encoder_noise * self.parameters.motors.tick

    def whole(self, inputs: LoopInputs) -> Trace:
        return self.begin(inputs.q_des[0]).advance(inputs)

    def begin(self, q: Array) -> Running:
        from etude_arm.rehearsal.drive_model import RehearsedRun

        return RehearsedRun(self.parameters, q)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        parameters, torque = self.parameters, self._frictionless(q, qd, qdd)
        return np.asarray(
            (torque + parameters.motors.friction(qd, parameters.loop.friction)) / parameters.motors.gain
        )

    def inverse_along(self, q: Array, qd: Array, qdd: Array) -> Array:
        """With bristles that deflect and slip along the motion; `inverse` has steady friction instead."""
        if self.parameters.loop.friction != "lugre":
            return self.inverse(q, qd, qdd)
        torque = self._frictionless(q, qd, qdd)
        return np.asarray((torque + self.parameters.motors.bristles(q, qd)) / self.parameters.motors.gain)

    def _frictionless(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, J) N m of bodies and rotors along the motion."""
        for name, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
            self.check(name, rows, len(q))
        return effort(self.parameters.rigid, self.parameters.spec, (q, qd, qdd))

    def altered(self, name: str, value: float) -> RehearsedRobot:
        if not (math.isfinite(value) and (value > 0.0 or (value == 0.0 and name == "payload"))):
            raise UsageError(f"{name} = {value} is not possible", where=self.name)
        if name == "payload":
            return replace(self, parameters=replace(self.parameters, payload=self.parameters.payload + value))
        return replace(
            self, parameters=replace(self.parameters, motors=self.parameters.motors.rougher(value))
        )


HARD = 0.95
"""Part of the torque limit above which a motion is hardly possible."""
LARGE = 1000.0
"""Ratio of torque limit to required torque above which the limit is a placeholder."""
DEFAULTS = "Values that [simulate] and [[motor]] of robot.toml do not state are defaults."


def too_heavy(spec: ArmSpec, gravity: Array, torque: Array) -> None:
    """Refuses a robot that cannot carry its own weight, since it would fall in simulation.

    Raises:
        UsageError: naming the joints and the part of their weight that they carry.
    """
    needed = np.abs(gravity).max(axis=0)
    weak = [
        f"joint '{name}' can carry {100.0 * part:.0f} % of its own weight"
        for name, part in zip(spec.names, (torque / np.maximum(needed, 1e-12)).tolist(), strict=True)
        if part < 1.0
    ]
    if weak:
        raise UsageError(
            f"with the masses and efforts of its file {'; '.join(weak)}: it is not simulated",
            where=spec.name,
            next_step="Perhaps the arm is counterbalanced, the base is mounted differently, or a limit "
            "is wrong. Correct the command limits in robot.toml or the masses in the model file; if "
            "the limits are placeholders, state the drives' torque in [[motor]].",
        )


def sentences(
    spec: ArmSpec, loop: Simulate, motors: Motors, stated: Mapping[str, Array], scales: Scales
) -> tuple[str, ...]:
    """Sentences on the loop, each drive, unused values of the file, and limits that the drives cannot
    reach.
    """
    lines = [f"{_loop(spec, loop)} {DEFAULTS}"]
    lines += [_motor(spec, motors, j) for j in range(spec.dof)]
    unused = [
        f"{name} (damping {d:g}, friction {f:g})"
        for name, d, f in zip(
            spec.names, stated["damping"].tolist(), stated["friction"].tolist(), strict=True
        )
        if d or f
    ]
    if unused:
        lines.append(f"The file's own damping and friction are not used: {', '.join(unused)}.")
    return tuple(lines + _torque_deficits(spec, motors, scales) + _torque_excesses(spec, motors, scales))


def _loop(spec: ArmSpec, loop: Simulate) -> str:
    place = {
        "inside": f"a servo in each drive at {1.0 / loop.timestep:g} Hz",
        "outside": f"a loop at {spec.rate:g} Hz outside the drives",
    }[loop.loop]
    late = f", delay {1e3 * loop.delay:g} ms" if loop.delay else ""
    return f"The simulated {spec.name} has {place}, {loop.friction} friction{late}, no contacts."


def _motor(spec: ArmSpec, motors: Motors, j: int) -> str:
    axis = spec.axes[j]
    force = "N m" if axis.unit == "rad" else "N"
    inertia = "kg m²" if axis.unit == "rad" else "kg"
    return (
        f"{axis.name}: armature {motors.armature[j]:.3g} {inertia}, Coulomb {motors.coulomb[j]:.3g} {force}, "
        f"viscous {motors.viscous[j]:.3g} {force} s/{axis.unit}, Kp {motors.kp[j]:.4g} {force}/{axis.unit}, "
        f"Kd {motors.kd[j]:.3g} {force} s/{axis.unit}, torque {motors.torque[j]:.4g} {force}"
    )


def _torque_deficits(spec: ArmSpec, motors: Motors, scales: Scales) -> list[str]:
    """Joints whose torque is insufficient for their limits of speed and acceleration."""
    # gravity at the 95 % quantile of poses: position limits seldom allow the worst ones
    needed = np.quantile(np.abs(scales.gravity), 0.95, axis=0) + motors.coulomb
    needed = needed + (scales.median + motors.armature) * spec.acceleration + motors.viscous * spec.velocity
    parts = needed / motors.torque
    hard = [f"{name} ({p:.1f} times)" for name, p in zip(spec.names, parts.tolist(), strict=True) if p > HARD]
    if not hard:
        return []
    return [
        "At the limits of acceleration and speed these joints need more torque than they have: "
        f"{', '.join(hard)}. The robot cannot follow motions near these limits."
    ]


def _torque_excesses(spec: ArmSpec, motors: Motors, scales: Scales) -> list[str]:
    """Joints whose torque limits are far above any motion, although friction and armature depend on them."""
    # as above: the 95 % quantile of poses
    needed = np.quantile(np.abs(scales.gravity), 0.95, axis=0) + scales.median * spec.acceleration
    # a joint without load has any ratio
    parts = motors.torque / np.maximum(needed, 1e-12)
    large = [
        f"{name} ({p:.0f} times)" for name, p in zip(spec.names, parts.tolist(), strict=True) if p > LARGE
    ]
    if not large:
        return []
    return [
        f"The torque limits of {', '.join(large)} are far above the need of their fastest motions. "
        "Friction and rotors here are scaled with them: correct command in robot.toml if they are "
        "placeholders."
    ]


def rehearsed(spec: ArmSpec) -> RehearsedRobot:
    """The robot of `spec` and its model file, with defaults for values that neither states.

    Raises:
        UsageError: no loadable model file, a rate that does not divide that of the physics, or a robot that
            cannot carry its own weight.
    """
    loop, loaded = settled(spec), from_file(spec)
    stated, body = stated_of_drives(loaded, spec), bare_body(loaded, spec)
    for name in spec.names:
        body.joint(name).armature = 0.0
    model = body.compile()
    light = scales_of(model, spec, np.zeros(spec.dof))
    torque = torque_limit(spec, stated, light.gravity)
    too_heavy(spec, light.gravity, torque)
    armature = armature_of(spec, stated, light.median, torque)
    scales = replace(light, apparent=scales_of(model, spec, armature).apparent)
    motors = motors_of(spec, loop, scales, torque, armature)
    parameters = RunParameters(spec, loaded, loop, motors)
    return RehearsedRobot(parameters, sentences(spec, loop, motors, stated, scales))


def settled(spec: ArmSpec) -> Simulate:
    """The loop with "inside" or "outside" chosen. UsageError if its rate is not a multiple of the robot's."""
    loop = spec.simulate or Simulate()
    if not loop.loop:
        loop = replace(loop, loop="inside" if spec.command_unit in (*FORCES, "A") else "outside")
    steps = 1.0 / (spec.rate * loop.timestep)
    # rates in files are rounded: 1e-6 of a step counts as a whole step
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise UsageError(
            f"a rate of {spec.rate:g} Hz is not a whole number of time steps of {loop.timestep:g} s",
            where=spec.name,
            next_step="Set timestep in [simulate] to 1 / rate divided by a whole number.",
        )
    return loop
