"""MuJoCo and the closed form are the same arm."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from arm_examples import MIDDLE, Sines, open_loop, simulated
from hypothesis import given, settings
from hypothesis import strategies as st

from etude_arm import KIND, PerfectController
from etude_arm.plant import compiled, mujoco_engine
from etude_arm.plant.parameters import load_parameters

ARMS = ("arm4", "arm4_rough")
SPEC = KIND.spec(KIND.built_in()["arm4"])
four = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).map(np.array)


@pytest.mark.thinned
@pytest.mark.parametrize("seed", [None, 7])
@pytest.mark.parametrize("name", ARMS)
def test_a_minute_of_closed_loop_agrees_to_a_thousandth_of_a_degree(name: str, seed: int | None) -> None:
    logs = []
    for engine in ("mujoco", "compiled"):
        robot = simulated(name, engine)
        rng = None if seed is None else np.random.default_rng(seed)
        logs.append(robot.run(Sines(60.0), None, rng))
    assert len(logs[0].t) == 6200
    np.testing.assert_allclose(np.degrees(logs[0]["q_true"] - logs[1]["q_true"]), 0.0, atol=1e-3)
    np.testing.assert_array_equal(logs[0]["command"], logs[1]["command"])
    np.testing.assert_array_equal(logs[0]["q"], logs[1]["q"])


@pytest.mark.parametrize("name", ARMS)
def test_no_control_tick_disagrees_even_where_stick_slip_amplifies(name: str) -> None:
    """Slow reversals amplify rounding errors some hundredfold each; so here MuJoCo restarts at every tick."""
    robot, arm = simulated(name, "compiled"), load_parameters(name)
    motion = Sines(40.0, omega=(0.05, 0.04, 0.06, 0.045))
    log = robot.run(motion, PerfectController(robot), np.random.default_rng(1))
    volts = log["command"] / arm.controller.resolution * arm.controller.supply
    start = log["q_des"][0]
    q, v, z = open_loop("compiled", arm, start, np.zeros(4), np.repeat(volts, 10, axis=0))
    np.testing.assert_allclose(q[::10][:-1], log["q_true"], atol=1e-12)
    model = mujoco_engine.build_model(arm)
    data, friction = mujoco.MjData(model), mujoco_engine.PositionFriction(arm, model)
    worst = 0.0
    for k in range(0, len(log.t), 3):
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = q[10 * k], v[10 * k], z[10 * k], volts[k]
        mujoco_engine.advance(model, data, friction, 10)
        worst = max(worst, float(np.abs(data.qpos - q[10 * k + 10]).max()))
    assert np.degrees(worst) < 1e-9


def test_in_sensitive_motion_the_engines_agree_in_what_is_reported() -> None:
    errors = []
    for engine in ("mujoco", "compiled"):
        robot = simulated("arm4_rough", engine)
        motion = Sines(30.0, omega=(0.05, 0.04, 0.06, 0.045))
        log = robot.run(motion, PerfectController(robot), np.random.default_rng(1))
        errors.append(robot.error(log)[0])
    np.testing.assert_allclose(errors[0], errors[1], atol=0.05)


@settings(max_examples=40, deadline=None)
@given(q=four, v=four)
def test_inertia_and_bias_forces_are_those_of_the_shipped_model_file(q: np.ndarray, v: np.ndarray) -> None:
    """The closed form reads its links from the plant's TOML, MuJoCo from the robot's MJCF."""
    arm = load_parameters("arm4")
    model = mujoco.MjModel.from_xml_path(str(SPEC.model_file))
    model.opt.gravity[2] = -arm.gravity
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = MIDDLE + q, v
    mujoco.mj_forward(model, data)
    inertia = np.zeros((4, 4))
    for j, unit in enumerate(np.eye(4)):
        mujoco.mj_mulM(model, data, inertia[j], unit)
    M, bias = np.zeros((4, 4)), np.zeros(4)
    compiled._rigid(MIDDLE + q, v, compiled.arrays(arm), M, bias)
    np.testing.assert_allclose(M, inertia, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(bias, data.qfrc_bias, rtol=1e-10, atol=1e-12)


def test_the_pivots_of_the_shipped_model_file_are_the_plants() -> None:
    model = mujoco.MjModel.from_xml_path(str(SPEC.model_file))
    for motor in load_parameters("arm4").motors[1:]:
        for end, pivot in (("base", motor.fixed), ("end", motor.moving)):
            x, y, z = model.site(f"{motor.joint}_rod_{end}").pos
            assert (x, y, z) == (pivot[0], 0.0, pivot[1])


def test_the_model_files_limits_are_the_robots() -> None:
    spec = SPEC
    model = mujoco.MjModel.from_xml_path(str(spec.model_file))
    assert [model.joint(j).name for j in range(4)] == list(spec.names)
    np.testing.assert_allclose(model.jnt_range, np.stack([spec.lower, spec.upper], axis=1), atol=1e-12)


def test_the_mujoco_arm_keeps_no_limits_that_would_push_back() -> None:
    model = mujoco_engine.build_model(load_parameters("arm4"))
    assert not model.jnt_limited.any()
    assert model.nu == model.na == 4
