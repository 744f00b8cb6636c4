"""Learned commands: clipped, faded where the model knows nothing, refused when not finite; a real model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from arm_examples import Swing, simulated

from etude.errors import NumericalError, UsageError
from etude.models import ModelConfig, select_structures, trusted
from etude.types import Log, Motion
from etude_arm import ArmInputs, ArmSpec, Axis, PerfectController
from etude_arm.controller import ModelController
from etude_arm.preprocessing import ArmData, samples_of

AXES = tuple(Axis(n, -1, 1, 1, 1, c) for n, c in (("a", 100.0), ("b", 5.0)))
SPEC = ArmSpec("two", AXES, "N m", 100.0)
STILL = Motion(np.arange(3) / 100.0, np.zeros((3, 3, 2)))


@dataclass
class Constant:
    """Predicts the same mean and variance everywhere."""

    mean: tuple[float, ...]
    variance: tuple[float, ...] = (0.0, 0.0)
    fallback: tuple[float, ...] = (0.0, 0.0)
    signal_deviation: np.ndarray = field(default_factory=lambda: np.array([10.0, 2.0]))
    inputs: ArmInputs = field(default_factory=lambda: ArmInputs.of(SPEC, 0.02))

    def predict(self, log: Log) -> tuple[np.ndarray, np.ndarray]:
        mean, variance, safe = (np.tile(v, (len(log), 1)) for v in (self.mean, self.variance, self.fallback))
        return trusted(mean, variance, self.signal_deviation, safe), variance

    def faded(self, log: Log) -> np.ndarray:
        return self.predict(log)[0]


def planned(model: Constant) -> np.ndarray:
    return ModelController(model, SPEC).planned(STILL)


def test_a_sure_model_is_taken_as_it_is_within_the_command_limits() -> None:
    np.testing.assert_array_equal(planned(Constant((-30.0, 40.0))), np.tile([-30.0, 5.0], (3, 1)))


def test_a_model_that_knows_nothing_leaves_it_to_what_is_safe() -> None:
    lost = Constant((-30.0, 3.0), variance=(100.0, 4.0))
    np.testing.assert_array_equal(planned(lost), 0.0)
    np.testing.assert_array_equal(planned(replace(lost, fallback=(7.0, -1.0))), np.tile([7.0, -1.0], (3, 1)))


def test_each_joint_fades_by_its_own_uncertainty() -> None:
    half = Constant((-30.0, 3.0), variance=(1.0, 4.0))
    np.testing.assert_array_equal(planned(half), np.tile([-30.0, 0.0], (3, 1)))


def test_predictions_that_are_not_finite_are_refused_with_the_joint() -> None:
    row = {name: rows[0] for name, rows in Constant((0.0, 0.0)).inputs.states(STILL).values.items()}
    with pytest.raises(NumericalError, match=r"not finite \[b\]"):
        planned(Constant((1.0, np.nan)))
    for bad in (Constant((1.0, np.nan)), Constant((1.0, 1.0), variance=(0.0, np.inf))):
        with pytest.raises(NumericalError, match=r"not finite \[b\]"):
            ModelController(bad, SPEC).command(0.0, row)


def test_another_robots_model_is_refused() -> None:
    three = Constant((1.0,) * 3, (0.0,) * 3, (0.0,) * 3, np.ones(3))
    with pytest.raises(UsageError, match="3 commands, but the robot two has 2 joints"):
        planned(three)


def test_one_instant_is_a_row_of_the_plan() -> None:
    model = Constant((-30.0, 40.0), variance=(4.0, 1.0))
    controller = ModelController(model, SPEC)
    log = model.inputs.states(STILL)
    command, deviation = controller.command(0.0, {name: rows[0] for name, rows in log.values.items()})
    np.testing.assert_array_equal(command, planned(model)[0])
    np.testing.assert_array_equal(deviation, [2.0, 1.0])


@pytest.mark.slow
def test_a_learned_model_halves_the_error_of_feedback_alone_and_the_exact_inverse_is_better() -> None:
    robot = simulated()
    swing = Swing(robot)
    log = robot.run(swing, None, np.random.default_rng(0))
    samples = samples_of(robot.spec, ArmData(), [log], [np.zeros(len(log), dtype=np.int64)])
    config = ModelConfig(rung="gp", points=200, fit_points=80, steps=15, calibrate=False)
    inputs = ArmInputs.of(robot.spec, 0.02)
    model = select_structures(samples, inputs, {}, robot.spec.command, config, np.random.default_rng(1)).model
    learned = ModelController(model, robot.spec)
    runs = [robot.run(swing, c, np.random.default_rng(2)) for c in (None, learned, PerfectController(robot))]
    pd, with_model, exact = (robot.error(run)[0].mean() for run in runs)
    assert with_model < 0.5 * pd
    assert exact < with_model
    plan = robot.planned(swing)  # grows to ten times as far, where commands fade
    grown = replace(plan, orders=plan.orders * np.linspace(1.0, 10.0, len(plan.t))[:, None])
    told = model.predict(inputs.states(grown))
    part = np.abs(told.mean - model.predict(inputs.states(grown), fade=False).mean) > 1e-6
    assert 0.1 < part.mean() < 0.9
    np.testing.assert_allclose(model.faded(inputs.states(grown)), told.mean, rtol=0, atol=1e-9)
    whole = model.posterior(inputs.states(plan))
    for j in range(robot.spec.dof):
        alone = model.of_command(j)
        assert alone.in_use
        for found, known in zip(alone.posterior(inputs.states(plan)), whole, strict=True):
            np.testing.assert_array_equal(found[:, j], known[:, j])
