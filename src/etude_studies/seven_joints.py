"""An arm of seven joints, of the size of a light industrial one, that follows its motion exactly.

Its logs are computed, not simulated: the rigid body's torques along the motion, friction in every joint,
noise of encoders and of torques. The model's inputs do not hold the friction exactly: it has a Stribeck bend.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from etude.contracts import Array, Log, Mean, Trajectory
from etude.errors import UsageError
from etude_studies.world import World

# metres to the next joint, kilograms, torque limit N m, of each link
LINKS = (
    (0.18, 4.0, 300.0),
    (0.20, 4.0, 300.0),
    (0.20, 3.0, 180.0),
    (0.20, 2.7, 180.0),
    (0.20, 1.7, 110.0),
    (0.10, 1.8, 40.0),
    (0.05, 0.4, 40.0),
)
AXES = ("0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1")
REACH = (2.9, 2.0, 2.9, 2.0, 2.9, 2.0, 3.0)
RATE, SPEED, ACCELERATION = 100.0, 1.0, 2.5
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

    @cached_property
    def world(self) -> World:
        """As its owner knows it: without a load."""
        return described(0.0)

    def changed(self, **what: float) -> SevenJoints:
        """The arm with another `payload` (kg), `friction` so many times as large, or so many N m added to the
        logged torque of a joint (`sensor_j1`).
        """
        offsets = {f"sensor_j{i + 1}": value for i, value in enumerate(self.sensor)}
        if not what.keys() <= {"payload", "friction", *offsets}:
            raise UsageError(f"the arm of seven joints cannot change its {', '.join(what)}")
        sensor = tuple(what.get(name, value) for name, value in offsets.items())
        return replace(self, sensor=sensor, **{k: v for k, v in what.items() if k not in offsets})

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, 7) torques, N m, of the body and its friction."""
        world = described(self.payload)
        states = {"q": q, "qd": qd, "qdd": qdd}
        known = {c.name: c for c in world.kind.channels(world.spec)}
        log = Log(np.arange(len(q)) / RATE, {n: known[n] for n in states}, states)
        limit = np.array([row[2] for row in LINKS])
        bend = 1.0 + 0.5 * np.exp(-((qd / STRIBECK) ** 2))
        rub = self.friction * limit * (COULOMB * np.tanh(qd / 0.01) * bend + VISCOUS * qd)
        return np.asarray(body(self.payload).predict(log) + rub)

    def run(self, motion: Trajectory, controller: None, rng: np.random.Generator) -> Log:  # noqa: ARG002
        """A log of the motion at 100 Hz."""
        t = np.arange(0.0, motion.duration, 1.0 / RATE)
        q, qd, qdd = motion.motion(t, 3).orders
        known = {c.name: c for c in self.world.kind.channels(self.world.spec)}
        limit = np.array([row[2] for row in LINKS])
        command = self.inverse(q, qd, qdd) + TORQUE * limit * rng.standard_normal(q.shape) + self.sensor
        values = {"q": q + ENCODER * rng.standard_normal(q.shape), "command": command}
        return Log(t, {n: known[n] for n in values}, values, "seven joints")


@cache
def described(payload: float) -> World:
    """The arm with that load, kg, from files as somebody would write them."""
    folder = Path(tempfile.mkdtemp(prefix="seven_joints_"))
    (folder / "seven.xml").write_text(mjcf(payload))
    (folder / "seven.toml").write_text(robot_toml())
    return World.of(folder / "seven.toml")


@cache
def body(payload: float) -> Mean:
    """The rigid body's torques."""
    world = described(payload)
    return world.kind.physics(world.spec, world.config)["nominal"](None)


def mjcf(payload: float) -> str:
    """The chain of links along z, each of a rod's inertia; the load is a point at the flange."""
    opened = []
    for i, (length, mass, _) in enumerate(LINKS):
        place = LINKS[i - 1][0] if i else 0.15
        across = mass * (length**2 / 12.0 + 0.05**2 / 4.0)
        along = mass * 0.05**2 / 2.0
        opened.append(
            f'<body name="link{i + 1}" pos="0 0 {place}">'
            f'<joint name="j{i + 1}" type="hinge" axis="{AXES[i]}" '
            f'range="{-REACH[i]} {REACH[i]}"/><inertial pos="0.01 0.02 {length / 2}" mass="{mass}" '
            f'diaginertia="{across} {across} {along}"/>'
        )
    tiny = 1e-6
    load = (
        f'<body name="load" pos="0.03 0 {LINKS[-1][0] + 0.05}"><inertial pos="0 0 0" mass="{payload + tiny}" '
        f'diaginertia="{tiny} {tiny} {tiny}"/></body>'
    )
    chain = "".join(opened) + load + "</body>" * len(LINKS)
    return f'<mujoco model="seven"><compiler angle="radian"/><worldbody>{chain}</worldbody></mujoco>\n'


def robot_toml() -> str:
    """The robot file: limits and the model file beside it."""
    head = f'name = "seven"\ncommand_unit = "N m"\nrate = {RATE}\nmodel_file = "seven.xml"\n'
    axes = (
        f'[[axis]]\nname = "j{i + 1}"\nlower = {-REACH[i]}\nupper = {REACH[i]}\nvelocity = {SPEED}\n'
        f"acceleration = {ACCELERATION}\ncommand = {LINKS[i][2]}\n"
        for i in range(len(LINKS))
    )
    return head + "".join(axes)
