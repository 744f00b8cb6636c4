"""How far a run left its plan, by closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.contracts import Channel, Log
from etude.logs.tracked import largest_errors
from etude.trajectories.chain import Chain
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint

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
