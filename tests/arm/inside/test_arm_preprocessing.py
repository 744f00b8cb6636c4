"""From log to data set: consistent derivatives, mask, trimming, thinning, and refusal of what cannot be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.logs import duration
from etude.types import Log, Samples
from etude_arm import KIND, ArmSpec, Axis, filter_cutoff
from etude_arm.preprocessing import ArmData, samples_of

Array = NDArray[np.float64]
SPEC = ArmSpec("arm", tuple(Axis(n, -2.0, 2.0, 2.0, 8.0, 90.0) for n in ("a", "b")), "N m", 100.0)
OMEGA = np.array([1.5, 2.5])


CHANNELS = {channel.name: channel for channel in SPEC.channels()}
THESIS_MEASURED = ArmData(**{**KIND.presets["thesis"]["data"], "inputs": "measured"})
DEFAULT, THESIS = ArmData(), ArmData(**KIND.presets["thesis"]["data"])


def build(log: Log, spec: ArmSpec, config: ArmData, group: int = 0) -> Samples:
    return samples_of(spec, config, [log], [np.full(len(log), group)])


def with_plan(log: Log, **plans: Array) -> Log:
    for name, values in plans.items():
        log = log.put(CHANNELS[name], values)
    return log


def motion(t: Array) -> tuple[Array, Array, Array]:
    phase = t[:, None] * OMEGA
    return np.sin(phase), OMEGA * np.cos(phase), -(OMEGA**2) * np.sin(phase)


def log_of(t: Array, noise: float = 0.0) -> Log:
    q, qd, qdd = motion(t)
    rng = np.random.default_rng(0)
    measured = q + noise * rng.standard_normal(q.shape)
    values = {"q": measured, "command": 2 * qdd + 3 * qd + q}
    return Log(t, {name: CHANNELS[name] for name in values}, values, source="run")


T = np.arange(-2.0, 30.0, 0.01)
LOG = log_of(T, noise=3e-4)


def test_default_inputs_are_the_motion() -> None:
    data = build(LOG, SPEC, DEFAULT, group=4)
    q, qd, qdd = motion(data.t)
    np.testing.assert_allclose(data.log["q"], q, atol=3e-3)
    np.testing.assert_allclose(data.log["qd"], qd, atol=1e-2)
    np.testing.assert_allclose(data.log["qdd"], qdd, atol=0.15)
    np.testing.assert_allclose(data.command, 2 * qdd + 3 * qd + q, atol=0.1)
    assert set(data.group) == {4}
    # half a percent of room: the top speed is that of all samples, before thinning
    top = np.minimum(SPEC.velocity, np.abs(data.log["qd"]).max(axis=0))
    assert not np.any(~data.moving & (np.abs(data.log["qd"]) > 1.005 * 0.05 * top))
    assert np.all(~data.moving | (np.abs(data.log["qd"]) > 0.995 * 0.05 * top))


def test_the_stick_mask_never_exceeds_its_part_of_the_velocity_limit() -> None:
    slow = replace(SPEC, axes=tuple(replace(a, velocity=0.1) for a in SPEC.axes))
    data = build(LOG, slow, DEFAULT)
    np.testing.assert_array_equal(~data.moving, np.abs(data.log["qd"]) < 0.05 * 0.1)


def test_position_and_command_pass_the_same_filter() -> None:
    config = ArmData(cutoff_hz=0.4, trim_s=6.0)
    data = build(log_of(T), SPEC, config)
    # The dynamics are linear with constant coefficients, so a shared filter leaves them exact.
    np.testing.assert_allclose(
        data.command, 2 * data.log["qdd"] + 3 * data.log["qd"] + data.log["q"], atol=2e-3
    )


def test_the_target_is_the_same_whatever_learning_takes() -> None:
    q, t = LOG["q"].copy(), LOG.t
    q[t > 20.0] = q[np.searchsorted(t, 20.0)]  # both joints stand from then on
    log = LOG.put(CHANNELS["q"], q)
    config = ArmData(cutoff_hz=6.0, trim_s=1.0, plenty=0)
    usual, other = (
        build(log, SPEC, replace(config, **more)) for more in ({}, {"cutoff_hz": 1.5, "reversal": 0.0})
    )
    np.testing.assert_array_equal(usual.t, other.t)
    moves = usual.moving.any(axis=1) & other.moving.any(axis=1) & (usual.t < 19.0)
    exact = LOG["command"][np.searchsorted(t, usual.t[moves] - 1e-6)]
    np.testing.assert_allclose(usual.target[moves], exact, atol=0.1)
    assert np.abs(other.command - usual.command)[moves].max() > 0.05
    np.testing.assert_array_equal(other.target[moves], usual.target[moves])
    assert np.isnan(usual.target[usual.t > 21.0]).all()
    slow = moves & ~usual.moving.all(axis=1)
    assert slow.any()
    assert not usual.usable.all()
    raw = build(log, SPEC, THESIS_MEASURED)
    np.testing.assert_array_equal(raw.target[raw.moving.any(axis=1)], raw.command[raw.moving.any(axis=1)])


@pytest.mark.parametrize(
    ("friction", "noise", "wide"), [(0.0, 3e-4, False), (5.0, 3e-4, True), (5.0, 1e-2, True)]
)
def test_a_cutoff_of_positions_is_widened_where_commands_have_steps(
    friction: float, noise: float, wide: bool
) -> None:
    log, (_, qd, _) = log_of(T, noise), motion(T)
    log = log.put(CHANNELS["command"], log["command"] + friction * np.tanh(qd / 0.05))
    found = filter_cutoff(log, DEFAULT)
    own = filter_cutoff(log.without("command"), DEFAULT)
    assert own < 2.5
    assert found == (5.0 if wide else pytest.approx(own))
    slow = log.take(slice(None, None, 4))  # 25 Hz have no room for 5 Hz
    assert filter_cutoff(slow, DEFAULT) < 3.2


@pytest.mark.parametrize(("noise", "least", "most"), [(0.0, 4.0, 4.3), (1e-6, 2.5, 3.0), (1e-3, 0.95, 1.1)])
def test_slow_motion_keeps_friction_steps_of_forces_as_far_as_noise_allows(
    noise: float, least: float, most: float
) -> None:
    """Times the cutoff that the motion alone needs, 20 times its band."""
    t = np.arange(0.0, 100.0, 0.02)
    phase = 0.1 * np.pi * t[:, None] * [0.7, 1.0]
    q = np.arcsin(0.98 * np.sin(phase)) + noise * np.random.default_rng(0).standard_normal(phase.shape)
    log = Log(t, {}, {}, "run").put(CHANNELS["q"], q)
    force, current = (
        filter_cutoff(log.put(replace(CHANNELS["command"], units=(u, u)), np.cos(phase)), DEFAULT)
        for u in ("N m", "A")
    )
    assert least < force / current < most


def test_lead_in_and_edges_are_trimmed() -> None:
    config = ArmData(cutoff_hz=1.0, trim_s=3.0)
    data = build(LOG, SPEC, config)
    assert 1.0 - 1e-6 < data.t[0] < 1.0 + 0.13
    assert 26.99 - 0.13 < data.t[-1] <= 26.99 + 1e-9
    late = build(LOG, SPEC, replace(config, trim_s="auto"))
    assert -1e-6 < late.t[0] < 0.13


@pytest.mark.parametrize(("rate", "rate_hz", "step"), [(100.0, 8.0, 12), (125.0, 8.0, 15), (100.0, 500.0, 1)])
def test_thinning(rate: float, rate_hz: float, step: int) -> None:
    log = log_of(np.arange(0.0, 20.0, 1.0 / rate))
    data = build(log, SPEC, ArmData(rate_hz=rate_hz, least_samples=0))
    np.testing.assert_allclose(np.diff(data.t), step / rate, atol=1e-9)


def test_repeated_motions_are_sampled_at_other_times() -> None:
    parts = [build(LOG, SPEC, DEFAULT, group=g) for g in range(4)]
    starts = {round(float(part.t[0]), 6) for part in parts}
    assert len(starts) == 4
    groups = [np.full(len(LOG), g) for g in range(4)]
    together = samples_of(SPEC, DEFAULT, [LOG] * 4, groups)
    np.testing.assert_array_equal(together.command, np.concatenate([part.command for part in parts]))
    np.testing.assert_array_equal(np.unique(together.group), range(4))


def test_the_thesis_takes_the_desired_motion_and_the_raw_command() -> None:
    q, qd, qdd = motion(T)
    log = with_plan(LOG, q_des=q + 1.0, qd_des=qd, qdd_des=qdd)
    assert len(build(log, SPEC, THESIS)) == np.count_nonzero(T > -1e-6)
    data = build(log, SPEC, replace(THESIS, rate_hz=100.0 / 12.0))
    rows = np.searchsorted(T, data.t - 1e-6)
    np.testing.assert_array_equal(np.diff(rows), 12)
    assert data.t[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(data.log["q_des"], log["q_des"][rows], atol=1e-9)
    np.testing.assert_allclose(data.log["qdd_des"], qdd[rows], atol=1e-9)
    np.testing.assert_allclose(data.command, LOG["command"][rows], atol=1e-9)
    assert data.moving.all()


def test_a_way_back_after_the_plan_is_not_learned_as_rest() -> None:
    """The plan ends at 20 s; the robot overshoots a little, stands, and from 25 s on goes away."""
    q, qd, qdd = motion(T)
    over = T > 20.0
    held = motion(np.array([20.0]))[0]
    plan = [np.where(over[:, None], held, q), *(np.where(over[:, None], 0.0, x) for x in (qd, qdd))]
    wave = 0.01 * np.sin(T)[:, None]
    away = plan[0] + wave + np.where((T > 25.0)[:, None], 0.3 * (T - 25.0)[:, None], 0.0)
    log = with_plan(LOG.put(CHANNELS["q"], away), q_des=plan[0], qd_des=plan[1], qdd_des=plan[2])
    data = build(log, SPEC, THESIS)
    assert 25.0 <= data.t[-1] <= 25.2, "it stands until 25 s"
    assert build(log, SPEC, DEFAULT).t[-1] > 29.0, "what is measured teaches on the way back too"


def test_desired_derivatives_are_made_if_the_log_has_none() -> None:
    log = with_plan(LOG, q_des=motion(T)[0])
    data = build(log, SPEC, replace(THESIS, trim_s=2.0))
    np.testing.assert_allclose(data.log["qd_des"], motion(data.t)[1], atol=2e-2)


def test_a_pause_is_not_filtered_across() -> None:
    keep = (T < 10) | (T > 13)
    log = LOG.take(keep)
    data = build(log, SPEC, ArmData(cutoff_hz=2.0))
    assert not ((data.t > 9.5) & (data.t < 13.5)).any()
    np.testing.assert_allclose(data.log["qd"], motion(data.t)[1], atol=2e-2)


def test_standing_joints_are_masked_each_for_itself() -> None:
    q = LOG["q"].copy()
    q[1500:2500, 1] = q[1500, 1]
    data = build(LOG.put(CHANNELS["q"], q), SPEC, ArmData(cutoff_hz=3.0))
    inside = (data.t > 14) & (data.t < 22)
    assert not data.moving[inside, 1].any()
    assert data.moving[inside, 0].mean() > 0.9
    assert build(LOG, SPEC, ArmData(stick_fraction=0.0)).moving.all()


def test_refuses_other_joints_missing_desired_motion_and_nothing_left() -> None:
    swapped = LOG.put(replace(CHANNELS["q"], parts=("b", "a")), LOG["q"])
    with pytest.raises(DataError, match="the log has the joints b, a"):
        build(swapped, SPEC, DEFAULT)
    with pytest.raises(DataError, match="no desired motion") as problem:
        build(LOG, SPEC, THESIS)
    assert problem.value.exit_code == 3
    with pytest.raises(DataError, match="no rows remain of this log of 32 s"):
        build(LOG, SPEC, ArmData(trim_s=20.0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inputs": "true"}, "inputs must be 'measured' or 'desired'"),
        ({"cutoff_hz": 0.0}, "cutoff_hz must be a number above zero or 'auto' or 'none'"),
        ({"cutoff_hz": "automatic"}, "cutoff_hz must be"),
        ({"rate_hz": -1.0}, "rate_hz must be a number above zero"),
        ({"stick_fraction": math.nan}, "stick_fraction must be a number zero or more"),
        ({"trim_s": -1.0}, "trim_s must be a number zero or more or 'auto'"),
    ],
)
def test_wrong_options(options: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        ArmData(**options)  # type: ignore[arg-type]


def test_segments_of_one_log_are_told_apart_and_the_ways_between_left_out() -> None:
    group = np.select([T < 8.0, T < 12.0, T < 20.0], [3, -1, 5], 6)
    data = samples_of(SPEC, DEFAULT, [LOG], [group])
    assert set(data.group) == {3, 5, 6}
    assert not ((data.t >= 8.0) & (data.t < 11.99)).any()
    assert (data.group[data.t < 8.0] == 3).all()
    assert data.usable.all()
    whole = build(LOG, SPEC, replace(DEFAULT, rate_hz=100.0))
    part = samples_of(SPEC, replace(DEFAULT, rate_hz=100.0), [LOG], [group])
    same = np.isin(whole.t, part.t)
    np.testing.assert_array_equal(whole.command[same], part.command)  # one filter over all of it


def test_a_short_log_keeps_more_samples_a_second_and_the_thesis_does_not() -> None:
    log = log_of(np.arange(0.0, 6.0, 0.01))
    config = ArmData(cutoff_hz=20.0)
    counts = [len(build(log, SPEC, replace(config, least_samples=n))) for n in (0, 300, 10**6)]
    assert counts[0] == pytest.approx(6.0 * 8.0, rel=0.1)
    assert counts[1] >= 280  # the ends are trimmed afterwards
    assert counts[2] == pytest.approx(600, abs=15)  # all there are
    assert replace(THESIS, least_samples=0, inputs="desired") == THESIS
    assert duration(log) == pytest.approx(5.99)
