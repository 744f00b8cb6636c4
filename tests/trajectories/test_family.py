from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.trajectories import FourierConfig, FourierFamily, from_json, suited_to

CONFIGS = {
    "null space": FourierConfig(),
    "two periods": FourierConfig(3, 20.0, 4.0 * np.pi / 20.0),
    "ramp": FourierConfig(2, 30.0, 0.7, "ramp", 3.0),
    "neither": FourierConfig(2, 30.0, rest="none"),
}
FAMILIES = {name: FourierFamily.of(config, 3) for name, config in CONFIGS.items()}
FAMILIES["fixed centre"] = FourierFamily.of(CONFIGS["neither"], 3, (0.5, -0.2, None), samples=24)
FAMILIES["at rest about a fixed centre"] = FourierFamily.of(FourierConfig(4, 30.0), 3, (0.5, None, 0.0))
EVERY = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())


@EVERY
def test_parameters_and_trajectories(family: FourierFamily) -> None:
    p = np.random.default_rng(0).standard_normal(family.size)
    trajectory = family.trajectory(p)
    np.testing.assert_allclose(family.parameters(trajectory), p, atol=1e-13)
    np.testing.assert_allclose(family.parameters(trajectory.coefficients), p, atol=1e-13)
    assert from_json(trajectory.to_json()) == trajectory
    t = np.linspace(0.0, family.duration, 31)
    np.testing.assert_array_equal(family.motion(p, t, 4).orders, trajectory.motion(t, 4).orders)


@EVERY
def test_the_pull_is_the_gradient(family: FourierFamily) -> None:
    rng, t = np.random.default_rng(1), np.linspace(0.0, family.duration, 31)
    p, weights = rng.standard_normal(family.size), rng.standard_normal((3, 31, 3))
    still = family.motion(np.zeros(family.size), t, 3).orders
    numeric = [np.sum(weights * (family.motion(d, t, 3).orders - still)) for d in np.eye(family.size)]
    np.testing.assert_allclose(family.vjp(p, t, weights), numeric, rtol=1e-9, atol=1e-9)


@EVERY
@pytest.mark.parametrize("degree", [1, 2])
def test_rows_are_the_bound_in_the_parameters(family: FourierFamily, degree: int) -> None:
    p = np.random.default_rng(2).standard_normal(family.size)
    trajectory = family.trajectory(p)
    for order in range(4):
        rows, offset, kappa = family.rows(order, degree)
        values, amplitudes, proved = trajectory.bound(order, degree)
        assert kappa <= proved
        assert rows.shape == (*offset.shape, family.size)
        mine = (rows @ p + offset).T
        if family.samples == 64:
            np.testing.assert_allclose(mine, values, atol=1e-11 * amplitudes.max())
            assert kappa == proved
        largest = np.abs(trajectory.motion(np.linspace(0.0, family.duration, 5001), 4).orders[order])
        assert np.all(largest.max(axis=0) <= np.abs(mine).max(axis=0) / kappa * (1.0 + 1e-12))


def test_columns_are_orthonormal_and_those_of_an_axis_are_its_own() -> None:
    for family in FAMILIES.values():
        flat = family.basis.reshape(-1, family.size)
        np.testing.assert_allclose(flat.T @ flat, np.eye(family.size), atol=1e-13)
        assert np.all(np.any(family.basis != 0.0, axis=1).sum(axis=0) == 1)


def test_the_thesis_flight_has_thirteen_numbers_and_no_constant_in_x_and_y() -> None:
    family = FourierFamily.of(CONFIGS["neither"], 3, (0.0, 0.0, None))
    assert family.size == 13
    assert family.omega0 == pytest.approx(2.0 * np.pi / 30.0)
    np.testing.assert_array_equal(family.coefficients(np.arange(1.0, 14.0))[0], [0.0, 0.0, 9.0])


@pytest.mark.parametrize("name", ["null space", "two periods", "ramp", "at rest about a fixed centre"])
def test_rest_at_both_ends_costs_two_numbers_an_axis(name: str) -> None:
    family = FAMILIES[name]
    ends = family.trajectory(np.random.default_rng(3).standard_normal(family.size)).motion(
        np.array([0.0, family.duration])
    )
    np.testing.assert_allclose(ends.orders[1:], 0.0, atol=1e-11)
    if family.config.rest == "nullspace":
        fixed = 2 if "fixed" in name else 0
        assert family.size == 3 * (2 * family.config.harmonics - 1) - fixed


def test_omega0_is_drawn_from_whole_periods_or_from_the_range() -> None:
    rng = np.random.default_rng(0)
    by_periods = FourierConfig(duration=60.0, omega0=(0.1, 0.35))
    assert by_periods.whole_periods == pytest.approx([2 * np.pi / 60 * k for k in (1, 2, 3)])
    family = FourierFamily.of(by_periods, 2)
    assert {family.drawn(rng).omega0 for _ in range(50)} == set(by_periods.whole_periods)
    for rest in ("ramp", "none"):
        free = FourierFamily.of(FourierConfig(omega0=(0.1, 0.35), rest=rest), 2)
        drawn = [free.drawn(rng).omega0 for _ in range(200)]
        assert 0.1 <= min(drawn) < 0.12
        assert 0.33 < max(drawn) <= 0.35
    assert FourierConfig(duration=30.0).omega0_range == pytest.approx((2 * np.pi / 30,) * 2)


def test_a_family_with_nothing_to_draw_stays_the_same() -> None:
    family = FAMILIES["two periods"]
    assert family.drawn(np.random.default_rng(0)) is family


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"harmonics": 0}, "harmonics >= 1"),
        ({"harmonics": 1}, "at least 2 harmonics"),
        ({"duration": 0.0}, "duration"),
        ({"duration": -5.0}, "duration"),
        ({"duration": float("nan")}, "duration"),
        ({"omega0": (0.3, 0.2)}, "0 < omega0"),
        ({"omega0": -1.0}, "0 < omega0"),
        ({"omega0": (0.11, 0.19)}, "no whole number of periods"),
        ({"omega0": 0.3, "duration": 30.0}, "no whole number of periods"),
        ({"rest": "sudden"}, "'nullspace', 'ramp' or 'none'"),
        ({"rest": "ramp", "ramp": 31.0}, "ramps of 31.0 s do not fit"),
        ({"rest": "ramp", "ramp": 0.0}, "ramps of 0.0 s do not fit"),
    ],
)
def test_impossible_numbers(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        FourierConfig(**options)


def test_constants_and_coefficients_that_do_not_fit() -> None:
    with pytest.raises(UsageError, match="3 axes need as many"):
        FourierFamily.of(FourierConfig(), 3, (0.0, None))
    with pytest.raises(UsageError, match="3 axes need as many"):
        FourierFamily.of(FourierConfig(), 3, (0.0, None, float("inf")))
    with pytest.raises(UsageError, match=r"shape \(11, 3\), not \(5, 3\)"):
        FAMILIES["null space"].parameters(np.zeros((5, 3)))


def periods(velocity: float, acceleration: float) -> float:
    one, two = np.array([velocity]), np.array([acceleration])
    config = suited_to(FourierConfig(), np.array([-1.0]), np.array([1.0]), one, two)
    return config.omega0_range[0] * 60.0 / (2.0 * np.pi)


def test_a_fast_robot_gets_shorter_periods_but_none_below_ten_seconds() -> None:
    assert periods(0.05, 10.0) == pytest.approx(1.0)
    assert periods(2.0, 100.0) == pytest.approx(6.0)
    assert periods(2.0, 1.0) == pytest.approx(4.0), "the acceleration limit binds first"


def test_an_omega0_that_was_given_stays() -> None:
    config = FourierConfig(omega0=0.3, rest="ramp")
    assert suited_to(config, -np.ones(1), np.ones(1), np.ones(1), np.ones(1)) is config
