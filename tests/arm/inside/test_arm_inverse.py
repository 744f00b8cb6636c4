"""The exact inverse model undoes the arm."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from arm_examples import MIDDLE, actuator_length, moment_arm, open_loop, simulated
from hypothesis import given, settings
from hypothesis import strategies as st

from etude_arm.plant import mujoco_engine
from etude_arm.plant.parameters import ArmParameters, load_parameters

ARMS = ("arm4", "arm4_rough")
four = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).map(np.array)


def _steady_bristles(arm: ArmParameters, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Deflection (4,) at which the bristles slide at constant speed."""
    length = actuator_length(arm, q[None])[0]
    speed = moment_arm(arm, q[None])[0] * qd
    rows = []
    for j, m in enumerate(arm.motors):
        ripple = m.friction_ripple
        level = m.coulomb + (m.static - m.coulomb) * np.exp(-((speed[j] / m.stribeck) ** 2))
        level *= 1.0 + ripple.amplitude * np.sin(ripple.wavenumber * length[j] + ripple.phase)
        rows.append(np.sign(speed[j]) * level / m.stiffness)
    return np.array(rows)


def _volts(name: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    c = load_parameters(name).controller
    return simulated(name).inverse(q, qd, qdd) / c.resolution * c.supply


@pytest.mark.parametrize("name", ARMS)
@settings(max_examples=40, deadline=None)
@given(q=four, qd=four, qdd=four)
def test_forward_dynamics_undo_the_inverse(name: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> None:
    """MuJoCo's forward dynamics, given the inverse's command, return the acceleration that was asked for."""
    arm = load_parameters(name)
    q, qd = MIDDLE + 0.4 * q, 0.2 * qd
    model = mujoco_engine.build_model(arm)
    data, friction = mujoco.MjData(model), mujoco_engine.PositionFriction(arm, model)
    data.qpos[:], data.qvel[:], data.act[:] = q, qd, _steady_bristles(arm, q, qd)
    data.ctrl[:] = _volts(name, q[None], qd[None], qdd[None])[0]
    mujoco.mj_fwdPosition(model, data)
    friction.apply(data.actuator_length)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qacc, qdd, atol=1e-7)


@pytest.mark.thinned
@pytest.mark.parametrize("engine", ["mujoco", "compiled"])
@pytest.mark.parametrize("name", ARMS)
def test_the_inverse_drives_the_arm_along_the_motion(name: str, engine: str) -> None:
    arm = load_parameters(name)
    h, swing = arm.timestep, np.array([0.2, 0.15, 0.15, 0.15])
    t = np.arange(1000)[:, None] * h  # one second, no reversal
    q, qd, qdd = MIDDLE + swing * np.sin(t), swing * np.cos(t), -swing * np.sin(t)
    volts = _volts(name, q, qd, qdd)
    actual, rate, _ = open_loop(engine, arm, q[0], qd[0], volts, _steady_bristles(arm, q[0], qd[0]))
    np.testing.assert_allclose(np.degrees(actual[:-1] - q), 0.0, atol=0.02)
    np.testing.assert_allclose(rate[:-1], qd, atol=0.001)


def test_steady_commands_match_a_hand_calculation() -> None:
    """The waist alone at constant speed: friction, viscous and back-EMF in closed form."""
    arm = load_parameters("arm4")
    waist, speed = arm.motors[0], 0.1
    qd = np.array([[speed, 0.0, 0.0, 0.0]])
    torque = waist.coulomb + waist.viscous * speed  # far above the Stribeck speed
    expected = 255.0 * (torque / waist.stall + speed / waist.no_load)
    command = simulated("arm4").inverse(MIDDLE[None], qd, np.zeros((1, 4)))[0, 0]
    assert command == pytest.approx(expected, rel=1e-6)
