"""Robots and trajectories for the tests of this folder."""

from __future__ import annotations

import numpy as np

from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.family import TrajectoryFamily

FAMILIES = {
    "nullspace": TrajectoryFamily(),
    "two periods": TrajectoryFamily(harmonics=3, duration=20.0, omega0=4.0 * np.pi / 20.0),
    "ramp, omega0 free": TrajectoryFamily(harmonics=2, omega0=(0.105, 0.2), rest="ramp"),
    "one harmonic": TrajectoryFamily(harmonics=1, duration=15.0, omega0=0.7, rest="ramp", ramp=3.0),
}


def robot(seed: int = 0, joints: int = 3) -> RobotSpec:
    """A robot with lopsided position limits of very different sizes."""
    rng = np.random.default_rng(seed)
    axes = []
    for j in range(joints):
        lower = rng.uniform(-3.0, 1.0)
        upper = lower + 10.0 ** rng.uniform(-1.0, 0.7)
        axes.append(Axis(f"j{j}", lower, upper, *(10.0 ** rng.uniform(-1.0, 1.0, 3))))
    return RobotSpec("example", tuple(axes), "N m", 100.0)
