"""The closed loop: what the electronics do to a command, and how well each kind of feedforward tracks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from etude.control.closed_loop import control_times, run_closed_loop, tracking_error
from etude.control.feedforward import no_feedforward, perfect_feedforward
from etude.errors import DataError, UsageError
from etude.logs.log import RobotLog
from etude.plants.registry import simulated_robot
from etude.plants.robot import SimulatedRobot
from etude.trajectories.samples import TrajectorySamples


class Swing:
    """Every joint swings about its middle at 0.6 of its range, one sine each; starts and ends at rest."""

    def __init__(self, robot: SimulatedRobot, duration: float = 40.0) -> None:
        self.dof, self.duration = robot.spec.dof, duration
        self.middle = 0.5 * (robot.spec.lower + robot.spec.upper)
        self.width = 0.3 * (robot.spec.upper - robot.spec.lower)
        self.omega = 2.0 * np.pi / duration * np.array([1, 2, 2, 2])[: self.dof]

    def sample(self, t: np.ndarray) -> TrajectorySamples:
        angle = self.omega * t[:, None]
        q = self.middle - self.width * np.cos(angle)
        qd, qdd = self.width * self.omega * np.sin(angle), self.width * self.omega**2 * np.cos(angle)
        return TrajectorySamples(t=t, q=q, qd=qd, qdd=qdd, qddd=-(self.omega**2) * qd)


@pytest.fixture(scope="module", params=["arm4", "arm4_rough"])
def robot(request: pytest.FixtureRequest) -> SimulatedRobot:
    return simulated_robot(request.param, "compiled")


@pytest.fixture(scope="module")
def pd_log(robot: SimulatedRobot) -> RobotLog:
    return run_closed_loop(robot, Swing(robot), no_feedforward(robot.spec), np.random.default_rng(0))


def test_feedback_alone_lags_by_degrees_and_the_exact_inverse_by_tenths(
    robot: SimulatedRobot, pd_log: RobotLog
) -> None:
    exact = run_closed_loop(robot, Swing(robot), perfect_feedforward(robot), np.random.default_rng(0))
    pd, perfect = (np.degrees(tracking_error(log)) for log in (pd_log, exact))
    assert (pd > 1.0).all()
    assert (pd < 7.0).all()
    assert 2.0 < pd.mean() < 5.0
    assert perfect.mean() < 0.25
    assert (perfect < 0.25 * pd).all()


def test_commands_are_whole_numbers_within_the_drives_range(robot: SimulatedRobot, pd_log: RobotLog) -> None:
    np.testing.assert_array_equal(pd_log.tau, np.rint(pd_log.tau))
    np.testing.assert_array_equal(pd_log.tau, np.rint(pd_log.tau_fb + pd_log.tau_ff))
    far = np.full((100, 4), 1000.0) * [1, -1, 1, -1]
    rest = Swing(robot).sample(np.zeros(1)).q[0]
    still = TrajectorySamples(np.arange(100) / 100, np.tile(rest, (100, 1)), 0 * far, 0 * far, 0 * far)
    log = robot.run(still, far, None, lead_in=0.0)
    np.testing.assert_array_equal(log.tau[:10], np.tile(np.array([255, -255, 255, -255]), (10, 1)))


def test_the_feedback_is_pd_on_the_encoder_and_its_filtered_difference(
    robot: SimulatedRobot, pd_log: RobotLog
) -> None:
    rate, q = np.zeros(4), pd_log.q
    expected = np.empty_like(q)
    for k in range(len(q)):
        if k > 0:
            rate = 0.65 * rate + 0.35 * (q[k] - q[k - 1]) * robot.spec.rate
        lag, slip = pd_log.q_des[k] - q[k], pd_log.qd_des[k] - rate
        expected[k] = robot.gains.kp * lag + robot.gains.kd * slip
    np.testing.assert_allclose(pd_log.tau_fb, expected, atol=1e-8)


def test_the_encoder_counts_4096_to_the_turn_and_is_noisy_by_a_fiftieth_of_a_degree(
    robot: SimulatedRobot,
) -> None:
    tick = 2.0 * np.pi / 4096
    motion = Swing(robot)
    quiet = run_closed_loop(robot, motion, no_feedforward(robot.spec), None)
    np.testing.assert_allclose(quiet.q / tick, np.rint(quiet.q / tick), atol=1e-9)
    assert np.abs(quiet.q - quiet.q_true).max() <= 0.5 * tick + 1e-12
    noisy = run_closed_loop(robot, motion, no_feedforward(robot.spec), np.random.default_rng(3))
    np.testing.assert_allclose(noisy.q / tick, np.rint(noisy.q / tick), atol=1e-9)
    moving = np.abs(np.gradient(noisy.q_true, axis=0)) > 0.1 * tick  # so that quantisation is uniform
    spread = np.degrees((noisy.q - noisy.q_true)[moving].std())
    assert spread == pytest.approx(np.hypot(0.02, np.degrees(tick) / np.sqrt(12.0)), rel=0.05)


def test_the_lead_in_is_at_rest_and_does_not_count(robot: SimulatedRobot, pd_log: RobotLog) -> None:
    before = pd_log.t < 0.0
    assert before.sum() == 200
    np.testing.assert_array_equal(pd_log.q_des[before], np.tile(pd_log.q_des[200], (200, 1)))
    np.testing.assert_array_equal(pd_log.qd_des[before], 0.0)
    error = np.abs(pd_log.q_des - pd_log.q_true)
    np.testing.assert_allclose(tracking_error(pd_log), error[200:].mean(axis=0))
    measured = tracking_error(dataclasses.replace(pd_log, q_true=None))
    np.testing.assert_allclose(measured, np.abs(pd_log.q_des - pd_log.q)[200:].mean(axis=0))


def test_a_minute_has_six_thousand_control_ticks() -> None:
    t = control_times(60.0, 100.0)
    assert len(t) == 6000
    assert t[0] == 0.0
    assert t[-1] == pytest.approx(59.99)
    assert len(control_times(0.1 + 0.2, 100.0)) == 30  # 0.30000000000000004 s
    for duration in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(UsageError, match="duration"):
            control_times(duration, 100.0)


def test_another_robots_trajectory_is_refused(robot: SimulatedRobot) -> None:
    motion = Swing(robot)
    motion.dof = 3
    with pytest.raises(UsageError, match=r"3 joints.*waist, shoulder, elbow, wrist"):
        run_closed_loop(robot, motion, no_feedforward(robot.spec), None)


def test_a_log_without_desired_motion_has_no_tracking_error(pd_log: RobotLog) -> None:
    with pytest.raises(DataError, match="desired positions"):
        tracking_error(dataclasses.replace(pd_log, q_des=None))
    with pytest.raises(DataError, match="t >= 0"):
        tracking_error(dataclasses.replace(pd_log, t=pd_log.t - 1000.0))
