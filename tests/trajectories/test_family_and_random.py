from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trajectory_examples import FAMILIES, robot

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.certificate import certify
from etude.trajectories.family import TrajectoryFamily, suited_to
from etude.trajectories.gauge import certified_rows
from etude.trajectories.random import random_trajectory


@given(st.integers(2, 10), st.floats(5.0, 100.0), st.integers(1, 3), st.booleans(), st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_every_random_member_is_certified(
    harmonics: int, duration: float, periods: int, ramped: bool, seed: int
) -> None:
    low = 2.0 * np.pi / duration
    rest = "ramp" if ramped else "nullspace"
    family = TrajectoryFamily(harmonics, duration, (0.9 * low, (periods + 0.1) * low), rest, 1.0)
    spec, rng = robot(seed % 50), np.random.default_rng(seed)
    for scale in ("limits", "amplitude"):
        assert certify(random_trajectory(rng, spec, family, scale), spec).ok


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
def test_scaled_to_the_limits_means_that_every_joint_touches_one(family) -> None:
    spec, rng = robot(4), np.random.default_rng(4)
    for _ in range(10):
        certificate = certify(random_trajectory(rng, spec, family), spec)
        width = {row.axis: 0.0 for row in certificate.rows}
        for row in certificate.rows:
            used = (row.proved_upper - row.proved_lower) / (row.upper - row.lower)
            peak = max(row.proved_upper / row.upper, row.proved_lower / row.lower)
            width[row.axis] = max(width[row.axis], used if row.quantity == "position" else peak)
        assert np.allclose(list(width.values()), 1.0, atol=1e-6)


def test_random_amplitudes_are_smaller_and_differ() -> None:
    spec, family = robot(4), FAMILIES["nullspace"]
    full = random_trajectory(np.random.default_rng(0), spec, family)
    part = random_trajectory(np.random.default_rng(0), spec, family, "amplitude")
    ratio = part.coefficients[1] / full.coefficients[1]
    assert np.all((ratio > 0.1) & (ratio < 1.0))
    assert np.ptp(ratio) > 0.01


def test_the_same_generator_gives_the_same_motion() -> None:
    one, two = (random_trajectory(np.random.default_rng(7), robot(), FAMILIES["nullspace"]) for _ in range(2))
    assert one == two


def test_omega0_is_drawn_from_whole_periods_or_from_the_range() -> None:
    rng = np.random.default_rng(0)
    by_periods = TrajectoryFamily(duration=60.0, omega0=(0.1, 0.35))
    assert by_periods.whole_periods == pytest.approx([2 * np.pi / 60 * k for k in (1, 2, 3)])
    assert {by_periods.draw_omega0(rng) for _ in range(50)} == set(by_periods.whole_periods)
    assert not by_periods.omega0_is_free
    free = TrajectoryFamily(omega0=(0.1, 0.35), rest="ramp")
    drawn = [free.draw_omega0(rng) for _ in range(200)]
    assert free.omega0_is_free
    assert 0.1 <= min(drawn) < 0.12
    assert 0.33 < max(drawn) <= 0.35
    assert TrajectoryFamily(duration=30.0).omega0_range == pytest.approx((2 * np.pi / 30,) * 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"harmonics": 0}, "harmonics >= 1"),
        ({"harmonics": 1}, "at least 2 harmonics"),
        ({"duration": 0.0}, "0 < omega0|duration"),
        ({"duration": -5.0}, "0 < omega0|duration"),
        ({"omega0": (0.3, 0.2)}, "0 < omega0"),
        ({"omega0": -1.0}, "0 < omega0"),
        ({"omega0": (0.11, 0.19)}, "no whole number of periods"),
        ({"rest": "sudden"}, "'nullspace' or 'ramp'"),
        ({"rest": "ramp", "ramp": 31.0}, "ramps of 31.0 s do not fit"),
        ({"rest": "ramp", "ramp": 0.0}, "ramps of 0.0 s do not fit"),
    ],
)
def test_impossible_families(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        TrajectoryFamily(**options)


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({"upper": 0.2, "lower": 0.2}, "position"),
        ({"upper": 0.1, "lower": 0.2}, "position"),
        ({"velocity": 0.0}, "velocity"),
        ({"acceleration": float("nan")}, "acceleration"),
    ],
)
def test_limits_without_room(change: dict[str, float], quantity: str) -> None:
    spec = robot()
    spec = replace(spec, axes=(spec.axes[0], replace(spec.axes[1], **change), spec.axes[2]))
    for action in (
        lambda: random_trajectory(np.random.default_rng(0), spec, TrajectoryFamily()),
        lambda: certified_rows(spec, TrajectoryFamily()),
    ):
        with pytest.raises(UnsafeTrajectoryError, match=f"{quantity} limit .* of joint 'j1' leaves no room"):
            action()


def test_unknown_scale() -> None:
    with pytest.raises(UsageError, match="'limits' or 'amplitude'"):
        random_trajectory(np.random.default_rng(0), robot(), TrajectoryFamily(), "half")


def robot_with(velocity: float, acceleration: float) -> RobotSpec:
    return RobotSpec("r", (Axis("a", -1.0, 1.0, velocity, acceleration, 9.0),), "N m", 100.0)


def test_a_fast_robot_gets_several_periods_and_a_slow_one_a_single_one() -> None:
    def periods(spec: RobotSpec) -> float:
        return suited_to(TrajectoryFamily(), spec).omega0_range[0] * 60.0 / (2.0 * np.pi)

    assert periods(robot_with(0.05, 10.0)) == pytest.approx(1.0)
    assert periods(robot_with(2.0, 100.0)) == pytest.approx(8.0)
    assert periods(robot_with(2.0, 1.0)) == pytest.approx(4.0), "the acceleration limit binds first"


def test_an_omega0_that_was_given_stays() -> None:
    family = TrajectoryFamily(omega0=0.3, rest="ramp")
    assert suited_to(family, robot_with(2.0, 100.0)) is family


def test_a_suited_random_motion_comes_near_position_and_velocity_limits_alike() -> None:
    spec = robot_with(2.0, 100.0)
    family = suited_to(TrajectoryFamily(), spec)
    used = []
    for seed in range(20):
        s = random_trajectory(np.random.default_rng(seed), spec, family).sample(np.linspace(0.0, 60.0, 3000))
        used.append([np.ptp(s.q) / 2.0, np.abs(s.qd).max() / 2.0])
    # the plain family, one period a minute, uses less than a fifth of this robot's speed
    assert np.all(np.mean(used, axis=0) > 0.4)
