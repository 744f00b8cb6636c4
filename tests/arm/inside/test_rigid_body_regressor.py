"""The closed-form regressor and the transmission against MuJoCo's own inverse dynamics and moments."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from rigid_examples import ACTUATOR_OF_AXIS, AWKWARD, NAMES

from etude.errors import NumericalError, UsageError
from etude_arm.physics.kinematics import body_motion
from etude_arm.physics.regressor import nominal_parameters, regressor
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco
from etude_arm.physics.transmission import DriveMotion, drive_motion


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(AWKWARD)


@pytest.fixture(scope="module")
def states() -> tuple[np.ndarray, ...]:
    return tuple(np.random.default_rng(3).normal(size=(3, 25, len(NAMES))))


def _at(model: mujoco.MjModel, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for axis, name in enumerate(NAMES):
        joint = model.joint(name)
        data.qpos[joint.qposadr], data.qvel[joint.dofadr] = q[axis], qd[axis]
        data.qacc[joint.dofadr] = qdd[axis]
    mujoco.mj_inverse(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return data


def test_regressor_times_parameters_is_mujocos_inverse_dynamics(model, states) -> None:
    tree = tree_from_mujoco(model, NAMES)
    torque = regressor(tree, *states) @ nominal_parameters(tree)
    columns = [int(model.joint(name).dofadr[0]) for name in NAMES]
    for row, state in enumerate(zip(*states, strict=True)):
        expected = _at(model, *state).qfrc_inverse[columns]
        np.testing.assert_allclose(torque[row], expected, rtol=1e-10, atol=1e-11)


def test_regressor_is_linear_in_every_bodys_own_parameters(model, states) -> None:
    tree = tree_from_mujoco(model, NAMES)
    changed = mujoco.MjModel.from_xml_string(AWKWARD)
    rng = np.random.default_rng(5)
    changed.body_sameframe[:] = 0  # MuJoCo caches which centres of mass sit at the origin
    changed.body_mass[:] *= rng.uniform(0.5, 2.0, model.nbody)
    changed.body_ipos[:] += rng.normal(scale=0.1, size=(model.nbody, 3))
    changed.body_inertia[:] *= rng.uniform(0.9, 1.1, (model.nbody, 1))
    torque = regressor(tree, *states) @ nominal_parameters(tree_from_mujoco(changed, NAMES))
    columns = [int(model.joint(name).dofadr[0]) for name in NAMES]
    expected = _at(changed, *(part[0] for part in states)).qfrc_inverse[columns]
    np.testing.assert_allclose(torque[0], expected, rtol=1e-10, atol=1e-11)


def test_moments_and_speeds_are_mujocos(model, states) -> None:
    tree, drives = tree_from_mujoco(model, NAMES), drives_from_mujoco(model, NAMES)
    drive = drive_motion(tree, drives, body_motion(tree, *states), states[1], states[2])
    columns = [int(model.joint(name).dofadr[0]) for name in NAMES]
    for row, state in enumerate(zip(*states, strict=True)):
        data = _at(model, *state)
        dense = np.zeros((model.nu, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        for axis, name in ACTUATOR_OF_AXIS.items():
            actuator = model.actuator(name).id
            # a joint's own actuator: its command is the force at the joint, behind the gear
            gear = model.actuator_gear[actuator, 0] if axis == name else 1.0
            moment, velocity = dense[actuator, columns] / gear, data.actuator_velocity[actuator] / gear
            np.testing.assert_allclose(drive.moment[row, NAMES.index(axis)], moment, rtol=1e-10, atol=1e-12)
            assert drive.speed[row, NAMES.index(axis)] == pytest.approx(velocity)
    np.testing.assert_array_equal(drive.moment[:, NAMES.index("tilt")], np.tile(np.eye(5)[2], (25, 1)))


def test_drive_acceleration_is_the_derivative_of_its_speed(model, states) -> None:
    tree, drives = tree_from_mujoco(model, NAMES), drives_from_mujoco(model, NAMES)
    q, qd, qdd = states
    h = 1e-5

    def speed(dt: float) -> np.ndarray:
        moved = (q + dt * qd + 0.5 * dt**2 * qdd, qd + dt * qdd, qdd)
        return drive_motion(tree, drives, body_motion(tree, *moved), moved[1], qdd).speed

    exact = drive_motion(tree, drives, body_motion(tree, *states), qd, qdd).acceleration
    np.testing.assert_allclose((speed(h) - speed(-h)) / (2 * h), exact, rtol=1e-6, atol=1e-6)


def test_power_is_the_same_at_joints_and_drives(model, states) -> None:
    tree, drives = tree_from_mujoco(model, NAMES), drives_from_mujoco(model, NAMES)
    drive = drive_motion(tree, drives, body_motion(tree, *states), states[1], states[2])
    torque = np.random.default_rng(0).normal(size=states[0].shape)
    force = drive.to_drive(torque)
    np.testing.assert_allclose(
        np.sum(force * drive.speed, axis=1), np.sum(torque * states[1], axis=1), rtol=1e-8
    )


def test_a_drive_without_lever_is_an_error() -> None:
    still = np.zeros((1, 1))
    with pytest.raises(NumericalError, match="cannot hold the robot"):
        DriveMotion(np.zeros((1, 1, 1)), still, still).to_drive(np.ones((1, 1)))


def test_unknown_and_impossible_axes_are_refused(model) -> None:
    with pytest.raises(UsageError, match=r"no joint named shoulder.*its joints: turn, slide"):
        tree_from_mujoco(model, ("turn", "shoulder"))
    body = "<body><joint name='free' type='free'/><geom size='.1'/></body>"
    floating = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(UsageError, match="neither hinge nor sliding"):
        tree_from_mujoco(floating, ("free",))
