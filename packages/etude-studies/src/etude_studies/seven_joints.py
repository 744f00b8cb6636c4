"""An arm of seven joints, of the size of a light industrial one, that follows its motion exactly.

Its logs are computed, not simulated: the rigid body's torques along the motion, friction in every joint,
noise of encoders and of torques. The model's inputs do not hold the friction exactly: it has a Stribeck bend.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from etude.errors import UsageError
from etude.protocols import Mean, Trajectory
from etude.types import Array, Log
from etude_studies.world import World

AXES = ("0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1")
RATE = 100.0


@dataclass(frozen=True)
class Built:
    """How an arm is built.

    Attributes:
        links: of each, metres to the next joint, kilograms, torque limit N m.
        lower, upper: position limits, rad. velocity, acceleration: of each joint, rad/s and rad/s^2.
        rough: friction varies by that part with the position, and torque ripples by a twentieth of it as a
            part of the limit: no inputs hold either.
    """

    links: tuple[tuple[float, float, float], ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    rough: float = 0.0

    @property
    def limit(self) -> Array:
        """(7,) N m."""
        return np.array([row[2] for row in self.links])


REACH = (2.9, 2.0, 2.9, 2.0, 2.9, 2.0, 3.0)
LIGHT = Built(
    (
        (0.18, 4.0, 300.0),
        (0.20, 4.0, 300.0),
        (0.20, 3.0, 180.0),
        (0.20, 2.7, 180.0),
        (0.20, 1.7, 110.0),
        (0.10, 1.8, 40.0),
        (0.05, 0.4, 40.0),
    ),
    tuple(-r for r in REACH),
    REACH,
    (1.0,) * 7,
    (2.5,) * 7,
)
PANDA_LIKE = Built(
    (
        (0.17, 3.0, 87.0),
        (0.16, 2.8, 87.0),
        (0.19, 2.6, 87.0),
        (0.19, 2.4, 87.0),
        (0.20, 2.2, 12.0),
        (0.09, 1.4, 12.0),
        (0.10, 0.6, 12.0),
    ),
    (-2.90, -1.76, -2.90, -3.07, -2.90, -0.02, -2.90),
    (2.90, 1.76, 2.90, -0.07, 2.90, 3.75, 2.90),
    (2.17, 2.17, 2.17, 2.17, 2.61, 2.61, 2.61),
    (7.5,) * 7,
    rough=0.4,
)
"""Limits and masses of the size of a common cobot's; accelerations are half of what its maker allows."""

COULOMB, STRIBECK, VISCOUS = 0.02, 0.05, 0.02
"""Friction in parts of the torque limit; the Stribeck speed, rad/s."""
ENCODER, TORQUE = 2e-5, 2e-3
"""Noise: rad, and part of the torque limit."""


@dataclass(frozen=True)
class SevenJoints:
    """Stands in for a simulated robot: `run`, `inverse`, `changed`. payload in kg at the flange; sensor (7,),
    N m, what the logged torques read too much.
    """

    payload: float = 0.0
    friction: float = 1.0
    sensor: tuple[float, ...] = (0.0,) * 7
    built: Built = LIGHT

    @cached_property
    def world(self) -> World:
        """As its owner knows it: without a load."""
        return described(0.0, self.built)

    def changed(self, **what: float) -> SevenJoints:
        """The arm with another `payload` (kg), `friction` so many times as large, or so many N m added to the
        logged torque of a joint (`sensor_j1`).
        """
        offsets = {f"sensor_j{i + 1}": value for i, value in enumerate(self.sensor)}
        if not what.keys() <= {"payload", "friction", *offsets}:
            raise UsageError(f"the arm of seven joints cannot change its {', '.join(what)}")
        sensor = tuple(what.get(name, value) for name, value in offsets.items())
        load, friction = (what.get(n, getattr(self, n)) for n in ("payload", "friction"))
        return replace(self, payload=load, friction=friction, sensor=sensor)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, 7) torques, N m, of the body and its friction."""
        world = described(self.payload, self.built)
        states = {"q": q, "qd": qd, "qdd": qdd}
        channels = {c.name: c for c in world.kind.channels(world.spec)}
        log = Log(np.arange(len(q)) / RATE, {n: channels[n] for n in states}, states)
        return np.asarray(body(self.payload, self.built).predict(log) + self.friction_at(q, qd))

    def friction_at(self, q: Array, qd: Array) -> Array:
        """(T, 7) N m, ripple of the torque included."""
        limit, rough = self.built.limit, self.built.rough
        bend = (1.0 + 0.5 * np.exp(-((qd / STRIBECK) ** 2))) * (1.0 + rough * np.sin(3.0 * q))
        rub = self.friction * limit * (COULOMB * np.tanh(qd / 0.01) * bend + VISCOUS * qd)
        return np.asarray(rub + 0.05 * rough * limit * np.sin(8.0 * q))

    def run(self, motion: Trajectory, controller: None, rng: np.random.Generator) -> Log:  # noqa: ARG002
        """A log of the motion at 100 Hz."""
        t = np.arange(0.0, motion.duration, 1.0 / RATE)
        q, qd, qdd = motion.motion(t, 3).orders
        channels = {c.name: c for c in self.world.kind.channels(self.world.spec)}
        noise = TORQUE * self.built.limit * rng.standard_normal(q.shape)
        command = self.inverse(q, qd, qdd) + noise + self.sensor
        values = {"q": q + ENCODER * rng.standard_normal(q.shape), "command": command}
        return Log(t, {n: channels[n] for n in values}, values, "seven joints")


@cache
def described(payload: float, built: Built = LIGHT) -> World:
    """The arm with that load, kg, from files as somebody would write them."""
    folder = Path(tempfile.mkdtemp(prefix="seven_joints_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)  # physics read it again
    (folder / "seven.xml").write_text(mjcf(payload, built))
    (folder / "seven.toml").write_text(robot_toml(built))
    return World.of(folder / "seven.toml")


@cache
def body(payload: float, built: Built = LIGHT) -> Mean:
    """The rigid body's torques."""
    world = described(payload, built)
    return world.kind.physics(world.spec, world.config)["nominal"](None)


def mjcf(payload: float, built: Built) -> str:
    """The chain of links along z, each of a rod's inertia; the load is a point at the flange."""
    opened, links = [], built.links
    for i, (length, mass, _) in enumerate(links):
        place = links[i - 1][0] if i else 0.15
        across = mass * (length**2 / 12.0 + 0.05**2 / 4.0)
        along = mass * 0.05**2 / 2.0
        opened.append(
            f'<body name="link{i + 1}" pos="0 0 {place}">'
            f'<joint name="j{i + 1}" type="hinge" axis="{AXES[i]}" '
            f'range="{built.lower[i]} {built.upper[i]}"/>'
            f'<inertial pos="0.01 0.02 {length / 2}" mass="{mass}" '
            f'diaginertia="{across} {across} {along}"/>'
        )
    tiny = 1e-6
    load = (
        f'<body name="load" pos="0.03 0 {links[-1][0] + 0.05}"><inertial pos="0 0 0" mass="{payload + tiny}" '
        f'diaginertia="{tiny} {tiny} {tiny}"/></body>'
    )
    chain = "".join(opened) + load + "</body>" * len(links)
    return f'<mujoco model="seven"><compiler angle="radian"/><worldbody>{chain}</worldbody></mujoco>\n'


def robot_toml(built: Built) -> str:
    """The robot file: limits and the model file beside it."""
    head = f'name = "seven"\ncommand_unit = "N m"\nrate = {RATE}\nmodel_file = "seven.xml"\n'
    axes = (
        f'[[axis]]\nname = "j{i + 1}"\nlower = {built.lower[i]}\nupper = {built.upper[i]}\n'
        f"velocity = {built.velocity[i]}\nacceleration = {built.acceleration[i]}\n"
        f"command = {built.links[i][2]}\n"
        for i in range(len(built.links))
    )
    return head + "".join(axes)
