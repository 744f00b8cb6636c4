"""Broken sensors: scale, encoder, stuck; and whether a change came at once or little by little."""

from __future__ import annotations

import numpy as np
import pytest

from etude.models import Cause, drift_onset
from etude.models.change.diagnosis import FROZEN_S, SLOW, ExpectedCommands, cause, frozen_sensor
from etude.models.change.evidence import block_sizes
from etude.types import Array, Channel, Log, Samples

RNG = np.random.default_rng(4)
T = np.arange(0.0, 60.0, 0.2)
RATES = np.array([0.7, 1.1, 1.7])
Q = np.sin(T[:, None] * RATES) + 0.6 * np.cos(2.3 * T[:, None] * RATES)
V = np.gradient(Q, 0.2, axis=0)
A = np.gradient(V, 0.2, axis=0)


def command(q: Array) -> Array:
    """Gravity, friction, inertia, and a ripple that is no straight line within a tenth of a radian."""
    rigid = 20.0 * np.sin(q + 0.3 * q[:, [1, 2, 0]]) + 3.0 * A
    return np.asarray(rigid + 8.0 * np.tanh(V / 0.05) + 2.0 * np.sin(20.0 * q))


def named(measured: Array, q: Array) -> Cause:
    """What is named by a perfect model of a robot whose logs are measured, q."""
    noise = RNG.standard_normal(Q.shape)
    mean = command(q)
    expected = ExpectedCommands(mean, np.ptp(q, axis=0), lambda i, d: command(q - d * (np.arange(3) == i)))
    motion = 20.0 * np.sin(q + 0.3 * q[:, [1, 2, 0]]), V, A
    return cause(measured + noise - mean, np.ones_like(q), np.abs(V) > 0.05, motion, expected)


ONE = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize("scale", [0.6, 1.4, -1.0])
def test_a_command_out_of_scale(scale: float) -> None:
    assert named(command(Q) * (1.0 + (scale - 1.0) * ONE), Q) == "gain"


@pytest.mark.parametrize("shift", [0.1, -0.07, 0.3])
def test_an_encoder_that_is_off_though_commands_bend_within_it(shift: float) -> None:
    assert named(command(Q), Q + shift * ONE) == "encoder"


@pytest.mark.parametrize(
    ("error", "name"),
    [
        (5.0 * np.sin(Q) + 2.0 * A, "load"),
        (5.0 * np.tanh(V / 0.05), "friction"),
        (9.0 * np.ones_like(Q) * ONE, "offset"),
        (9.0 * RNG.standard_normal(Q.shape), "unknown"),
    ],
)
def test_the_others_are_named_as_before(error: Array, name: str) -> None:
    assert named(command(Q) + error, Q) == name


def test_scale_and_friction_of_a_command_that_is_friction_alone_cannot_be_told_apart() -> None:
    rub = 8.0 * np.tanh(V / (SLOW * np.abs(V).max(axis=0)))
    expected = ExpectedCommands(rub, np.ptp(Q, axis=0), lambda _i, _d: rub)
    error = 0.4 * rub * ONE + 0.1 * RNG.standard_normal(Q.shape)
    assert cause(error, np.full_like(Q, 0.1), np.abs(V) > 0.05, (0.0 * Q, V, A), expected) == "unknown"


def samples(command_: Array, q: Array, plan: Array | None = None) -> Samples:
    names, units = ("a", "b", "c"), ("rad",) * 3
    channels = {
        "q": Channel("q", names, units),
        "command": Channel("command", names, ("N m",) * 3, "command", acts_on="q"),
    }
    log = Log(T, channels, {"q": q, "command": command_})
    if plan is not None:
        log = log.put(Channel("q_des", names, units, "plan"), plan)
    every = np.ones_like(Q, dtype=np.bool_)
    return Samples(log, np.zeros(len(T), dtype=np.int64), every, np.abs(V) > 1e-3)


class TestStuck:
    def test_nothing_is_stuck_that_moves(self) -> None:
        assert frozen_sensor(samples(command(Q), Q, Q)) is None

    def test_a_command_is_certain_after_some_seconds(self) -> None:
        held = command(Q)
        held[100:, 2] = held[100, 2]
        found = frozen_sensor(samples(held, Q))
        assert found is not None
        assert found[0] == 2
        # a joint that turns round stands for a sample, and the count begins again
        assert FROZEN_S <= T[found[1]] - T[100] <= 2.0 * FROZEN_S

    def test_a_short_hold_is_not(self) -> None:
        held = command(Q)
        held[100:112, 2] = held[100, 2]
        assert frozen_sensor(samples(held, Q)) is None

    def test_a_position_is_stuck_only_while_its_plan_moves(self) -> None:
        held = Q.copy()
        held[150:, 0] = held[150, 0]
        found = frozen_sensor(samples(command(Q), held, Q))
        assert found is not None
        assert found[0] == 0
        assert T[found[1]] >= T[150] + FROZEN_S
        assert frozen_sensor(samples(command(Q), held, held)) is None
        assert frozen_sensor(samples(command(Q), held)) is None


class TestManner:
    @staticmethod
    def logs(levels: Array, seed: int) -> list[Array]:
        rng = np.random.default_rng(seed)
        return [level * np.exp(0.1 * rng.standard_normal(6)) for level in levels]

    @pytest.mark.parametrize("seed", range(5))
    def test_a_step_is_no_drift_and_a_ramp_is_no_step(self, seed: int) -> None:
        assert drift_onset(self.logs(np.array([1.0, 1.0, 5.0, 5.0]), seed)) == "at once"
        assert drift_onset(self.logs(np.array([1.2, 2.3, 3.4, 4.5, 5.6]), seed)) == "little by little"
        assert drift_onset(self.logs(np.array([5.6, 4.5, 3.4, 2.3, 1.2]), seed)) == "at once"

    def test_two_logs_tell_nothing(self) -> None:
        assert drift_onset(self.logs(np.array([1.0, 5.0]), 0)) == "cannot tell"

    def test_blocks_of_ten_seconds(self) -> None:
        t = np.arange(0.0, 25.0, 1.0)
        z = np.where(t[:, None] < 10.0, 3.0, 1.0) * np.ones(2)
        z[20:, 1] = np.nan
        np.testing.assert_allclose(block_sizes(t + 5.0, z), [3.0, 1.0, 1.0])
