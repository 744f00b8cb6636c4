"""The physics of arms as means over logs: measured and planned alike, static part, stored bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import Swing, simulated

from etude.errors import DataError, UsageError
from etude.types import Samples
from etude_arm import ArmInputs, ArmPhysics
from etude_arm.physics.mean import RigidBodyMean, physics_of
from etude_arm.preprocessing import ArmData, samples_of

ROBOT = simulated()
SPEC = ROBOT.spec


@pytest.fixture(scope="module")
def samples() -> Samples:
    log = ROBOT.run(Swing(ROBOT), None, np.random.default_rng(0))
    return samples_of(SPEC, ArmData(), [log], [np.zeros(len(log), dtype=np.int64)])


@pytest.fixture(scope="module")
def mean(samples: Samples) -> RigidBodyMean:
    return physics_of(SPEC, 0.02, False)["identified"](samples)


def test_the_identified_mean_explains_the_commands(samples: Samples, mean: RigidBodyMean) -> None:
    left = np.where(samples.moving, samples.command - mean.predict(samples.log), 0.0)
    assert (left.std(axis=0) < 0.15 * samples.command.std(axis=0)).all()


def test_a_plan_is_predicted_as_a_log_of_it_would_be(mean: RigidBodyMean) -> None:
    plan = Swing(ROBOT).motion(np.linspace(0.0, 40.0, 50))
    log = ArmInputs.of(SPEC, 0.02).states(plan)
    np.testing.assert_array_equal(mean.predict(log), mean.model.predict(*plan.orders))
    desired = replace(mean, desired=True)
    elsewhere = log.put(log.channels["q"], log["q"] + 1.0)
    np.testing.assert_array_equal(desired.predict(elsewhere), mean.predict(log))


def test_the_static_part_is_the_command_at_rest(mean: RigidBodyMean) -> None:
    inputs, plan = ArmInputs.of(SPEC, 0.02), Swing(ROBOT).motion(np.linspace(0.0, 40.0, 50))
    still = replace(plan, orders=np.stack([plan.orders[0], *np.zeros((2, 50, 4))]))
    static = mean.static(inputs.states(plan))
    np.testing.assert_array_equal(static, mean.predict(inputs.states(still)))
    assert np.abs(static[:, 0]).max() < np.abs(static[:, 1]).max()  # the waist turns about the vertical


def test_arrays_make_it_again_bit_for_bit_without_the_model_file(samples: Samples, mean) -> None:
    lost = ArmPhysics(replace(SPEC, model_file=None))
    again = lost.restore(mean.arrays())
    np.testing.assert_array_equal(again.predict(samples.log), mean.predict(samples.log))
    assert again.parameters() == mean.parameters()
    assert not any(array.dtype == object for array in mean.arrays().values())


def test_parameters_have_deviations_and_a_nominal_model_knows_none(mean: RigidBodyMean) -> None:
    found = mean.parameters()
    assert set(list(found)[:2]) == {"waist armature", "waist viscous"}
    assert all(np.isfinite(deviation) and deviation > 0 for _, deviation in found.values())
    nominal = physics_of(replace(SPEC, command_unit="N m"), 0.0, False)["nominal"](None)
    assert all(value == 0.0 and np.isinf(deviation) for value, deviation in nominal.parameters().values())


def test_which_rungs_there_are() -> None:
    assert set(physics_of(SPEC, 0.02, False)) == {"identified"}  # pwm is no force
    assert set(physics_of(replace(SPEC, command_unit="N m"), 0.02, False)) == {"identified", "nominal"}
    assert physics_of(replace(SPEC, model_file=None), 0.02, False) == {}
    with pytest.raises(UsageError, match="no model_file"):
        _ = ArmPhysics(replace(SPEC, model_file=None)).geometry
    with pytest.raises(UsageError, match="needs samples"):
        ArmPhysics(SPEC)(None)


def test_samples_that_say_nothing_are_not_learned_from(samples: Samples) -> None:
    physics = ArmPhysics(SPEC)
    usable = samples.usable.copy()
    usable[::7] = False
    spoilt = np.where(usable, samples.command, 1e4)
    log = samples.log.put(samples.log.channels["command"], spoilt)
    one = physics(replace(samples, usable=usable))
    other = physics(replace(samples, usable=usable, log=log))
    np.testing.assert_array_equal(one.predict(log), other.predict(log))
    with pytest.raises(DataError, match=r"never moves.*waist"):
        physics(replace(samples, usable=np.zeros_like(usable)))


def test_regressors_tell_the_command_of_an_identified_model(samples: Samples, mean: RigidBodyMean) -> None:
    """Some weights of the features give each command; their gradient is that of differences."""
    X = ArmInputs.of(SPEC, 0.02).of_log(samples.log)
    wanted = mean.predict(samples.log)
    for j, regressor in enumerate(ArmPhysics(SPEC).regressors()):
        features = regressor.transform(X)
        weights = np.linalg.lstsq(features, wanted[:, j], rcond=None)[0]
        np.testing.assert_allclose(features @ weights, wanted[:, j], atol=1e-6 * np.abs(wanted).max())
    G = np.random.default_rng(0).normal(size=(3, features.shape[1]))
    pulled = regressor.pullback(X[:3], G)
    for row, column in ((0, 1), (1, 6), (2, 10)):
        bent = [X[:3].copy(), X[:3].copy()]
        bent[0][row, column] += 1e-5
        bent[1][row, column] -= 1e-5
        ends = [np.sum(G * regressor.transform(b)) for b in bent]
        assert pulled[row, column] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-3)
