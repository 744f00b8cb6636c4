"""A small two-joint robot with a model file, and data sets of it, for the tests of learned models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from etude.models.dataset import Dataset, concatenate
from etude.models.model_config import ModelConfig
from etude.robots.spec import Axis, RobotSpec

PENDULUM = """<mujoco><worldbody><body>
  <joint name="a" axis="0 1 0"/><inertial pos=".2 0 0" mass="2" diaginertia=".01 .03 .03"/>
  <body pos=".4 0 0"><joint name="b" axis="0 1 0"/>
    <inertial pos=".1 0 .05" mass="1" diaginertia=".004 .005 .006"/></body>
</body></worldbody></mujoco>"""
SMALL = ModelConfig(kind="gp", points=90, fit_points=60, steps=12)
NOISE = 0.2


def pendulum(folder: Path | None = None, unit: str = "A") -> RobotSpec:
    """The robot; with a folder, its model file is written there."""
    path = None
    if folder is not None:
        path = folder / "pendulum.xml"
        path.write_text(PENDULUM, encoding="utf-8")
    return RobotSpec("pendulum", tuple(Axis(n, -2.0, 2.0, 2.0, 4.0, 40.0) for n in "ab"), unit, 8.0, path)


def trajectory(group: int, seconds: float = 25.0) -> Dataset:
    """Noisy commands along a smooth motion: gravity, friction, and a ripple that no rigid body has."""
    rng = np.random.default_rng(100 + group)
    t = np.arange(0.0, seconds, 0.125)
    speed, phase = rng.uniform(0.3, 0.9, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    angle = t[:, None, None] * speed + phase
    q = 0.5 * np.sin(angle).sum(axis=1)
    qd = 0.5 * (speed * np.cos(angle)).sum(axis=1)
    qdd = -0.5 * (speed**2 * np.sin(angle)).sum(axis=1)
    far = 1.2 * np.cos(q.sum(axis=1))
    tau = np.column_stack([8.0 * np.cos(q[:, 0]) + far, far]) + 0.5 * np.sin(8.0 * q)
    tau += 1.5 * np.tanh(qd / 0.05) + 0.8 * qd + NOISE * rng.normal(size=q.shape)
    return Dataset(t, q, qd, qdd, tau, np.abs(qd) < 0.03, np.full(len(t), group, dtype=np.int64))


def trajectories(count: int) -> Dataset:
    return concatenate([trajectory(group) for group in range(count)])
