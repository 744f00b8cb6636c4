"""How far a run left its plan, by closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.logs import largest_errors, tracked
from etude.trajectories import Chain, FourierTrajectory, PointToPoint
from etude.types import Channel, Log

Q = Channel("q", ("a", "b"), ("rad", "rad"))
FORTH = PointToPoint(np.array([[0.0, 0.0], [1.0, -1.0]]), 0.5, 0.0)


def log_of(motion, error, before: float = 0.0) -> Log:
    t = np.arange(-before, motion.duration, 0.01)
    return Log(t, {"q": Q}, {"q": motion.motion(np.maximum(t, 0.0), 1).orders[0] + error(t)})


def test_a_slow_wave_is_measured_in_every_order() -> None:
    long = PointToPoint(np.array([[0.0, 0.0], [1.0, -1.0]]), 0.1, 0.0)
    w = 2.0 * np.pi * 0.5
    log = log_of(long, lambda t: np.stack([0.02 * np.sin(w * t), 0.01 * np.cos(w * t)], axis=1))
    found = largest_errors(log, long, "q")
    assert set(found) == {"moves"}
    np.testing.assert_allclose(found["moves"][0], [0.02, 0.01], rtol=1e-3)
    np.testing.assert_allclose(found["moves"][1], [0.02 * w, 0.01 * w], rtol=0.02)
    np.testing.assert_allclose(found["moves"][2][0], 0.02 * w * w, rtol=0.02)


def test_vibration_above_the_cutoff_is_no_velocity_error() -> None:
    log = log_of(FORTH, lambda t: 0.001 * np.sin(2.0 * np.pi * 40.0 * t)[:, None] * np.ones(2))
    found = largest_errors(log, FORTH, "q")["moves"]
    assert found[0].max() == pytest.approx(0.001, rel=0.06)
    assert found[1].max() < 0.02 * 0.001 * 2.0 * np.pi * 40.0


def test_noise_is_told_from_a_fast_error() -> None:
    """White noise of an encoder smooths as before; a clean log of an error at 8 Hz is read whole."""
    long = PointToPoint(np.array([[0.0, 0.0], [1.0, -1.0]]), 0.1, 0.0)
    w, rng = 2.0 * np.pi * 8.0, np.random.default_rng(0)
    clean = log_of(long, lambda t: 0.001 * np.sin(w * t)[:, None] * np.ones(2))
    assert largest_errors(clean, long, "q")["moves"][1].min() > 0.8 * 0.001 * w
    noisy = log_of(long, lambda t: 1e-3 * rng.standard_normal((len(t), 2)))
    deviation = 2.0 * np.pi * 1e-3 * np.sqrt(2.0 * 0.2777 * 5.0**3 / 100.0)
    assert 3.0 < largest_errors(noisy, long, "q")["moves"][1].max() / deviation < 5.5


def test_an_acceleration_that_noise_hides_is_not_known() -> None:
    """3 mm of noise on positions are 1.6 m/s^2 behind the lowest cutoff, whatever the vehicle did."""
    long, rng = PointToPoint(np.array([[0.0, 0.0], [1.0, -1.0]]), 0.1, 0.0), np.random.default_rng(0)
    w = 2.0 * np.pi * 0.5
    noisy = log_of(long, lambda t: np.sin(w * t)[:, None] * [0.03, 3.0] + 3e-3 * rng.normal(size=(len(t), 2)))
    hidden, known = largest_errors(noisy, long, "q")["moves"][2]
    assert np.isnan(hidden)
    assert known == pytest.approx(3.0 * w * w, rel=0.1)
    assert np.isfinite(largest_errors(noisy, long, "q")["moves"][:2]).all()


def test_the_pieces_of_a_chain_count_as_their_own_forms() -> None:
    segment = FourierTrajectory(np.zeros((3, 2)), 1.0, 4.0)
    first = PointToPoint(np.array([[1.0, 1.0], [0.0, 0.0]]), 0.5, 0.0)
    chain = Chain((("approach", first), ("segment", segment)))
    log = log_of(chain, lambda t: np.where(t < first.duration, 0.3, 0.1)[:, None] * np.array([1.0, 0.5]))
    found = largest_errors(log, chain, "q")
    np.testing.assert_allclose(found["moves"][0], [0.3, 0.15])
    np.testing.assert_allclose(found["fourier"][0], [0.1, 0.05])


def test_what_is_recorded_before_the_start_does_not_count() -> None:
    log = log_of(FORTH, lambda t: np.where(t < -0.5, 1.0, 0.1)[:, None] * np.ones(2), before=2.0)
    np.testing.assert_allclose(largest_errors(log, FORTH, "q")["moves"][0], 0.1)


def test_without_the_path_nothing_is_said() -> None:
    log = log_of(FORTH, lambda t: 0.0 * t[:, None] * np.ones(2))
    assert largest_errors(replace(log, values={}, channels={}), FORTH, "q") == {}
    assert largest_errors(log.take(slice(0, 5)), FORTH, "q") == {}


WAVES = FourierTrajectory(np.array([[0.0, 0.0], [0.3, -0.2], [0.1, 0.2], [0.2, 0.1], [-0.1, 0.3]]), 1.2, 20.0)


def errs(*shapes):  # type: ignore[no-untyped-def]
    return lambda t: sum(shape(t) for shape in shapes)[:, None] * np.array([1.0, 0.5])


def steady(t):  # type: ignore[no-untyped-def]
    return 0.02 * np.sin(2.1 * t)


@pytest.mark.parametrize("rate", [1.0, 2.5])
def test_a_start_that_dies_away_is_told_by_itself(rate: float) -> None:
    found = tracked(log_of(WAVES, errs(steady, lambda t: 0.5 * np.exp(-rate * t))), WAVES, "q")
    assert found.start is not None
    assert np.exp(-rate * found.start.until) < 0.15
    assert found.start.until < 9.0
    np.testing.assert_array_less(found.errors["fourier"][0], 2.0 * 1.01 * np.array([0.02, 0.01]))
    np.testing.assert_array_less(0.99 * np.array([0.02, 0.01]), found.errors["fourier"][0])
    np.testing.assert_allclose(found.start.errors[0], [0.5, 0.25], rtol=0.1)


@pytest.mark.parametrize(
    "shape",
    [
        lambda t: 0.0 * t,
        lambda t: 0.5 * np.exp(-t / 8.0),
        lambda t: np.where(t < 9.9, 0.5, 0.0),
        lambda t: 0.5 * np.exp(-(((t - 5.0) / 0.5) ** 2)),
        lambda t: 0.04 * np.exp(-t),
        lambda t: 0.5 * np.exp(-(((t - 16.0) / 0.5) ** 2)),
    ],
    ids=["steady", "slow", "half of it", "a gust", "small", "late gust"],
)
def test_what_is_no_start_counts_whole(shape) -> None:  # type: ignore[no-untyped-def]
    log = log_of(WAVES, errs(steady, shape))
    found = tracked(log, WAVES, "q")
    assert found.start is None
    error = np.abs(log["q"] - WAVES.motion(log.t, 1).orders[0]).max(axis=0)
    np.testing.assert_allclose(found.errors["fourier"][0], error)


def test_a_joint_that_moves_at_first_and_then_stands_has_no_transient() -> None:
    first = PointToPoint(np.array([[0.0, 0.0], [1.0, -1.0]]), 0.5, 0.0)
    rest = PointToPoint(np.array([[1.0, -1.0], [1.0, 0.5], [1.0, -1.0], [1.0, 0.5]]), 0.5, 0.0)
    chain = Chain((("segment", first), ("segment", rest)))
    speed = lambda t: np.abs(chain.motion(t, 2).orders[1]) * 0.1  # noqa: E731
    found = tracked(log_of(chain, speed), chain, "q")
    assert found.start is None
    assert found.errors["moves"][0].min() > 0.04
