"""Identification: base parameters reproduce torques, the truth comes back, the mask and the units do not
matter.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from rigid_examples import AWKWARD, NAMES, awkward_spec, motion_of, samples_of, smooth_motion

from etude._runtime.operators import cross
from etude.errors import DataError, UsageError
from etude.types import Samples, joined_samples
from etude_arm.physics.base_parameters import base_directions, parameter_scale, spread_states
from etude_arm.physics.identification import (
    LEAST_CORRELATION,
    Clock,
    fitted,
    output_priors,
    require_axes,
    shared_directions,
)
from etude_arm.physics.regressor import nominal_parameters, regressor
from etude_arm.physics.rigid_body import (
    NARROW,
    SPEED,
    Regressors,
    RigidBody,
    RigidBodyModel,
    command_regressors,
    waves,
)
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco

V0 = np.full(5, 0.02)


def with_command(samples: Samples, command: np.ndarray) -> Samples:
    """The samples with other commands."""
    return replace(samples, log=samples.log.put(samples.log.channels["command"], command))


def identify(
    samples, motion, spec, tree, drives, v0, forces: bool = False, wave: np.ndarray | None = None
) -> RigidBodyModel:
    body = RigidBody(tree, drives, v0)
    require_axes(samples, spec, tree, drives)
    regressors = Regressors(*command_regressors(*body, *motion), None, wave)
    shared = shared_directions(spec, *body) if forces else None
    return fitted(samples, regressors, output_priors(spec, *body), spec.names, body, shared)


NOISE = 0.1


@pytest.fixture(scope="module")
def robot():
    model = mujoco.MjModel.from_xml_string(AWKWARD)
    return tree_from_mujoco(model, NAMES), drives_from_mujoco(model, NAMES)


@pytest.fixture(scope="module")
def truth(robot) -> RigidBodyModel:
    """The robot with inertial parameters 30 % off its file's, motors of different gain, and friction."""
    tree, drives = robot
    rng = np.random.default_rng(1)
    gain = np.array([2.0, 0.5, 3.0, 1.0, 0.1])
    inertial = nominal_parameters(tree) * np.exp(0.3 * rng.normal(size=nominal_parameters(tree).shape))
    extra = gain[:, None] * np.array([0.1, 2.0, 3.0, 0.0, 0.0, 0.4])
    return RigidBodyModel(
        tree,
        drives,
        V0,
        np.outer(gain, inertial),
        extra,
        np.zeros(5, dtype=int),
        np.zeros(5),
        0 * extra,
        np.zeros(5),
    )


@pytest.fixture(scope="module")
def data(truth):
    return samples_of(truth, np.random.default_rng(2), 1200, NOISE)


def test_base_parameters_reproduce_every_torque(robot) -> None:
    tree, _ = robot
    spec = awkward_spec()
    rng = np.random.default_rng(4)
    joints = regressor(tree, *spread_states(spec, 300))
    fresh = regressor(tree, *rng.normal(size=(3, 40, 5)))
    scale = parameter_scale(tree)
    phi = scale * rng.normal(size=scale.shape)
    for j in range(5):
        basis = base_directions(joints[:, j], scale)
        kept = basis @ (np.linalg.pinv(basis / scale[:, None]) @ (phi / scale))
        assert basis.shape[1] < len(phi)
        np.testing.assert_allclose(fresh[:, j] @ kept, fresh[:, j] @ phi, rtol=1e-6, atol=1e-6)


def test_the_number_of_base_parameters_of_a_pendulum_is_three() -> None:
    """About a horizontal axis: the moment of inertia and the two first moments across the axis."""
    body = "<body><joint name='j' axis='0 1 0'/><geom size='.1' pos='.1 0 .2'/></body>"
    xml = f"<mujoco><worldbody>{body}</worldbody></mujoco>"
    tree = tree_from_mujoco(mujoco.MjModel.from_xml_string(xml), ("j",))
    states = spread_states(replace(awkward_spec(), axes=awkward_spec().axes[:1]), 100)
    assert base_directions(regressor(tree, *states)[:, 0], parameter_scale(tree)).shape[1] == 3


def test_identified_model_predicts_an_unseen_motion_to_a_fraction_of_the_noise(robot, truth, data) -> None:
    model = identify(data, motion_of(data), awkward_spec(), *robot, V0)
    motion = smooth_motion(np.random.default_rng(9), 400, 5)[1:]
    error = model.predict(*motion) - truth.predict(*motion)
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.5 * NOISE)
    np.testing.assert_allclose(model.deviation, NOISE, rtol=0.15)


def test_with_little_data_the_nominal_model_keeps_it_sane(robot, truth) -> None:
    few = samples_of(truth, np.random.default_rng(2), 120, NOISE)
    model = identify(few, motion_of(few), awkward_spec(), *robot, V0)
    motion = smooth_motion(np.random.default_rng(9), 400, 5)[1:]
    wanted = truth.predict(*motion)
    assert np.all(np.std(model.predict(*motion) - wanted, axis=0) < 0.7 * np.std(wanted, axis=0))


def test_what_the_mask_hides_changes_nothing(robot, data) -> None:
    assert np.all((~data.moving).any(axis=0))
    spoiled = with_command(data, np.where(data.moving, data.command, 1e3))
    for name in ("inertial", "extra", "deviation"):
        np.testing.assert_array_equal(
            getattr(identify(spoiled, motion_of(spoiled), awkward_spec(), *robot, V0), name),
            getattr(identify(data, motion_of(data), awkward_spec(), *robot, V0), name),
        )


def test_the_unit_of_the_command_does_not_matter(robot, data) -> None:
    spec = awkward_spec()
    scaled_spec = replace(spec, axes=tuple(replace(a, command=a.command * 1000) for a in spec.axes))
    model = identify(data, motion_of(data), spec, *robot, V0)
    scaled = identify(with_command(data, data.command * 1000), motion_of(data), scaled_spec, *robot, V0)
    np.testing.assert_allclose(scaled.inertial, 1000 * model.inertial, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(scaled.deviation, 1000 * model.deviation, rtol=1e-6)


def test_the_order_of_the_samples_does_not_matter(robot, data) -> None:
    halves = [data.take(np.arange(600, 1200)), data.take(np.arange(600))]
    parts = [replace(half, group=np.full(600, k)) for k, half in enumerate(halves)]
    swapped = joined_samples(parts)
    first, second = (identify(d, motion_of(d), awkward_spec(), *robot, V0) for d in (data, swapped))
    np.testing.assert_allclose(first.extra, second.extra, rtol=1e-6, atol=1e-8)


def test_bad_data_is_refused(robot, data) -> None:
    moving = data.moving.copy()
    moving[:, 3] = False
    with pytest.raises(DataError, match=r"never moves.*reach"):
        identify(replace(data, moving=moving), motion_of(data), awkward_spec(), *robot, V0)
    with pytest.raises(UsageError, match="same axes"):
        identify(data, motion_of(data), replace(awkward_spec(), axes=awkward_spec().axes[:3]), *robot, V0)


def test_cross_products_are_numpys_to_the_bit() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((2, 40, 3))
    assert np.array_equal(cross(a, b), np.cross(a, b))
    assert np.array_equal(cross(a[0], b), np.cross(a[0], b))
    assert np.array_equal(cross(a, b[0]), np.cross(a, b[0]))


FEW = 150  # samples: enough for a motion of its kind, too few for parameters of each command


def test_forces_share_one_rigid_body_and_tell_more_of_new_motion(robot, truth) -> None:
    one = replace(truth, inertial=np.tile(truth.inertial[3], (5, 1)))  # that of gain 1
    few = samples_of(one, np.random.default_rng(8), FEW, NOISE)
    new = spread_states(awkward_spec(), 300)
    error = []
    for forces in (False, True):
        found = identify(few, motion_of(few), awkward_spec(), *robot, V0, forces)
        left = (found.predict(*new) - one.predict(*new)) / awkward_spec().command
        error.append(float(np.sqrt(np.mean(left**2))))
    assert error[1] < 0.7 * error[0], error


@pytest.mark.parametrize("output", [1, 3])
def test_a_command_of_another_scale_keeps_parameters_of_its_own(robot, truth, output: int) -> None:
    scale = np.where(np.arange(5) == output, 3.0, 1.0)[:, None]
    other = replace(truth, inertial=scale * truth.inertial[3], extra=scale * truth.extra[3])
    data = samples_of(other, np.random.default_rng(9), 1200, NOISE)
    found = identify(data, motion_of(data), awkward_spec(), *robot, V0, forces=True)
    alone = identify(data, motion_of(data), awkward_spec(), *robot, V0)
    np.testing.assert_array_equal(found.inertial[output], alone.inertial[output])
    rest = np.delete(found.inertial, output, axis=0)
    np.testing.assert_array_equal(rest, np.tile(rest[0], (4, 1)))


def slowly(one: RigidBodyModel, part: float) -> Samples:
    """Its commands along a motion of a part of the size and of the speed."""
    data = samples_of(one, np.random.default_rng(8), 400, 0.0)
    log = data.log
    for name in ("q", "qd", "qdd"):
        log = log.put(log.channels[name], part * log[name])
    command = one.predict(*(log[name] for name in ("q", "qd", "qdd")))
    moving = np.abs(log["qd"]) >= 0.015
    return replace(data, log=log.put(log.channels["command"], command), moving=moving)


def test_what_returns_with_a_position_does_not_become_mass(robot, truth) -> None:
    """A narrow motion with cogging of a hundredth of the limit: gravity elsewhere stays as the file says."""
    one = replace(truth, inertial=np.tile(nominal_parameters(robot[0]), (5, 1)))
    data = slowly(one, 0.15)
    cogging = 0.01 * awkward_spec().command * np.sin(3.0 * data.log["q"] + np.arange(5))
    log, (q, _, _) = with_command(data, data.command + cogging), spread_states(awkward_spec(), 300)
    error = []
    for wave in (None, waves(data.log["q"])):
        found = identify(log, motion_of(log), awkward_spec(), *robot, V0, True, wave)
        assert found.ripple is None
        error.append(np.std(found.predict(q, 0 * q, 0 * q) - one.predict(q, 0 * q, 0 * q), axis=0))
    assert np.median(error[1] / error[0]) < 0.6, error


def test_friction_that_falls_with_speed_is_not_continued_to_the_top_speed(robot, truth) -> None:
    """Stribeck's dip, all that a slow motion shows: viscous friction stays a small part of the limit."""
    one = replace(truth, inertial=np.tile(truth.inertial[3], (5, 1)), extra=0.0 * truth.extra)
    data, limit = slowly(one, 0.15), awkward_spec().command
    speed = data.log["qd"]
    dip = 0.03 * limit * np.sign(speed) * (1.0 + np.exp(-((speed / 0.05) ** 2)))
    log = with_command(data, data.command + dip)
    spec = replace(awkward_spec(), command_unit="N m")
    found = identify(log, motion_of(log), spec, *robot, V0, forces=True)
    _, drive = command_regressors(*robot, V0, *spread_states(awkward_spec(), 300))
    at_top = np.abs(found.extra[:, SPEED]) * np.abs(drive[..., SPEED]).max(axis=0)
    assert (at_top < 0.15 * limit).all(), at_top / limit


def test_a_last_link_without_mass_is_learned(robot, truth) -> None:
    """A file whose last link has no inertia, on a robot that has one."""
    tree, drives = robot
    one = replace(truth, inertial=np.tile(truth.inertial[3], (5, 1)))
    bare = tree.nominal.copy()
    bare[tree.joint_body[3]] = 0.0
    data = samples_of(one, np.random.default_rng(2), 1200, NOISE)
    found = identify(
        data, motion_of(data), awkward_spec(), replace(tree, nominal=bare), drives, V0, forces=True
    )
    motion = smooth_motion(np.random.default_rng(9), 400, 5)[1:]
    error = found.predict(*motion) - one.predict(*motion)
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < NOISE)


STEP = 0.05


@pytest.mark.parametrize("a", [0.0, 0.6, 0.97])
def test_an_autoregressive_residual_lasts_as_long_as_theory_says(a: float) -> None:
    """(1 + a) / (1 - a) steps; gaps and other recordings do not count as neighbours."""
    rng, n = np.random.default_rng(4), 40_000
    left = rng.normal(size=n)
    for i in range(1, n):
        left[i] += a * left[i - 1]
    t, group = STEP * np.arange(n), np.repeat([0, 1], n // 2)
    keep = np.arange(n) % 500 < 400  # a gap in every 25 s
    clock = Clock(t[keep], group[keep])
    time = (1.0 + a) / (1.0 - a) * STEP
    assert clock.correlation_time(left[keep]) == pytest.approx(time, rel=0.2)
    assert clock.information(left[keep]) == pytest.approx(STEP / max(time, LEAST_CORRELATION), rel=0.2)


def test_what_lasts_tells_less_than_noise_of_its_size(robot, truth) -> None:
    one = replace(truth, inertial=np.tile(truth.inertial[3], (5, 1)))
    few = samples_of(one, np.random.default_rng(8), 400, 0.0)
    rng, size = np.random.default_rng(3), 0.05 * awkward_spec().command
    slow = np.repeat(rng.normal(size=(20, 5)), 20, axis=0)
    deviation = []
    for disturbance in (rng.permutation(slow), slow):
        log = with_command(few, few.command + size * disturbance)
        found = identify(log, motion_of(log), awkward_spec(), *robot, V0, forces=True)
        deviation.append(found.extra_deviation[:, NARROW] / awkward_spec().command)
    assert np.median(deviation[1] / deviation[0]) > 1.5, deviation  # those near their prior change less
