"""The closed loop: what the electronics do to a command, and how well each kind of feedforward tracks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from arm_examples import Swing, simulated

from etude.errors import DataError, UsageError
from etude.types import Log, Motion
from etude_arm import PerfectController
from etude_arm.plant.feedback_loop import control_times
from etude_arm.plant.robot import ArmRobot


class Fixed:
    """A controller of known commands: all at once, or at every tick; remembers what it was shown."""

    def __init__(self, commands: np.ndarray, ahead: bool = True) -> None:
        self.commands, self.ahead, self.seen = commands, ahead, []

    def planned(self, motion: Motion) -> np.ndarray | None:
        return self.commands if self.ahead else None

    def command(self, t: float, row) -> tuple[np.ndarray, np.ndarray]:
        return self.commands[max(0, round(100 * t))], np.zeros(4)

    def observe(self, t: float, row) -> None:
        self.seen.append((t, row))


@pytest.fixture(scope="module", params=["arm4", "arm4_rough"])
def robot(request: pytest.FixtureRequest) -> ArmRobot:
    return simulated(request.param, "compiled")


@pytest.fixture(scope="module")
def pd_log(robot: ArmRobot) -> Log:
    return robot.run(Swing(robot), None, np.random.default_rng(0))


def test_feedback_alone_lags_by_degrees_and_the_exact_inverse_by_tenths(robot: ArmRobot, pd_log: Log) -> None:
    exact = robot.run(Swing(robot), PerfectController(robot), np.random.default_rng(0))
    pd, perfect = (robot.error(log)[0] for log in (pd_log, exact))
    assert (pd > 1.0).all()
    assert (pd < 7.0).all()
    assert 2.0 < pd.mean() < 5.0
    assert perfect.mean() < 0.25
    assert (perfect < 0.25 * pd).all()


def test_commands_are_whole_numbers_within_the_drives_range(robot: ArmRobot, pd_log: Log) -> None:
    np.testing.assert_array_equal(pd_log["command"], np.rint(pd_log["command"]))
    np.testing.assert_array_equal(pd_log["command"], np.rint(pd_log["command_fb"] + pd_log["command_ff"]))
    far = np.full((100, 4), 1000.0) * [1, -1, 1, -1]
    log = dataclasses.replace(robot, lead_in=0.0).run(Swing(robot, 1.0), Fixed(far), None)
    np.testing.assert_array_equal(log["command"][:10], np.tile(np.array([255, -255, 255, -255]), (10, 1)))


def test_the_feedback_is_pd_on_the_encoder_and_its_filtered_difference(robot: ArmRobot, pd_log: Log) -> None:
    rate, q, c = np.zeros(4), pd_log["q"], robot.parameters.controller
    expected = np.empty_like(q)
    for k in range(len(q)):
        if k > 0:
            rate = 0.65 * rate + 0.35 * (q[k] - q[k - 1]) * robot.spec.rate
        lag, slip = pd_log["q_des"][k] - q[k], pd_log["qd_des"][k] - rate
        expected[k] = np.array(c.kp) * lag + np.array(c.kd) * slip
    np.testing.assert_allclose(pd_log["command_fb"], expected, atol=1e-8)


def test_the_encoder_counts_4096_to_the_turn_and_is_noisy_by_a_fiftieth_of_a_degree(
    robot: ArmRobot,
) -> None:
    tick = 2.0 * np.pi / 4096
    motion = Swing(robot)
    quiet = robot.run(motion, None, None)
    np.testing.assert_allclose(quiet["q"] / tick, np.rint(quiet["q"] / tick), atol=1e-9)
    assert np.abs(quiet["q"] - quiet["q_true"]).max() <= 0.5 * tick + 1e-12
    noisy = robot.run(motion, None, np.random.default_rng(3))
    np.testing.assert_allclose(noisy["q"] / tick, np.rint(noisy["q"] / tick), atol=1e-9)
    moving = np.abs(np.gradient(noisy["q_true"], axis=0)) > 0.1 * tick  # so that quantisation is uniform
    spread = np.degrees((noisy["q"] - noisy["q_true"])[moving].std())
    assert spread == pytest.approx(np.hypot(0.02, np.degrees(tick) / np.sqrt(12.0)), rel=0.05)


def test_the_lead_in_is_at_rest_and_does_not_count(robot: ArmRobot, pd_log: Log) -> None:
    before = pd_log.t < 0.0
    assert before.sum() == 200
    np.testing.assert_array_equal(pd_log["q_des"][before], np.tile(pd_log["q_des"][200], (200, 1)))
    np.testing.assert_array_equal(pd_log["qd_des"][before], 0.0)
    error = np.abs(pd_log["q_des"] - pd_log["q_true"])
    np.testing.assert_allclose(robot.error(pd_log)[0], np.degrees(error[200:].mean(axis=0)))
    assert robot.error(pd_log)[1] == ("deg",) * 4
    measured, _ = robot.error(pd_log.without("q_true"))
    np.testing.assert_allclose(measured, np.degrees(np.abs(pd_log["q_des"] - pd_log["q"])[200:].mean(axis=0)))


def test_a_minute_has_six_thousand_control_ticks() -> None:
    t = control_times(60.0, 100.0)
    assert len(t) == 6000
    assert t[0] == 0.0
    assert t[-1] == pytest.approx(59.99)
    assert len(control_times(0.1 + 0.2, 100.0)) == 30  # 0.30000000000000004 s
    for duration in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(UsageError, match="duration"):
            control_times(duration, 100.0)


def test_another_robots_trajectory_is_refused(robot: ArmRobot) -> None:
    with pytest.raises(UsageError, match=r"3 joints.*waist, shoulder, elbow, wrist"):
        robot.run(Swing(robot, joints=3), None, None)


def test_a_log_without_desired_motion_has_no_tracking_error(robot: ArmRobot, pd_log: Log) -> None:
    with pytest.raises(DataError, match="desired positions"):
        robot.error(pd_log.without("q_des"))
    with pytest.raises(DataError, match="t >= 0"):
        robot.error(dataclasses.replace(pd_log, t=pd_log.t - 1000.0))


def test_a_controller_asked_at_every_tick_drives_as_one_that_planned_ahead(robot: ArmRobot) -> None:
    motion = Swing(robot, 4.0)
    commands = np.random.default_rng(5).uniform(-60.0, 60.0, (400, 4))
    slow = Fixed(commands, ahead=False)
    one, other = (robot.run(motion, c, np.random.default_rng(1)) for c in (Fixed(commands), slow))
    for name in one.values:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    assert [t for t, _ in slow.seen] == one.t.tolist()
    for name in ("q", "command", "command_ff", "command_fb", "q_des", "qdd_des"):
        np.testing.assert_array_equal([row[name] for _, row in slow.seen], one[name])


def test_a_changed_robot_has_the_change_and_other_changes_are_refused(robot: ArmRobot) -> None:
    motion = Swing(robot, 4.0)
    one, other = (r.run(motion, None, None) for r in (robot, robot.changed(payload=0.5, friction=1.2)))
    assert np.abs(one["q_true"] - other["q_true"]).max() > 1e-3
    with pytest.raises(UsageError, match=r"no 'wind' to change.*payload, friction, sensor_"):
        robot.changed(wind=1.0)
    with pytest.raises(UsageError, match="must be a finite number"):
        robot.changed(**{f"sensor_{robot.spec.names[1]}": np.nan})


def test_a_sensor_reads_too_much_and_the_robot_moves_as_before(robot: ArmRobot) -> None:
    motion, name = Swing(robot, 4.0), f"sensor_{robot.spec.names[2]}"
    other = robot.changed(**{name: 3.0}).changed(**{name: 1.5}, friction=1.0)
    one, two = (r.run(motion, None, None) for r in (robot, other))
    np.testing.assert_array_equal(one["q_true"], two["q_true"])
    np.testing.assert_allclose(two["command"] - one["command"], [[0.0, 0.0, 4.5, 0.0]] * len(one), atol=1e-9)
    slow = Fixed(np.zeros((400, 4)), ahead=False)
    asked = other.run(motion, slow, None)
    np.testing.assert_array_equal([row["command"] for _, row in slow.seen], asked["command"])
