"""Feedforward from a model: clipped, faded where the model knows nothing, refused when not finite."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.control.feedforward import model_feedforward, no_feedforward, trust
from etude.errors import NumericalError, UsageError
from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.samples import TrajectorySamples

SPEC = RobotSpec(
    name="two",
    axes=tuple(Axis(n, -1, 1, 1, 1, c) for n, c in (("a", 100.0), ("b", 5.0))),
    command_unit="N m",
    rate=100.0,
)


@dataclass
class Constant:
    """Predicts the same mean and variance everywhere; counts its calls."""

    mean: tuple[float, float]
    variance: tuple[float, float] = (0.0, 0.0)
    prior_deviation: np.ndarray = dataclasses.field(default_factory=lambda: np.array([10.0, 2.0]))
    fallback: object = None

    def predict(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.tile(self.mean, (len(q), 1)), np.tile(self.variance, (len(q), 1))


class Load:
    def predict(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        return np.tile([7.0, -1.0], (len(q), 1))


def _samples(count: int = 3) -> TrajectorySamples:
    zero = np.zeros((count, 2))
    return TrajectorySamples(np.arange(count) / 100.0, zero, zero, zero, zero)


def test_a_sure_model_is_taken_as_it_is_within_the_command_limits() -> None:
    command = model_feedforward(Constant((-30.0, 40.0)), SPEC)(_samples())
    np.testing.assert_array_equal(command, np.tile([-30.0, 5.0], (3, 1)))


def test_a_model_that_knows_nothing_is_silent_or_leaves_it_to_its_fallback() -> None:
    lost = Constant((-30.0, 3.0), variance=(100.0, 4.0))
    np.testing.assert_array_equal(model_feedforward(lost, SPEC)(_samples()), 0.0)
    np.testing.assert_array_equal(
        model_feedforward(dataclasses.replace(lost, fallback=Load()), SPEC)(_samples()),
        np.tile([7.0, -1.0], (3, 1)),
    )
    unfaded = model_feedforward(lost, SPEC, fade=False)(_samples())
    np.testing.assert_array_equal(unfaded, np.tile([-30.0, 3.0], (3, 1)))


def test_each_joint_fades_by_its_own_uncertainty() -> None:
    half = Constant((-30.0, 3.0), variance=(1.0, 4.0))
    np.testing.assert_array_equal(model_feedforward(half, SPEC)(_samples()), np.tile([-30.0, 0.0], (3, 1)))


@given(ratio=st.floats(0.0, 2.0), scale=st.floats(1e-3, 1e3))
def test_trust_falls_from_one_to_zero_and_does_not_depend_on_units(ratio: float, scale: float) -> None:
    prior = np.array([scale])
    weight, later = (trust(np.array([[r]]) * prior**2, prior)[0, 0] for r in (ratio, ratio + 0.01))
    assert 0.0 <= later <= weight + 1e-12 <= 1.0 + 1e-12
    np.testing.assert_allclose(weight, trust(np.array([[ratio]]), np.ones(1))[0, 0], atol=1e-9)


def test_trust_has_no_kinks() -> None:
    ratio = np.linspace(0.3, 1.1, 2001)
    weight = trust(ratio[:, None], np.ones(1))[:, 0]
    bend = np.diff(weight, 2) / np.diff(ratio)[0] ** 2
    assert np.abs(np.diff(bend)).max() < 0.02 * np.abs(bend).max()
    assert weight[0] == 1.0
    assert weight[-1] == 0.0


def test_no_feedforward_is_zero() -> None:
    np.testing.assert_array_equal(no_feedforward(SPEC)(_samples(4)), np.zeros((4, 2)))


def test_predictions_that_are_not_finite_are_refused_with_the_joint() -> None:
    for bad in (Constant((1.0, np.nan)), Constant((1.0, 1.0), variance=(0.0, np.inf))):
        with pytest.raises(NumericalError, match=r"not finite \[b\]"):
            model_feedforward(bad, SPEC)(_samples())


def test_another_robots_model_is_refused() -> None:
    with pytest.raises(UsageError, match="3 outputs, the robot two has 2 joints"):
        model_feedforward(Constant((1.0, 1.0), prior_deviation=np.ones(3)), SPEC)
