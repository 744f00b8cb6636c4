"""What error is to be expected with the feedforward: of joints while they move, and of no others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.campaign.foretold import HALF_NORMAL, errors, left_over, moving, trained_speeds
from etude.contracts import Array, Channel, Log, Motion

CHANNELS = {"q": Channel("q", ("a", "b", "c"), ("rad",) * 3)}


class Plan:
    """Joint a goes for 6 s and stands for 4, b stands, c goes by a hundredth."""

    duration = 10.0

    def motion(self, t: Array, orders: int = 3) -> Motion:
        goes = t < 6.0
        rate = np.where(goes, np.sin(np.pi * t / 6.0), 0.0)
        place = np.where(goes, 1.0 - np.cos(np.pi * t / 6.0), 2.0) * 6.0 / np.pi
        scales = np.array([1.0, 0.0, 0.01])
        return Motion(t, np.stack([place, rate, rate])[:orders, :, None] * scales)


def model(still: float) -> Any:
    """Commands of 10 with a deviation of 1 while a moves, `still` while it stands."""

    def predict(log: Log) -> tuple[Array, Array]:
        deviation = np.where(log["q"][:, 1] > 0.05, 1.0, still)[:, None]
        return np.full((len(log), 3), 10.0), np.tile(deviation**2, (1, 3))

    def states(motion: Motion) -> Log:
        rates = np.repeat(np.abs(motion.orders[1, :, :1]), 3, axis=1)
        return Log(motion.t, CHANNELS, {"q": rates})

    ranges = np.array([[-1.5, -1.0, -1.0], [1.0, 0.5, 2.0]])
    columns = [("qd", part, "rad/s", "") for part in ("a", "b", "c")]
    return SimpleNamespace(
        predict=predict,
        inputs=SimpleNamespace(states=states, orders=3, columns=columns),
        ranges=ranges,
    )


def test_only_what_a_joint_does_while_it_moves_counts() -> None:
    plan: Any = Plan()
    rates = Channel("qd", ("a", "b", "c"), ("rad/s",) * 3, derivative_of="q")
    trained = trained_speeds(model(1.0), rates)
    np.testing.assert_array_equal(trained, [1.5, 1.0, 2.0])
    t = np.array([0.01, 3.0, 5.99, 8.0])
    np.testing.assert_array_equal(moving(plan, t, trained)[:, 0], [False, True, False, False])
    assert not moving(plan, t, trained)[:, 1:].any()
    assert moving(plan, t, 0.01 * trained)[1].tolist() == [True, False, True]
    found, doubted = (left_over(model(still), plan, trained) for still in (1.0, 50.0))
    assert found == doubted  # whatever the model says of a joint that stands
    assert found[0] == pytest.approx(HALF_NORMAL / np.hypot(10.0, HALF_NORMAL))
    assert found[1:] == [None, None]


def test_errors_are_taken_apart_from_the_noise_of_the_encoder() -> None:
    plan: Any = Plan()
    t, rng = np.arange(0.0, 10.0, 0.01), np.random.default_rng(0)
    off = np.where(t < 5.0, 0.3, -0.1)[:, None] * np.array([1.0, 1.0, 0.0])
    q = plan.motion(t, 1).orders[0] + off + np.array([0.0, 0.0, 0.02]) * rng.standard_normal((len(t), 3))
    use = np.stack([t < 5.0, np.zeros_like(t, bool), t >= 0.0], axis=1)
    found, noise = errors(Log(t, CHANNELS, {"q": q}), "q", plan, use)
    np.testing.assert_allclose(found, [0.3, np.nan, HALF_NORMAL * 0.02], rtol=0.05)
    assert noise[2] == pytest.approx(HALF_NORMAL * 0.02, rel=0.05)
    assert noise[0] < 0.01  # one step of 0.4
