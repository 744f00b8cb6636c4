"""What models of arms look at: layout, one map for plans and logs, exact pull-back, the stick gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.errors import UsageError
from etude.types import Log, Motion, Samples
from etude_arm import ArmInputs, ArmSpec, Axis
from etude_arm.inputs import stick_gains

SPEC = ArmSpec(
    "two", tuple(Axis(n, -2.0, 2.0, v, 8.0, 90.0) for n, v in (("a", 2.0), ("b", 20.0))), "A", 100.0
)
THESIS = ArmInputs.of(SPEC, 0.0, desired=True)
FRICTION = ArmInputs.of(SPEC, 0.02)


def motion(seed: int = 0, count: int = 40, orders: int = 3) -> Motion:
    rng = np.random.default_rng(seed)
    return Motion(0.01 * np.arange(count), rng.normal(size=(orders, count, 2)))


def test_layout_is_position_velocity_acceleration_friction() -> None:
    m = motion()
    X = FRICTION.of_log(FRICTION.states(m))
    q, qd, qdd = m.orders
    np.testing.assert_array_equal(X[:, :6], np.hstack([q, qd, qdd]))
    np.testing.assert_array_equal(X[:, 6:8], np.tanh(qd / [0.04, 0.06]))  # of 3 rad/s at most
    np.testing.assert_array_equal(X[:, 10:], np.tanh(qd / [0.64, 0.96]))
    assert [column[:2] for column in FRICTION.columns[:3]] == [("q", "a"), ("q", "b"), ("qd", "a")]
    assert FRICTION.columns[7] == ("qd", "b", "1", "tanh")
    assert len(FRICTION.columns) == X.shape[1]


def test_the_thesis_looks_at_the_plan_and_has_no_friction_column() -> None:
    m = motion()
    log = THESIS.states(m)
    measured = log.put(log.channels["q"], log["q"] + 1.0)
    np.testing.assert_array_equal(THESIS.of_log(measured), np.hstack(list(m.orders)))
    assert [column[0] for column in THESIS.columns[::2]] == ["q_des", "qd_des", "qdd_des"]
    with pytest.raises(KeyError, match="no channel 'q_des'"):
        THESIS.of_log(log.without("q_des"))


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), friction=st.booleans(), count=st.integers(1, 60))
def test_plans_logs_and_single_instants_give_the_same_inputs(seed: int, friction: bool, count: int) -> None:
    inputs, m = FRICTION if friction else THESIS, motion(seed, count)
    log = inputs.states(m)
    X = inputs.of_log(log)
    np.testing.assert_array_equal(inputs.plan(m).X, X)
    keep = np.arange(seed % 3, count, 3)
    np.testing.assert_array_equal(inputs.plan(m, keep).X, X[keep])
    rows = [inputs.step({n: v[i] for n, v in log.values.items()}, None)[0] for i in range(count)]
    np.testing.assert_array_equal(rows, X)


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), friction=st.booleans())
def test_pull_is_the_complex_step_derivative(seed: int, friction: bool) -> None:
    inputs = replace(FRICTION if friction else THESIS, stick_velocity=np.array([0.3, 0.0]))
    m, rng = motion(seed, 5), np.random.default_rng(seed)
    in_X, in_gains = rng.normal(size=(5, len(inputs.columns))), rng.normal(size=(5, 2))
    pulled = inputs.plan(m).vjp(in_X, in_gains)
    assert pulled.shape == m.orders.shape
    for place in np.ndindex(m.orders.shape):
        bent = m.orders.astype(complex)
        bent[place] += 1e-30j
        planned = inputs.plan(Motion(m.t, bent))
        slope = (np.sum(in_X * planned.X) + np.sum(in_gains * planned.gains)).imag / 1e-30
        assert pulled[place] == pytest.approx(slope, rel=1e-12, abs=1e-13)


def test_rates_are_the_derivatives_along_the_motion() -> None:
    t, inputs = np.linspace(0.3, 0.7, 4001), replace(FRICTION, friction_velocity=np.array([0.1, 0.4]))
    waves = [np.stack([w**k * np.sin(w * t + k * np.pi / 2) for w in (2.0, 3.0)], axis=1) for k in range(5)]
    m = Motion(t, np.stack(waves))
    found = inputs.rates(m)
    assert found is not None
    X = inputs.plan(m).X
    np.testing.assert_allclose(np.gradient(X, t, axis=0)[1:-1], found[0][1:-1], atol=2e-4)
    np.testing.assert_allclose(np.gradient(found[0], t, axis=0)[1:-1], found[1][1:-1], atol=2e-2)
    with pytest.raises(UsageError, match="5 orders, not 3"):
        FRICTION.rates(motion())


def test_tuning_takes_the_top_speed_of_what_stood_and_is_stored() -> None:
    m = motion(3)
    moving = np.abs(m.orders[1]) >= [0.4, 0.0]
    samples = Samples(FRICTION.states(m), np.zeros(40, dtype=np.int64), np.ones_like(moving), moving)
    fitted = FRICTION.fitted(samples)
    assert fitted.stick_velocity[0] == np.abs(m.orders[1, ~moving[:, 0], 0]).max()
    assert fitted.stick_velocity[1] == 0.0
    np.testing.assert_array_equal(FRICTION.restore(fitted.arrays()).stick_velocity, fitted.stick_velocity)
    np.testing.assert_array_equal(FRICTION.plan(m).gains, 1.0)


@given(st.floats(-1.0, 1.0), st.floats(1e-3, 0.5))
def test_gains_rise_through_zero_and_are_smooth(v: float, threshold: float) -> None:
    gain, slope = stick_gains(np.array([[v]]), np.array([threshold]))
    assert gain[0, 0] == pytest.approx(v / np.hypot(v, threshold), rel=1e-12)
    h = 1e-6 * threshold
    ahead, behind = (stick_gains(np.array([[v + s * h]]), np.array([threshold]))[0][0, 0] for s in (1, -1))
    assert slope[0, 0] == pytest.approx((ahead - behind) / (2 * h), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("v0", [[0.1], [0.1, 0.0], [0.1, -1.0], [np.nan, 0.1], [[0.1, 0.1]]])
def test_impossible_friction_velocities_are_refused(v0: list[float]) -> None:
    with pytest.raises(UsageError, match="one positive number"):
        replace(FRICTION, friction_velocity=np.array(v0))


def test_other_shapes_are_refused() -> None:
    log = FRICTION.states(motion())
    narrow = Log(log.t, log.channels, {**log.values, "qd": log["qd"][:, :1]})
    with pytest.raises(UsageError, match=r"qd has shape \(40, 1\), not \(40, 2\)"):
        FRICTION.of_log(narrow)
