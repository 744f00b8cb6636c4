"""Every simulated robot, with every engine: what a campaign relies on."""

from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.plants.registry import plant_names, simulated_robot
from etude.plants.robot import SimulatedRobot
from etude.trajectories.samples import TrajectorySamples

ENGINES = ("mujoco", "compiled")


@pytest.fixture(params=[(name, engine) for name in plant_names() for engine in ENGINES], ids="-".join)
def robot(request: pytest.FixtureRequest) -> SimulatedRobot:
    return simulated_robot(*request.param)


def _still(robot: SimulatedRobot, seconds: float = 1.0) -> TrajectorySamples:
    spec = robot.spec
    t = np.arange(round(seconds * spec.rate)) / spec.rate
    q = np.tile(0.5 * (spec.lower + spec.upper), (len(t), 1))
    zero = np.zeros_like(q)
    return TrajectorySamples(t=t, q=q, qd=zero, qdd=zero, qddd=zero)


def test_a_run_is_a_complete_log(robot: SimulatedRobot) -> None:
    samples = _still(robot)
    log = robot.run(samples, np.zeros_like(samples.q), np.random.default_rng(0), lead_in=0.5)
    assert log.names == robot.spec.names
    assert log.command_unit == robot.spec.command_unit
    np.testing.assert_allclose(np.diff(log.t), 1.0 / robot.spec.rate)
    assert log.t[0] == pytest.approx(-0.5)
    assert len(log.t) == len(samples.t) + round(0.5 * robot.spec.rate)
    for field in ("q", "tau", "q_des", "qd_des", "qdd_des", "tau_ff", "tau_fb", "q_true"):
        rows = getattr(log, field)
        assert rows.shape == (len(log.t), robot.spec.dof), field
        assert np.isfinite(rows).all(), field
    assert (np.abs(log.tau) <= robot.spec.command).all()
    np.testing.assert_array_equal(log.q_true[0], samples.q[0])


def test_the_same_seed_gives_the_same_log_and_another_seed_another(robot: SimulatedRobot) -> None:
    samples = _still(robot)
    zero = np.zeros_like(samples.q)
    one, same, other = (robot.run(samples, zero, np.random.default_rng(s)) for s in (1, 1, 2))
    for field in ("q", "tau", "q_true", "tau_fb"):
        np.testing.assert_array_equal(getattr(one, field), getattr(same, field))
    assert (one.q != other.q).any()


def test_the_inverse_holds_the_robot_where_it_is(robot: SimulatedRobot) -> None:
    samples = _still(robot, 2.0)
    hold = robot.inverse(samples.q, samples.qd, samples.qdd)
    held = robot.run(samples, hold, None)
    sagged = robot.run(samples, np.zeros_like(hold), None)
    error = [np.abs(log.q_true - log.q_des).mean() for log in (held, sagged)]
    assert error[0] < 0.1 * error[1]


def test_wrong_joints_values_or_grids_are_refused(robot: SimulatedRobot) -> None:
    still = _still(robot)
    zero = np.zeros_like(still.q)

    def changed(**fields: np.ndarray) -> TrajectorySamples:
        return TrajectorySamples(**{**still.__dict__, **fields})

    spoilt = still.q.copy()
    spoilt[3, 1] = np.nan
    infinite = zero.copy()
    infinite[0, 0] = np.inf
    cases = [
        (changed(q=still.q[:, 1:]), zero, "q has shape"),
        (changed(qd=zero[1:]), zero, "qd has shape"),
        (changed(q=spoilt), zero, rf"q is nan.*row 3, joint {robot.spec.names[1]}"),
        (still, zero[:, :2], "tau_ff has shape"),
        (still, infinite, "tau_ff is inf"),
        (changed(t=2.0 * still.t), zero, "control grid"),
        (changed(t=np.full_like(still.t, np.nan)), zero, "control grid"),
        (TrajectorySamples(*(x[:0] for x in (still.t, zero, zero, zero, zero))), zero[:0], "q has shape"),
    ]
    for samples, tau_ff, fact in cases:
        with pytest.raises(UsageError, match=fact):
            robot.run(samples, tau_ff, None)
    with pytest.raises(UsageError, match="lead-in"):
        robot.run(still, zero, None, lead_in=-1.0)
    with pytest.raises(UsageError, match="qdd has shape"):
        robot.inverse(zero, zero, zero[:, :1])


def test_unknown_plants_and_engines_are_refused_with_the_choices() -> None:
    with pytest.raises(UsageError, match=r"arm4, arm4_rough"):
        simulated_robot("arm5")
    with pytest.raises(UsageError, match="mujoco, compiled"):
        simulated_robot("arm4", "bullet")
