"""The two random baselines: random series scaled to the limits, and of random amplitude."""

from __future__ import annotations

from typing import Literal

import numpy as np

from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.certificate import series_ranges
from etude.trajectories.extremes import ROOM
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.gauge import check_room
from etude.trajectories.ramp import PEAK_RATE


def random_trajectory(
    rng: np.random.Generator,
    spec: RobotSpec,
    family: TrajectoryFamily,
    scale: Literal["limits", "amplitude"] = "limits",
) -> FourierTrajectory:
    """A random member of the family, certified inside the limits.

    Velocity amplitudes are drawn from a normal distribution, each joint by itself. With scale = "limits"
    every joint is enlarged until the first of its position width, velocity or acceleration limit is touched;
    with "amplitude" to a fraction of that drawn from U(0.1, 1). The offset q0 is then drawn
    uniformly from the values that keep the motion inside the position limits.

    Raises:
        UsageError: an unknown scale.
        UnsafeTrajectoryError: limits that leave no room for any motion.
    """
    if scale not in ("limits", "amplitude"):
        raise UsageError(f"scale must be 'limits' or 'amplitude', not {scale!r}")
    check_room(spec)
    omega0 = family.draw_omega0(rng)
    free = family.free_basis
    shape = free @ rng.standard_normal((free.shape[1], spec.dof))
    shape[0] = 0.0
    ranges = series_ranges(shape, omega0)
    low, high = ranges["position"]
    speed, bend = (np.maximum(-ranges[k][0], ranges[k][1]) for k in ("velocity", "acceleration"))
    if family.phase_ramp > 0.0:
        bend = bend + PEAK_RATE / family.phase_ramp * speed
    width = spec.upper - spec.lower
    factor = ROOM * np.minimum(
        width / (high - low), np.minimum(spec.velocity / speed, spec.acceleration / bend)
    )
    if scale == "amplitude":
        factor = factor * rng.uniform(0.1, 1.0, spec.dof)
    coefficients = shape * factor
    coefficients[0] = rng.uniform(spec.lower - factor * low, spec.upper - factor * high)
    return family.trajectory(coefficients, omega0)
