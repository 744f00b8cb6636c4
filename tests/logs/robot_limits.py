"""Limits of real and built-in robots, and random motions that use them, at rest at both ends or not."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import etude
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory, suited_to
from etude.types import Array, Channel

# (lower, upper, velocity) by joint, in rad and rad/s, from the URDF files of the package example-robot-data
# 6.0.0 (PyPI; BSD-3-Clause), which ships the makers' descriptions.
URDF_LIMITS = {
    "ur5": [*[(-3.1416, 3.1416, 3.15)] * 3, *[(-3.1416, 3.1416, 3.2)] * 3],
    "ur10": [*[(-6.2832, 6.2832, 2.16)] * 2, (-3.1416, 3.1416, 3.15), *[(-6.2832, 6.2832, 3.2)] * 3],
    "panda": [
        *[(-2.8973, 2.8973, 2.175), (-1.7628, 1.7628, 2.175), (-2.8973, 2.8973, 2.175)],
        *[(-3.0718, -0.0698, 2.175), (-2.8973, 2.8973, 2.61), (-0.0175, 3.7525, 2.61)],
        (-2.8973, 2.8973, 2.61),
    ],
    "talos_left_arm": [
        *[(0.0, 2.8798, 3.66), (-2.4435, 2.4435, 4.58), (-2.3562, 0.0, 4.58), (-2.5307, 2.5307, 1.95)],
        *[(-1.3963, 1.3963, 1.76), (-0.6981, 0.6981, 1.76), (-1.0472, 0.0, 1.0)],
    ],
    "z1": [
        *[(-2.618, 2.618, 3.1415), (0.0, 2.9671, 3.1415), (-2.8798, 0.0, 3.1415)],
        *[(-1.5184, 1.5184, 3.1415), (-1.3439, 1.3439, 3.1415), (-2.7925, 2.7925, 3.1415)],
    ],
    "xarm7": [
        *[(-6.2832, 6.2832, 3.14), (-2.059, 2.0944, 3.14), (-6.2832, 6.2832, 3.14), (-0.192, 3.927, 3.14)],
        *[(-6.2832, 6.2832, 3.14), (-1.693, 3.1416, 3.14), (-6.2832, 6.2832, 3.14)],
    ],
    "baxter_left": [
        *[(-1.7017, 1.7017, 1.5), (-2.147, 1.047, 1.5), (-3.0542, 3.0542, 1.5), (-0.05, 2.618, 1.5)],
        *[(-3.059, 3.059, 4.0), (-1.5708, 2.094, 4.0), (-3.059, 3.059, 4.0)],
    ],
    "so101": [
        *[(-0.1745, 1.7453, 10.0), (-2.7439, 2.8412, 10.0), (-1.6581, 1.6581, 10.0)],
        *[(-1.69, 1.69, 10.0), (-1.7453, 1.7453, 10.0), (-1.9199, 1.9199, 10.0)],
    ],
    "go1_leg": [(-0.863, 0.863, 30.1), (-0.686, 4.501, 30.1), (-2.818, -0.888, 20.06)],
    "two_dof": [(-3.14, 3.14, 1.0), (-3.14, 3.14, 1.0)],
    "tiago_pro_right": [
        *[(-4.7124, 0.5236, 2.5), (-2.4435, 1.1345, 2.5), (-2.618, 2.618, 2.5), (-2.4435, 1.1345, 2.5)],
        *[(-1.5708, 3.6652, 2.5), (-1.885, 3.002, 2.5), (-2.618, 2.618, 2.5)],
    ],
}


@dataclass(frozen=True)
class Robot:
    """lower, upper, velocity (k,) of the path's coordinates; rate of its logs, Hz."""

    name: str
    path: str
    parts: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    rate: float
    config: FourierConfig

    @property
    def channels(self) -> tuple[Channel, ...]:
        units = ("rad",) * len(self.parts)
        plan = f"{self.path}_des"
        return (
            Channel(self.path, self.parts, units, required=True),
            Channel(plan, self.parts, units, "plan"),
            Channel(f"{plan}_rate", self.parts, units, "plan", derivative_of=plan),
        )

    @property
    def scale(self) -> Array:
        return self.upper - self.lower

    def motion(self, seed: int, config: FourierConfig | None = None) -> FourierTrajectory:
        """A random motion, enlarged until it meets a limit of position or velocity of each coordinate."""
        rng = np.random.default_rng(seed)
        config = self.config if config is None else config
        family = FourierFamily.of(config, len(self.parts)).drawn(rng)
        made = family.trajectory(rng.standard_normal(family.size))
        t = np.arange(0.0, made.duration, 0.01)
        q, qd = made.motion(t, 2).orders
        size = np.minimum(0.95 * self.scale / np.ptp(q, axis=0), self.velocity / np.abs(qd).max(axis=0))
        table = made.coefficients * size
        middle = 0.5 * (q.max(axis=0) + q.min(axis=0)) * size - made.coefficients[0] * size
        room = 0.5 * (self.scale - np.ptp(q, axis=0) * size)
        table[0] = 0.5 * (self.lower + self.upper) - middle + 0.9 * rng.uniform(-room, room)
        return FourierTrajectory(table, made.omega0, made.duration, made.ramp)


def _arm(name: str, rows: list[tuple[float, float, float]], rate: float) -> Robot:
    lower, upper, velocity = np.array(rows).T
    segment = suited_to(FourierConfig(), lower, upper, velocity, 2.0 * velocity)
    config = FourierConfig(omega0=segment.omega0)  # again and again, as recordings were before chains
    parts = tuple(f"j{i}" for i in range(len(rows)))
    return Robot(name, "q", parts, lower, upper, velocity, rate, config)


def _room(name: str, table: dict[str, object], config: FourierConfig) -> Robot:
    lower, upper = np.array(table["lower"], dtype=float), np.array(table["upper"], dtype=float)
    speed = np.full(3, float(table["speed"]) / 3**0.5)  # type: ignore[arg-type]
    return Robot(name, "position", ("x", "y", "z"), lower, upper, speed, 50.0, config)


def _all() -> dict[str, Robot]:
    robots = [_arm(name, rows, 100.0) for name, rows in URDF_LIMITS.items()]
    flight = FourierConfig(harmonics=2, duration=30.0, rest="none")
    at_rest = FourierConfig(harmonics=3, duration=30.0, rest="nullspace")
    for file in sorted(Path(etude.__file__).parents[1].glob("etude_*/data/**/*.toml")):
        table = tomllib.loads(file.read_text())
        if "axis" in table:
            rows = [(a["lower"], a["upper"], a["velocity"]) for a in table["axis"]]
            robots.append(_arm(table["name"], rows, table["rate"]))
        elif "lower" in table:
            robots += [_room(table["name"], table, flight), _room(table["name"] + "_rest", table, at_rest)]
    return {robot.name: robot for robot in robots}


ROBOTS = _all()
