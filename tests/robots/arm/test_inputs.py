"""The feature map: layout, exact pull-back, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from etude.models.features import FeatureMap
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import UsageError


def test_layout_is_position_velocity_acceleration_friction() -> None:
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 5, 2))
    X = FeatureMap(2, np.array([0.1, 0.4])).transform(q, qd, qdd)
    assert X.shape == (5, 8)
    np.testing.assert_array_equal(X[:, :6], np.hstack([q, qd, qdd]))
    np.testing.assert_allclose(X[:, 7], np.tanh(qd[:, 1] / 0.4), rtol=1e-15)


def test_thesis_inputs_have_no_friction_column() -> None:
    features = FeatureMap(3)
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 4, 3))
    assert features.width == 9
    np.testing.assert_array_equal(features.transform(q, qd, qdd), np.hstack([q, qd, qdd]))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), friction=st.booleans())
def test_pullback_is_the_complex_step_derivative(seed: int, friction: bool) -> None:
    rng = np.random.default_rng(seed)
    features = FeatureMap(3, rng.uniform(0.1, 1.0, 3) if friction else None)
    motion = list(rng.normal(size=(3, 4, 3)))
    G = rng.normal(size=(4, features.width))
    pulled = features.pullback(*motion, G)
    for part in range(3):
        for row, axis in np.ndindex(4, 3):
            bent = [m.astype(complex) for m in motion]
            bent[part][row, axis] += 1e-30j
            slope = np.sum(G * features.transform(*bent)).imag / 1e-30
            assert pulled[part][row, axis] == pytest.approx(slope, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("v0", [[0.1], [0.1, 0.0], [0.1, -1.0], [np.nan, 0.1], [[0.1, 0.1]]])
def test_impossible_friction_velocities_are_refused(v0: list[float]) -> None:
    with pytest.raises(UsageError, match="one positive number"):
        FeatureMap(2, np.array(v0))


def test_wrong_shapes_are_refused() -> None:
    features = FeatureMap(2)
    good = np.zeros((4, 2))
    with pytest.raises(UsageError, match="qd must have one column"):
        features.transform(good, np.zeros((3, 2)), good)
    with pytest.raises(UsageError, match="one column for each axis"):
        features.transform(np.zeros((4, 3)), good, good)
    with pytest.raises(UsageError, match="samples, features"):
        features.pullback(good, good, good, np.zeros((4, 7)))
