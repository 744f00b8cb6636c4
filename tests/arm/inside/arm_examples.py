"""Motions, energies and open-loop runs of the arm, written without looking into either engine."""

from __future__ import annotations

import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from etude.types import Motion
from etude_arm import KIND
from etude_arm.plant import compiled, mujoco_engine
from etude_arm.plant.parameters import ArmParameters
from etude_arm.plant.robot import ArmRobot, simulated_robot

Array = NDArray[np.float64]
MIDDLE = np.array([0.0, 0.7625, -1.145, 0.0])
SWING = np.array([0.7, 0.42, 0.42, 0.4])
ENGINES = ("mujoco", "compiled")


def simulated(name: str = "arm4", engine: str = "compiled") -> ArmRobot:
    """A built-in robot as its owner describes it."""
    return simulated_robot(name, KIND.spec(KIND.built_in()[name]), engine)  # type: ignore[arg-type]


class Sines:
    """One sine per joint about the middle of its range, from rest by a smooth start; a Trajectory."""

    form = "sines"

    def __init__(self, duration: float = 60.0, omega: tuple[float, ...] = (0.13, 0.21, 0.17, 0.19)) -> None:
        self.duration, self.omega = duration, np.array(omega)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        phase = t[:, None] - np.tanh(t[:, None])  # its rate starts at 0 and tends to 1
        rate = np.tanh(t[:, None]) ** 2
        bend = 2.0 * np.tanh(t[:, None]) * (1.0 - rate)
        sin, cos = np.sin(self.omega * phase), np.cos(self.omega * phase)
        q = MIDDLE + SWING * sin
        qd = SWING * self.omega * cos * rate
        qdd = SWING * self.omega * (cos * bend - self.omega * sin * rate**2)
        return Motion(t, np.stack([q, qd, qdd])[:orders])


class Swing:
    """Every joint swings about its middle at 0.6 of its range, one sine each; starts and ends at rest."""

    form = "swing"

    def __init__(self, robot: ArmRobot, duration: float = 40.0, joints: int = 4) -> None:
        self.duration = duration
        self.middle = 0.5 * (robot.spec.lower + robot.spec.upper)[:joints]
        self.width = 0.3 * (robot.spec.upper - robot.spec.lower)[:joints]
        self.omega = 2.0 * np.pi / duration * np.array([1, 2, 2, 2])[:joints]

    def motion(self, t: Array, orders: int = 3) -> Motion:
        angle = self.omega * t[:, None]
        q = self.middle - self.width * np.cos(angle)
        qd, qdd = self.width * self.omega * np.sin(angle), self.width * self.omega**2 * np.cos(angle)
        return Motion(t, np.stack([q, qd, qdd])[:orders])


def with_motors(arm: ArmParameters, **changes: object) -> ArmParameters:
    """The arm with the same fields changed in all its motors."""
    motors = tuple(msgspec.structs.replace(motor, **changes) for motor in arm.motors)
    return msgspec.structs.replace(arm, motors=motors)


def open_loop(
    engine: str, arm: ArmParameters, q: Array, v: Array, volts: Array, z: Array | None = None
) -> tuple[Array, Array, Array]:
    """Angles, rates and bristle deflections before the first and after each step, (steps + 1, dof) each."""
    z = np.zeros(4) if z is None else z
    run = _mujoco_open_loop if engine == "mujoco" else compiled.open_loop
    motion = run(arm, q, v, z, volts)
    qs, vs, zs = (np.vstack([first, rows]) for first, rows in zip((q, v, z), motion, strict=True))
    return qs, vs, zs


def _mujoco_open_loop(
    arm: ArmParameters, q: Array, v: Array, z: Array, volts: Array
) -> tuple[Array, Array, Array]:
    model = mujoco_engine.build_model(arm)
    data, friction = mujoco.MjData(model), mujoco_engine.PositionFriction(arm, model)
    data.qpos[:], data.qvel[:], data.act[:] = q, v, z
    rows = []
    for volt in volts:
        data.ctrl[:] = volt
        mujoco_engine.advance(model, data, friction, 1)
        rows.append(np.concatenate([data.qpos, data.qvel, data.act]))
    q_v_z = np.array(rows).reshape(len(volts), 3, 4)
    return q_v_z[:, 0], q_v_z[:, 1], q_v_z[:, 2]


def actuator_length(arm: ArmParameters, q: Array) -> Array:
    """(T, 4) length of each actuator: distance of its pivots, counted by the gear; the waist's angle."""
    columns = [q[:, 0]]
    origins = [arm.shoulder] + [(link.length, 0.0) for link in arm.links]
    for j, motor in enumerate(arm.motors[1:]):
        turned = np.array(motor.moving) @ [1.0, 1j] * np.exp(1j * q[:, j + 1])
        distance = np.abs(np.array(origins[j]) @ [1.0, 1j] + turned - np.array(motor.fixed) @ [1.0, 1j])
        columns.append(motor.gear * distance)
    return np.stack(columns, axis=1)


def moment_arm(arm: ArmParameters, q: Array) -> Array:
    """(T, 4) d length / d angle by the complex plane's central difference."""
    step = 1e-6
    return (actuator_length(arm, q + step) - actuator_length(arm, q - step)) / (2.0 * step)


def energy(arm: ArmParameters, q: Array, v: Array) -> Array:
    """Kinetic plus potential energy (T,) of links and rotors, from positions and their rates alone."""
    step = 1e-6
    before, after = _centres(arm, q - step * v), _centres(arm, q + step * v)
    speed = (after - before) / (2.0 * step)
    mass = np.array([link.mass for link in arm.links])
    total = 0.5 * (mass[:, None] * speed**2).sum(axis=(1, 2)) + arm.gravity * _centres(arm, q)[..., 2] @ mass
    angle, rate = np.cumsum(q[:, 1:], axis=1), np.cumsum(v[:, 1:], axis=1)
    for k, link in enumerate(arm.links):
        across = rate[:, k] ** 2 + (v[:, 0] * np.cos(angle[:, k])) ** 2
        along = (v[:, 0] * np.sin(angle[:, k])) ** 2
        total += 0.5 * (link.inertia_across * across + link.inertia_along * along)
    armature = np.array([motor.armature for motor in arm.motors])
    rotors = 0.5 * (armature * (moment_arm(arm, q) * v) ** 2).sum(axis=1)
    column: Array = 0.5 * arm.column_inertia * v[:, 0] ** 2
    return np.asarray(total + rotors + column)


def _centres(arm: ArmParameters, q: Array) -> Array:
    """(T, links, 3) centres of mass in the world."""
    angle = np.cumsum(q[:, 1:], axis=1)
    direction = np.exp(1j * angle)
    joint, rows = np.full(len(q), complex(*arm.shoulder)), []
    for k, link in enumerate(arm.links):
        rows.append(joint + link.center * direction[:, k])
        joint = joint + link.length * direction[:, k]
    plane = np.stack(rows, axis=1)
    return np.stack([plane.real * np.cos(q[:, :1]), plane.real * np.sin(q[:, :1]), plane.imag], axis=2)
