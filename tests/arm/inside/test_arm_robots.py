"""Every simulated arm, with every engine: what a campaign relies on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import ENGINES, simulated

from etude.errors import UsageError
from etude.types import Motion
from etude_arm import KIND, PerfectController
from etude_arm.plant.parameters import plant_names
from etude_arm.plant.robot import ArmRobot, simulated_robot


class Still:
    """At rest in the middle of the limits; the motion may be spoilt."""

    form = "still"

    def __init__(self, robot: ArmRobot, duration: float = 1.0) -> None:
        self.duration, self.q = duration, KIND.home(robot.spec)

    def motion(self, t: np.ndarray, orders: int = 3) -> Motion:
        rows = np.zeros((orders, len(t), len(self.q)))
        rows[0] = self.q
        return Motion(t, rows)


class Planned:
    """A controller of known commands."""

    def __init__(self, commands: np.ndarray) -> None:
        self.commands = commands

    def planned(self, motion: Motion) -> np.ndarray | None:
        return self.commands

    def command(self, t: float, row) -> tuple[np.ndarray, np.ndarray]:
        raise AssertionError("it planned ahead")

    def observe(self, t: float, row) -> None:
        raise AssertionError("nothing is learned from a run that was planned ahead")


@pytest.fixture(params=[(name, engine) for name in plant_names() for engine in ENGINES], ids="-".join)
def robot(request: pytest.FixtureRequest) -> ArmRobot:
    return simulated(*request.param)


def test_a_run_is_a_complete_log(robot: ArmRobot) -> None:
    log = replace(robot, lead_in=0.5).run(Still(robot), None, np.random.default_rng(0))
    rate = robot.spec.rate
    np.testing.assert_allclose(np.diff(log.t), 1.0 / rate)
    assert log.t[0] == pytest.approx(-0.5)
    assert len(log) == round(1.5 * rate)
    wanted = {c.name: c for c in KIND.channels(robot.spec) if c.name not in ("qd", "qdd")}
    assert dict(log.channels) == wanted
    for name, rows in log.values.items():
        assert rows.shape == (len(log), robot.spec.dof), name
        assert np.isfinite(rows).all(), name
    assert (np.abs(log["command"]) <= robot.spec.command).all()
    np.testing.assert_array_equal(log["q_true"][0], KIND.home(robot.spec))


def test_the_same_seed_gives_the_same_log_and_another_seed_another(robot: ArmRobot) -> None:
    one, same, other = (robot.run(Still(robot), None, np.random.default_rng(s)) for s in (1, 1, 2))
    for name in one.values:
        np.testing.assert_array_equal(one[name], same[name])
    assert (one["q"] != other["q"]).any()


def test_the_inverse_holds_the_robot_where_it_is(robot: ArmRobot) -> None:
    still = Still(robot, 2.0)
    errors = [robot.error(robot.run(still, c, None))[0].mean() for c in (PerfectController(robot), None)]
    assert errors[0] < 0.1 * errors[1]


def test_wrong_joints_and_values_are_refused(robot: ArmRobot) -> None:
    still = Still(robot)
    narrow, spoilt = Still(robot), Still(robot)
    narrow.q, spoilt.q = narrow.q[1:], spoilt.q * [1, np.nan, 1, 1]
    infinite = np.zeros((100, 4))
    infinite[3, 0] = np.inf
    for motion, commands, fact in (
        (narrow, None, "the trajectory has 3 joints, the robot 4"),
        (spoilt, None, rf"q_des is nan.*row 0, joint {robot.spec.names[1]}"),
        (still, np.zeros((100, 2)), r"the feedforward has shape \(100, 2\)"),
        (still, infinite, "the feedforward is inf"),
        (Still(robot, np.nan), None, "the trajectory lasts nan s"),
    ):
        with pytest.raises(UsageError, match=fact):
            robot.run(motion, None if commands is None else Planned(commands), None)
    with pytest.raises(UsageError, match="qdd has shape"):
        robot.inverse(np.zeros((5, 4)), np.zeros((5, 4)), np.zeros((5, 1)))


def test_unknown_plants_and_engines_and_other_joints_are_refused_with_the_choices() -> None:
    spec = simulated("arm4").spec
    with pytest.raises(UsageError, match=r"arm4, arm4_rough"):
        simulated_robot("arm5", spec)
    with pytest.raises(UsageError, match="mujoco, compiled"):
        simulated("arm4", "bullet")
    with pytest.raises(UsageError, match="are not those of the plant"):
        simulated_robot("arm4", replace(spec, axes=spec.axes[::-1]))
    with pytest.raises(UsageError, match="no multiple of the plant's time step"):
        simulated_robot("arm4", replace(spec, rate=333.0))
