"""What error is to be expected with the feedforward: of joints while they move, and of no others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.campaign import errors, left_over, moving, trained_speeds, without_it
from etude.campaign.record.confirmation import HALF_NORMAL, SPREAD, shared_lag
from etude.types import Array, Channel, Log, Motion

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
        posterior=predict,
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


def test_an_error_is_the_command_s_the_lag_s_and_the_encoder_s() -> None:
    plan: Any = Plan()
    t, rng = np.arange(0.0, 10.0, 0.01), np.random.default_rng(0)
    place, rate = plan.motion(t, 2).orders
    command = np.cos(3.0 * t)[:, None] * np.array([2.0, 1.0, 0.5]) + 0.5 * np.sign(rate)
    noise = np.array([0.0, 0.0, 0.001]) * rng.standard_normal((len(t), 3))
    q = place - 0.02 * rate + 0.1 * command + noise
    use = np.stack([t < 6.0, np.zeros_like(t, bool), t < 6.0], axis=1)
    log = Log(t, CHANNELS, {"q": q})
    found = without_it(log, "q", plan, use, command)
    np.testing.assert_allclose(found.moving, errors(log, "q", plan, use))
    np.testing.assert_allclose(found.late[0], 0.02 * np.abs(rate[t < 6.0, 0]).mean(), rtol=0.05)
    assert found.noise[2] == pytest.approx(HALF_NORMAL * 0.001, rel=0.5)  # steps of the command are in it
    first, none, other = found.expected([0.2, 0.2, None])
    assert first is not None
    assert none is other is None
    part, late, noise = 0.2 * found.moving[0], found.late[0], found.noise[0]
    assert first == pytest.approx(
        (np.hypot(part / SPREAD, noise), np.sqrt((part * SPREAD) ** 2 + late**2 + noise**2))
    )
    off = Log(t, CHANNELS, {"q": place + 0.3})
    np.testing.assert_allclose(errors(off, "q", plan, use), [0.3, np.nan, 0.3])


def test_a_lag_is_believed_only_where_all_axes_have_it() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    rate, command = np.sin(t)[:, None] * np.ones(3), np.cos(2.0 * t)[:, None] * np.ones(3)
    use = np.ones(rate.shape, dtype=bool)
    for lags, wanted in (((-0.03, -0.01, -0.02), -0.01), ((-0.03, 0.01, -0.02), 0.0)):
        assert shared_lag(rate * lags + 0.5 * command, rate, command, use) == pytest.approx(wanted, abs=1e-9)
    assert shared_lag(rate, rate, command, ~use) == 0.0
