"""Runs a trajectory on a simulated robot, and measures how well it was followed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from etude.control.feedforward import Feedforward
from etude.errors import DataError, UsageError
from etude.logs.log import RobotLog
from etude.plants.robot import SimulatedRobot
from etude.trajectories.samples import Trajectory

Array = NDArray[np.float64]


def control_times(duration: float, rate: float) -> Array:
    """Control ticks (T,) in [0, duration), s: 6000 of them in 60 s at 100 Hz."""
    if not 0.0 < duration < math.inf:
        raise UsageError(f"the trajectory lasts {duration} s", next_step="Give it a positive duration.")
    ticks: Array = np.arange(math.ceil(duration * rate - 1e-6)) / rate
    return ticks


def run_closed_loop(
    robot: SimulatedRobot,
    trajectory: Trajectory,
    feedforward: Feedforward,
    rng: np.random.Generator | None,
    lead_in: float = 2.0,
) -> RobotLog:
    """Feedback plus feedforward along the whole trajectory, after a lead-in at its start.

    Args:
        robot, trajectory: must have the same number of joints.
        feedforward: computed once, for all samples, before the robot moves.
        rng: of the encoder noise; the same seed gives the same log. None: no noise.
        lead_in: s at rest before t = 0, kept in the log.

    Raises:
        UsageError: another dof, values that are not finite.
    """
    if trajectory.dof != robot.spec.dof:
        raise UsageError(
            f"the trajectory has {trajectory.dof} joints, the robot {robot.spec.dof}",
            where=robot.name,
            next_step=f"Its joints are {', '.join(robot.spec.names)}.",
        )
    samples = trajectory.sample(control_times(trajectory.duration, robot.spec.rate))
    return robot.run(samples, feedforward(samples), rng, lead_in)


def tracking_error(log: RobotLog) -> Array:
    """Mean |desired - actual| (dof,) in rad over t >= 0; actual is the true position if the log knows it.

    Raises:
        DataError: the log has no desired positions, or nothing at t >= 0.
    """
    moving = log.t >= 0.0
    if log.q_des is None or not moving.any():
        raise DataError(
            "the tracking error needs desired positions at t >= 0",
            where=log.source,
            next_step="Log q_des beside q.",
        )
    actual = log.q if log.q_true is None else log.q_true
    error: Array = np.abs(log.q_des - actual)[moving].mean(axis=0)
    return error
