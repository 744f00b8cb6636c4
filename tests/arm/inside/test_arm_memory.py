"""What friction remembers: golden numbers, gradients, laws of inputs; and when a joint stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.types import Log, Motion
from etude_arm import ArmInputs, ArmSpec, Axis
from etude_arm.memory import memory_vjp, remembered
from etude_arm.preprocessing import PLAY, ArmData, resolution, samples_of, standing
from etude_arm.spec import MEMORY

SPEC = ArmSpec(
    "arm", (Axis("a", -2.0, 2.0, 2.0, 8.0, 90.0), Axis("b", -2.0, 2.0, 2.0, 8.0, 90.0, "m")), "N m", 100.0
)
CHANNELS = {channel.name: channel for channel in SPEC.channels()}
INPUTS = replace(
    ArmInputs.of(SPEC, 0.02, presliding=0.01), play=np.array([1e-4, 2e-5]), slow=np.array([0.05, 0.02])
)
Q = np.array([0.0, 0.001, 0.004, 0.004, 0.0035, 0.002, 0.0021, 0.006])[:, None]
LENGTH = np.array([0.01])
GOLDEN = {
    0.0: [
        0.0,
        0.095162581964,
        0.329679953964,
        0.329679953964,
        0.26483069738,
        0.0886498700619,
        0.0977179553675,
        0.389103738945,
    ],
    0.0005: [
        0.0,
        0.0487705754993,
        0.295311910281,
        0.295311910281,
        0.295311910281,
        0.17204668445,
        0.17204668445,
        0.386637097967,
    ],
}


@pytest.mark.parametrize("play", GOLDEN)
def test_golden_numbers(play: float) -> None:
    found = remembered(Q, np.array([play]), LENGTH)
    np.testing.assert_allclose(found[:, 0, 0], GOLDEN[play], rtol=1e-11)
    if play:
        behind = [0.0, 0.0005, 0.0035, 0.0035, 0.0035, 0.0025, 0.0025, 0.0055]
        np.testing.assert_allclose(found[:, 1, 0], behind, atol=1e-15)


def test_memory_goes_on_from_where_it_was_and_knows_no_time() -> None:
    play = np.array([0.0005])
    whole = remembered(Q, play, LENGTH)
    np.testing.assert_array_equal(remembered(Q[4:], play, LENGTH, whole[3]), whole[4:])
    twice = np.interp(np.arange(0.0, 7.1, 0.125), np.arange(8.0), Q[:, 0])[:, None]
    np.testing.assert_allclose(remembered(twice, play, LENGTH)[::8, 0], whole[:, 0], rtol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 7, 257])
def test_joined_rows_are_the_recursion(count: int) -> None:
    rng = np.random.default_rng(count)
    q = np.cumsum(rng.normal(scale=1e-3, size=(count, 2)), axis=0)
    q[count // 3 : count // 2] = q[count // 3]
    play, length, state = np.array([2e-3, 0.0]), np.array([0.01, 0.003]), np.array([[0.3, -1.0], [1e-3, 0.0]])
    found, (sigma, p) = remembered(q, play, length, state), state
    for row, own in zip(q, found, strict=True):
        behind = np.minimum(np.maximum(p, row - play), row + play)
        sign = np.sign(behind - p)
        sigma = np.where(sign == 0.0, sigma, sign + (sigma - sign) * np.exp(-np.abs(behind - p) / length))
        p = behind
        np.testing.assert_allclose(own[0], sigma, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(own[1], p)


def test_noise_at_rest_does_not_forget() -> None:
    rng = np.random.default_rng(0)
    q = np.concatenate([np.linspace(0.0, 0.5, 500), np.full(6000, 0.5)])[:, None] + 1e-4 * rng.normal(
        size=(6500, 1)
    )
    kept = {r: remembered(q, np.array([r]), LENGTH)[-1, 0, 0] for r in (0.0, 1e-4 * PLAY)}
    assert abs(kept[0.0]) < 0.3
    assert kept[1e-4 * PLAY] > 0.9


def test_the_gradient_is_that_of_the_recursion() -> None:
    rng = np.random.default_rng(1)
    q, weight = np.cumsum(rng.normal(scale=2e-3, size=(30, 2)), axis=0), rng.normal(size=(30, 2))
    play, length = np.array([5e-4, 0.0]), np.array([0.01, 0.003])
    found, step = memory_vjp(q, play, length, weight), 1e-8
    for i, j in [(0, 0), (7, 0), (7, 1), (29, 1), (15, 0), (22, 1)]:
        ends = []
        for sign in (1.0, -1.0):
            bent = q.copy()
            bent[i, j] += sign * step
            ends.append(float(np.sum(weight * remembered(bent, play, length)[:, 0])))
        assert found[i, j] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=1e-5, abs=1e-5)


def motion(count: int = 40) -> Motion:
    t = 0.04 * np.arange(count)
    phase = t[:, None] * [1.5, 2.5]
    w = np.array([1.5, 2.5])
    orders = [np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)]
    return Motion(t, 0.1 * np.stack(orders))


def test_plan_log_and_steps_remember_alike() -> None:
    m, keep = motion(), np.array([0, 3, 4, 17])
    log = INPUTS.states(m)
    X = INPUTS.of_log(log)
    assert [column[3] for column in INPUTS.columns[-4:]] == ["memory", "memory", "rest", "rest"]
    np.testing.assert_array_equal(INPUTS.plan(m).X, X)
    np.testing.assert_array_equal(INPUTS.plan(m, keep).X, X[keep])
    memory, rows = None, []
    for i in range(len(log)):
        x, memory = INPUTS.step({name: values[i] for name, values in log.values.items()}, memory)
        rows.append(x)
    np.testing.assert_allclose(rows, X, rtol=1e-13, atol=1e-15)  # joined in pairs, rows round otherwise
    sigma, rest = X[:, -4:-2] / X[:, -2:], X[:, -2:]
    np.testing.assert_allclose(sigma, remembered(m.orders[0], INPUTS.play, np.array([0.01, 0.001]))[:, 0])
    np.testing.assert_allclose(rest, np.exp(-np.abs(m.orders[1]) / INPUTS.slow))
    known = log.put(SPEC.memory(), np.full_like(sigma, 0.5))
    np.testing.assert_allclose(INPUTS.of_log(known)[:, -4:-2], 0.5 * rest)
    assert INPUTS.rate > 0.0


def test_pull_is_the_gradient_in_the_whole_motion() -> None:
    m, keep, rng = motion(12), np.array([1, 5, 11]), np.random.default_rng(2)
    planned = INPUTS.plan(m, keep)
    in_X = rng.normal(size=planned.X.shape)
    found = planned.vjp(in_X, np.zeros((3, 2)))
    assert found.shape == m.orders.shape
    for place in [(0, 3, 0), (0, 5, 1), (1, 5, 0), (1, 11, 1), (2, 1, 0), (0, 0, 0)]:
        ends = []
        for sign in (1.0, -1.0):
            bent = m.orders.copy()
            bent[place] += sign * 1e-7
            ends.append(float(np.sum(in_X * INPUTS.plan(Motion(m.t, bent), keep).X)))
        assert found[place] == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-4, abs=1e-4)


def test_a_model_keeps_what_its_inputs_remember_with() -> None:
    again = ArmInputs.of(SPEC, 0.02).restore(INPUTS.arrays())
    np.testing.assert_array_equal(
        again.of_log(INPUTS.states(motion())), INPUTS.of_log(INPUTS.states(motion()))
    )
    bare = ArmInputs.of(SPEC, 0.02)
    assert INPUTS.restore(bare.arrays()).columns == bare.columns


T = np.arange(0.0, 30.0, 0.01)


def held_log(noise: float = 1e-5) -> Log:
    """Joint a moves; joint b is held, and gives way a little to what a does."""
    rng = np.random.default_rng(0)
    q = np.column_stack([np.sin(1.5 * T), 2e-6 * np.sin(1.5 * T)]) + noise * rng.normal(size=(len(T), 2))
    return Log(T, {n: CHANNELS[n] for n in ("q", "command")}, {"q": q, "command": np.cos(q)}, "run")


def test_a_joint_that_is_held_stands_however_slow_the_log() -> None:
    groups = [np.zeros(len(T), dtype=np.int64)]
    found = samples_of(SPEC, ArmData(), [held_log()], groups)
    assert found.moving[:, 0].mean() > 0.9
    assert not found.moving[:, 1].any()
    before = samples_of(SPEC, ArmData(presliding=0.0), [held_log()], groups)
    assert before.moving[:, 1].mean() > 0.5  # what a threshold relative to its own top speed makes of it
    assert MEMORY in found.log
    assert MEMORY not in before.log


def test_memory_is_that_of_the_whole_log_before_thinning() -> None:
    log = held_log()
    found = samples_of(SPEC, ArmData(), [log], [np.zeros(len(T), dtype=np.int64)])
    play = np.array(found.log.channels["q"].quantum)
    whole = remembered(log["q"], play, SPEC.presliding(0.01))[:, 0]
    np.testing.assert_array_equal(found.log[MEMORY], whole[np.searchsorted(T, found.t - 1e-6)])
    fitted = ArmInputs.of(SPEC, 0.02, presliding=0.01).fitted(found)
    np.testing.assert_array_equal(fitted.play, play)


def test_resolution_is_that_of_noise_or_of_the_step() -> None:
    rng = np.random.default_rng(3)
    noisy = 1e-3 * rng.normal(size=(5000, 1))
    assert resolution(noisy)[0] == pytest.approx(PLAY * 1e-3, rel=0.05)
    fast = np.sin(10.0 * np.arange(3000) / 100.0)[:, None]  # 100 rad/s^2 at 100 Hz: 10 mrad from row to row
    both = resolution(fast + 1e-4 * noisy[:3000] / 1e-3)[0]
    assert both == pytest.approx(PLAY * 1e-4, rel=0.2)
    stepped = np.round(np.linspace(0.0, 0.1, 5000), 3)[:, None]
    assert resolution(stepped)[0] == pytest.approx(1e-3)
    assert resolution(stepped, (0.02,))[0] == 0.02


def test_the_least_speed_never_exceeds_its_part_of_the_limit() -> None:
    speed = np.array([[0.2, 0.2], [0.08, 0.02]])
    masked = standing(speed, SPEC, 0.05, np.array([1.0, 0.0]), 5.0)
    np.testing.assert_array_equal(masked, [[False, False], [True, False]])
