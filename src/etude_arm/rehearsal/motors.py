"""Drives of a simulated robot at the joints, with defaults for values that the owner does not state.

With M the diagonal of the mass matrix over random poses, G the torque against gravity, and the limits tau of
torque, V of speed and A of acceleration:

    armature   the file's, or max(0.15 median M, tau / 500), at most max(tau / (3 A), 0.15 median M)
    friction   Coulomb 0.03 tau, viscous 0.03 tau / V, static 1.3 times Coulomb, Stribeck speed 0.02 rad/s
    LuGre      sigma_0 = Coulomb / 2 mrad, sigma_1 = 0.6 sqrt(sigma_0 (least M + armature))
    Kp         the larger of load / 1.5 deg and (10 rad/s)^2 (greatest M + armature), with
               load = q95 |G| + Coulomb + viscous V / 2 + (0.3 armature + 0.5 median M) A
    Kd         1.8 sqrt(Kp (greatest M + armature))

so that the feedback alone tracks to about 1.5 deg: |e| <= |tau_fb| / Kp. Lengths of slides are a tenth of a
hinge's angles in rad. With the loop outside a torque is held for a tick, and the limit is the smallest
apparent inertia of a joint: Kd <= 0.8 M_apparent rate, Kp <= 0.2 rate Kd, and
Kp / M <= (0.35 / (1.5 / rate + delay))^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from etude.types import Array
from etude_arm.memory import bristles_along
from etude_arm.rehearsal.body import rows
from etude_arm.rehearsal.overlay import MotorTable, Simulate
from etude_arm.spec import FORCES, ArmSpec

if TYPE_CHECKING:
    import mujoco

WANTED = math.radians(1.5)
"""rad: deflection of a joint by its load."""
BRISTLE = 0.002
"""rad at which LuGre's bristles hold Coulomb friction."""
STRIBECK = 0.02
"""rad/s"""
NO_LOAD_FACTOR = 2.0
"""Speed without load of a motor that is given volts or pwm, in parts of the velocity limit."""
VOLTAGES = ("V", "pwm")


@dataclass(frozen=True, eq=False)
class Motors:
    """All drives, seen from the joints; (J,) each, in N m, rad and s (N, m).

    Attributes:
        armature, coulomb, static, viscous, stribeck, stiffness, micro_damping: see `overlay.MotorTable`.
        torque: at the largest command, at rest.
        gain: torque for one unit of command; braking: torque that a unit of speed costs a motor given volts.
        kp, kd: of the feedback, N m/rad and N m s/rad.
        tick: resolution of the encoder, rad.
    """

    armature: Array
    coulomb: Array
    static: Array
    viscous: Array
    stribeck: Array
    stiffness: Array
    micro_damping: Array
    torque: Array
    gain: Array
    braking: Array
    kp: Array
    kd: Array
    tick: Array

    def rougher(self, factor: float) -> Motors:
        """With Coulomb, static and viscous friction times `factor`."""
        rough = {name: factor * getattr(self, name) for name in ("coulomb", "static", "viscous")}
        return replace(self, **rough)

    def friction(self, qd: Array, kind: str) -> Array:
        """Steady friction and braking (T, J) at qd (T, J), N m; none of Coulomb's at rest."""
        level = self._stribeck_level(qd) if kind == "lugre" else self.coulomb
        dry = 0.0 if kind == "none" else np.sign(qd) * level
        return np.asarray(dry + (self.viscous + self.braking) * qd)

    def bristles(self, q: Array, qd: Array) -> Array:
        """LuGre friction and braking (T, J) along a motion from rest, N m (Canudas de Wit 1995, eq. 1 to 4).

        At the speed of each row, its bristles deflect over the distance from the previous row.
        """
        # 1e-9 N m (N): avoids a division by zero without friction
        bend = np.maximum(self._stribeck_level(qd), 1e-9) / self.stiffness
        bent = bristles_along(q, bend)
        rate = qd - np.abs(qd) * bent / bend
        force = self.stiffness * bent + self.micro_damping * rate
        return np.asarray(force + (self.viscous + self.braking) * qd)

    def _stribeck_level(self, qd: Array) -> Array:
        """(T, J) at which friction slips: static at rest, Coulomb's at speed, N m."""
        return np.asarray(self.coulomb + (self.static - self.coulomb) * np.exp(-((qd / self.stribeck) ** 2)))


class StatedValues:
    """The owner's values of the drives at the joints; defaults for the others."""

    def __init__(self, spec: ArmSpec) -> None:
        tables = {table.name: table for table in spec.motors}
        self.tables = [tables.get(name, MotorTable(name=name)) for name in spec.names]

    def __call__(self, name: str, default: Array) -> Array:
        stated = [table.at_joint(name) for table in self.tables]
        return np.array([d if s is None else s for s, d in zip(stated, default.tolist(), strict=True)])

    @property
    def tick(self) -> Array:
        return np.array([2.0 * math.pi / 2**table.encoder_bits / table.gear for table in self.tables])


def torque_limit(spec: ArmSpec, stated: Mapping[str, Array], gravity: Array) -> Array:
    """(J,) N m at the largest command: the owner's value, the command limit, the file's effort, or 3 times
    the largest torque against gravity."""
    if spec.command_unit in FORCES:
        return StatedValues(spec)("torque", spec.command)
    limit = np.where(np.isfinite(stated["effort"]), stated["effort"], 3.0 * np.abs(gravity).max(axis=0))
    return StatedValues(spec)("torque", limit)


def armature_of(spec: ArmSpec, stated: Mapping[str, Array], median: Array, torque: Array) -> Array:
    """(J,) kg m^2 of the rotors at the joints."""
    floor = 0.15 * median
    assumed = np.minimum(
        np.maximum(floor, torque / 500.0), np.maximum(torque / (3.0 * spec.acceleration), floor)
    )
    return StatedValues(spec)("armature", np.where(stated["armature"] > 0.0, stated["armature"], assumed))


POSES = 300  # over which a robot's inertia and gravity are averaged
SEED = 0
"""Seed of the poses: the same for every robot."""


@dataclass(frozen=True, eq=False)
class Scales:
    """Over random poses within the limits, (J,) each.

    Attributes:
        inertia: (POSES, J) the diagonal of the mass matrix, kg m^2 (kg), without armature.
        apparent: the least inertia at a joint with the others free, 1 / (M^-1)_jj, with `armature`.
        gravity: (POSES, J) torque that holds the pose, N m (N).
    """

    inertia: Array
    apparent: Array
    gravity: Array

    @property
    def median(self) -> Array:
        return np.asarray(np.median(self.inertia, axis=0))


def scales_of(model: mujoco.MjModel, spec: ArmSpec, armature: Array) -> Scales:
    """Scales of a model without armature; `apparent` includes `armature` (J,)."""
    import mujoco

    data, dofs = mujoco.MjData(model), rows(model, spec)
    poses = np.random.default_rng(SEED).uniform(spec.lower, spec.upper, (POSES, spec.dof))
    inertia, gravity, apparent = np.empty((3, POSES, spec.dof))
    M = np.empty((model.nv, model.nv))
    for k, q in enumerate(poses):
        data.qpos[dofs] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        full = M[np.ix_(dofs, dofs)]
        inertia[k], gravity[k] = np.diag(full), data.qfrc_bias[dofs] - data.qfrc_passive[dofs]
        apparent[k] = 1.0 / np.diag(np.linalg.inv(full + np.diag(armature)))
    return Scales(inertia, apparent.min(axis=0), gravity)


def effort(model: mujoco.MjModel, spec: ArmSpec, motion: tuple[Array, Array, Array]) -> Array:
    """(T, J) torque of bodies and rotors along q, qd, qdd (T, J each), by `mj_inverse`; no friction."""
    import mujoco

    data, dofs = mujoco.MjData(model), rows(model, spec)
    torques = np.empty_like(motion[0])
    for k, (q, qd, qdd) in enumerate(zip(*motion, strict=True)):
        data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse[dofs]
    return torques


def motors_of(spec: ArmSpec, loop: Simulate, scales: Scales, torque: Array, armature: Array) -> Motors:
    """Every drive; `loop` is settled (`settled`)."""
    value_of, size = StatedValues(spec), spec.presliding(1.0)
    coulomb = value_of("coulomb", 0.03 * torque)
    viscous = value_of("viscous", 0.03 * torque / spec.velocity)
    stiffness = value_of("stiffness", np.maximum(coulomb, 1e-9) / (BRISTLE * size))
    least = scales.inertia.min(axis=0) + armature
    braking = np.zeros(spec.dof)
    if spec.command_unit in VOLTAGES:
        braking = torque / value_of("no_load", NO_LOAD_FACTOR * spec.velocity)
    kp, kd = gains(spec, loop, scales, armature, coulomb, viscous + braking)
    return Motors(
        armature=armature,
        coulomb=coulomb,
        static=np.maximum(value_of("static", 1.3 * coulomb), coulomb),
        viscous=viscous,
        stribeck=value_of("stribeck", STRIBECK * size),
        stiffness=stiffness,
        micro_damping=value_of("micro_damping", 0.6 * np.sqrt(stiffness * least)),
        torque=torque,
        gain=np.ones(spec.dof) if spec.command_unit in FORCES else torque / spec.command,
        braking=braking,
        kp=kp,
        kd=kd,
        tick=value_of.tick,
    )


def gains(
    spec: ArmSpec, loop: Simulate, scales: Scales, armature: Array, coulomb: Array, drag: Array
) -> tuple[Array, Array]:
    """Kp and Kd (J,) of the feedback, N m/rad and N m s/rad."""
    value_of, heaviest = StatedValues(spec), scales.inertia.max(axis=0) + armature
    load = np.quantile(np.abs(scales.gravity), 0.95, axis=0) + coulomb + 0.5 * drag * spec.velocity
    load = load + (0.3 * armature + 0.5 * scales.median) * spec.acceleration
    kp = np.maximum(load / (WANTED * spec.presliding(1.0)), 100.0 * heaviest)
    rate, delay = (1.0 / loop.timestep, 0.0) if loop.loop == "inside" else (spec.rate, loop.delay)
    kp = np.minimum(kp, heaviest * (0.35 / (1.5 / rate + delay)) ** 2)
    kd = 1.8 * np.sqrt(kp * heaviest)
    if loop.loop == "outside":
        kd = np.minimum(kd, 0.8 * scales.apparent * rate)
        kp = np.minimum(kp, 0.2 * rate * kd)
    return value_of("kp", kp), value_of("kd", kd)
