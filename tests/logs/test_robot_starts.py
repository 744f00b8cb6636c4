"""A log of the proposal is accepted and aligned to a sample, for the limits of every robot at hand.

Most of these proposals repeat themselves within their duration, as a fast robot's did before there were
chains. Of version 0.1, logs that held exactly the proposal were refused, or shifted by whole periods.
"""

from __future__ import annotations

import numpy as np
import pytest
from robot_limits import ROBOTS, Robot

from etude.errors import DataError
from etude.logs import align
from etude.protocols import Trajectory
from etude.trajectories import FourierConfig
from etude.types import Log

LAG = 0.12
NOISE = 2e-3  # of the range
# recorded from and to, in s of the proposal and after its end; the log's clock at the proposal's start
RECORDINGS = {
    "exactly": (0.0, 0.0, 0.0),
    "rest before": (-3.3, 0.0, 3.3),
    "a little rest before": (-0.4, 0.0, 0.4),
    "rest before, marked": (-3.3, 0.0, 0.0),
    "rest after": (0.0, 4.0, 0.0),
    "rest before and after": (-2.1, 5.0, 2.1),
    "since 1970": (-2.0, 3.0, 1.7e9),
    "5 s missing at the start": (5.0, 0.0, 0.0),
    "5 s missing at the end": (0.0, -5.0, 0.0),
    "5 s missing, another clock": (5.0, 2.0, -5.0),
    "3.7 s missing, another clock": (3.7, 0.0, -3.7),
}


def recorded(
    robot: Robot, trajectory: Trajectory, since: float, until: float, clock: float, lag: float = 0.0
) -> Log:
    """A noisy log of the trajectory, which rests before and after."""
    steps = np.arange(round(since * robot.rate), round((trajectory.duration + until) * robot.rate) + 1)
    t = steps / robot.rate
    q = trajectory.motion(np.clip(t - lag, 0.0, trajectory.duration), 1).orders[0]
    noise = np.random.default_rng(0).standard_normal(q.shape) * NOISE * robot.scale
    return Log(t + clock, {robot.path: robot.channels[0]}, {robot.path: q + noise}, "log")


def start_of(robot: Robot, trajectory: Trajectory, log: Log) -> float:
    """Where the log's clock says that the trajectory starts, s."""
    found = align(log, trajectory, robot.channels, robot.path, robot.scale)
    assert len(found) == len(log)
    np.testing.assert_allclose(
        found[f"{robot.path}_des"],
        trajectory.motion(np.clip(found.t, 0.0, trajectory.duration), 1).orders[0],
        atol=1e-12,
    )
    return float(log.t[0] - found.t[0])


NAMES = pytest.mark.parametrize("name", ROBOTS)


@pytest.mark.thinned(3)
@NAMES
def test_logs_of_the_proposal_are_aligned_to_a_sample(name: str) -> None:
    robot = ROBOTS[name]
    trajectory = robot.motion(0)
    period = 2 * np.pi / trajectory.omega0
    for what, (since, until, clock) in RECORDINGS.items():
        error = start_of(robot, trajectory, recorded(robot, trajectory, since, until, clock)) - clock
        if "another clock" in what and until <= 0.0:
            error -= period * round(error / period)  # nothing tells whole periods apart
        assert abs(error) <= 1.0 / robot.rate + 1e-6, (what, error, period)


@pytest.mark.thinned(3)
@NAMES
def test_the_controllers_lag_is_no_shift_of_a_clock_that_fits(name: str) -> None:
    robot = ROBOTS[name]
    trajectory = robot.motion(1)
    for since in (0.0, -2.0):
        assert start_of(robot, trajectory, recorded(robot, trajectory, since, 0.0, 0.0, LAG)) == 0.0
    late = start_of(robot, trajectory, recorded(robot, trajectory, -2.0, 0.0, 2.0, LAG))
    assert late - 2.0 == pytest.approx(LAG, abs=1.0 / robot.rate + 1e-6)


@pytest.mark.thinned(4)
@NAMES
def test_logs_of_another_motion_are_refused(name: str) -> None:
    robot = ROBOTS[name]
    trajectory = robot.motion(0)
    for seed in (1000, 1100, 1200):
        other = recorded(robot, robot.motion(seed), 0.0, 0.0, 0.0)
        with pytest.raises(DataError, match="not the log of the proposed"):
            align(other, trajectory, robot.channels, robot.path, robot.scale)


@pytest.mark.thinned
@pytest.mark.parametrize("times", [2, 3, 6, 12, 20])
@pytest.mark.parametrize("rest", ["nullspace", "ramp", "none"])
def test_a_motion_that_repeats_itself(times: int, rest: str) -> None:
    robot = ROBOTS["panda"]
    config = FourierConfig(3, 60.0, 2 * np.pi * times / 60.0, rest)  # type: ignore[arg-type]
    trajectory = robot.motion(0, config)
    period = 60.0 / times
    for since, until, clock in ((0.0, 0.0, 0.0), (-4.0, 3.0, 4.0), (5.0, 0.0, 0.0), (-2.0, -5.0, 2.0)):
        found = start_of(robot, trajectory, recorded(robot, trajectory, since, until, clock))
        assert found == pytest.approx(clock, abs=0.0101)
    half = recorded(robot, trajectory, 30.0, 0.0, 0.0)  # by its own clock, the second half
    assert start_of(robot, trajectory, half) == pytest.approx(0.0, abs=0.0101)
    shifted = start_of(robot, trajectory, recorded(robot, trajectory, 17.3, 0.0, -17.3))
    if rest != "ramp":
        assert (shifted + 17.3) / period == pytest.approx(
            round((shifted + 17.3) / period), abs=0.0101 / period
        )


def test_an_approach_and_a_return_do_not_move_the_start() -> None:
    robot = ROBOTS["panda"]
    trajectory = robot.motion(0)
    log = recorded(robot, trajectory, -12.0, 9.0, 12.0)
    q = log["q"].copy()
    home = 0.5 * (robot.lower + robot.upper)
    for rows, there in ((slice(0, 1200), q[1200]), (slice(-900, None), q[-901])):
        share = np.linspace(0.0, 1.0, len(q[rows]))[:, None]
        share = share if rows.start == 0 else share[::-1]
        q[rows] = home + share * (there - home)
    assert start_of(robot, trajectory, log.put(robot.channels[0], q)) == pytest.approx(12.0, abs=0.0101)
