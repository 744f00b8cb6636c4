"""From log to data set: consistent derivatives, mask, trimming, thinning, and refusal of what cannot be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from etude.models.preprocess import PRESETS, DataConfig, build_dataset, duration, preset
from etude.robots.spec import Axis, RobotSpec
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.logs.log import RobotLog
from etude.models.dataset import concatenate

Array = NDArray[np.float64]
SPEC = RobotSpec("arm", tuple(Axis(n, -2.0, 2.0, 2.0, 8.0, 90.0) for n in ("a", "b")), "N m", 100.0)
OMEGA = np.array([1.5, 2.5])


def motion(t: Array) -> tuple[Array, Array, Array]:
    phase = t[:, None] * OMEGA
    return np.sin(phase), OMEGA * np.cos(phase), -(OMEGA**2) * np.sin(phase)


def log_of(t: Array, noise: float = 0.0) -> RobotLog:
    q, qd, qdd = motion(t)
    rng = np.random.default_rng(0)
    measured = q + noise * rng.standard_normal(q.shape)
    return RobotLog(SPEC.names, SPEC.command_unit, t, measured, 2 * qdd + 3 * qd + q, source="run")


T = np.arange(-2.0, 30.0, 0.01)
LOG = log_of(T, noise=3e-4)


def test_default_inputs_are_the_motion() -> None:
    data = build_dataset(LOG, SPEC, preset("default"), group=4)
    q, qd, qdd = motion(data.t)
    np.testing.assert_allclose(data.q, q, atol=3e-3)
    np.testing.assert_allclose(data.qd, qd, atol=1e-2)
    np.testing.assert_allclose(data.qdd, qdd, atol=0.15)
    np.testing.assert_allclose(data.tau, 2 * qdd + 3 * qd + q, atol=0.1)
    assert set(data.group) == {4}
    # half a percent of room: the top speed is that of all samples, before thinning
    top = np.minimum(SPEC.velocity, np.abs(data.qd).max(axis=0))
    assert not np.any(data.stuck & (np.abs(data.qd) > 1.005 * 0.05 * top))
    assert np.all(data.stuck | (np.abs(data.qd) > 0.995 * 0.05 * top))


def test_the_stick_mask_never_exceeds_its_part_of_the_velocity_limit() -> None:
    slow = RobotSpec(
        SPEC.name, tuple(replace(a, velocity=0.1) for a in SPEC.axes), SPEC.command_unit, SPEC.rate
    )
    data = build_dataset(LOG, slow, preset("default"))
    np.testing.assert_array_equal(data.stuck, np.abs(data.qd) < 0.05 * 0.1)


def test_position_and_command_pass_the_same_filter() -> None:
    config = DataConfig(cutoff_hz=0.4, trim_s=6.0)
    data = build_dataset(log_of(T), SPEC, config)
    # The dynamics are linear with constant coefficients, so a shared filter leaves them exact.
    np.testing.assert_allclose(data.tau, 2 * data.qdd + 3 * data.qd + data.q, atol=2e-3)


def test_lead_in_and_edges_are_trimmed() -> None:
    config = DataConfig(cutoff_hz=1.0, trim_s=3.0)
    data = build_dataset(LOG, SPEC, config)
    assert 1.0 - 1e-6 < data.t[0] < 1.0 + 0.13
    assert 26.99 - 0.13 < data.t[-1] <= 26.99 + 1e-9
    late = build_dataset(LOG, SPEC, replace(config, trim_s="auto"))
    assert -1e-6 < late.t[0] < 0.13


@pytest.mark.parametrize(("rate", "rate_hz", "step"), [(100.0, 8.0, 12), (125.0, 8.0, 15), (100.0, 500.0, 1)])
def test_thinning(rate: float, rate_hz: float, step: int) -> None:
    log = log_of(np.arange(0.0, 20.0, 1.0 / rate))
    data = build_dataset(log, SPEC, DataConfig(rate_hz=rate_hz))
    np.testing.assert_allclose(np.diff(data.t), step / rate, atol=1e-9)


def test_repeated_motions_are_sampled_at_other_times() -> None:
    parts = [build_dataset(LOG, SPEC, preset("default"), group=g) for g in range(4)]
    starts = {round(float(part.t[0]), 6) for part in parts}
    assert len(starts) == 4
    assert len(concatenate(parts)) == sum(map(len, parts))


def test_the_thesis_takes_the_desired_motion_and_the_raw_command() -> None:
    q, qd, qdd = motion(T)
    log = replace(LOG, q_des=q + 1.0, qd_des=qd, qdd_des=qdd)
    assert len(build_dataset(log, SPEC, preset("thesis"))) == np.count_nonzero(T > -1e-6)
    data = build_dataset(log, SPEC, replace(preset("thesis"), rate_hz=100.0 / 12.0))
    rows = np.searchsorted(T, data.t - 1e-6)
    np.testing.assert_array_equal(np.diff(rows), 12)
    assert data.t[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(data.q, log.q_des[rows], atol=1e-9)  # type: ignore[index]
    np.testing.assert_allclose(data.qdd, qdd[rows], atol=1e-9)
    np.testing.assert_allclose(data.tau, LOG.tau[rows], atol=1e-9)
    assert not data.stuck.any()


def test_desired_derivatives_are_made_if_the_log_has_none() -> None:
    log = replace(LOG, q_des=motion(T)[0])
    data = build_dataset(log, SPEC, replace(preset("thesis"), trim_s=2.0))
    np.testing.assert_allclose(data.qd, motion(data.t)[1], atol=2e-2)


def test_a_pause_is_not_filtered_across() -> None:
    keep = (T < 10) | (T > 13)
    log = replace(LOG, t=T[keep], q=LOG.q[keep], tau=LOG.tau[keep])
    data = build_dataset(log, SPEC, DataConfig(cutoff_hz=2.0))
    assert not ((data.t > 9.5) & (data.t < 13.5)).any()
    np.testing.assert_allclose(data.qd, motion(data.t)[1], atol=2e-2)


def test_standing_joints_are_masked_each_for_itself() -> None:
    q = LOG.q.copy()
    q[1500:2500, 1] = q[1500, 1]
    data = build_dataset(replace(LOG, q=q), SPEC, DataConfig(cutoff_hz=3.0))
    inside = (data.t > 14) & (data.t < 22)
    assert data.stuck[inside, 1].all()
    assert data.stuck[inside, 0].mean() < 0.1
    assert not build_dataset(LOG, SPEC, DataConfig(stick_fraction=0.0)).stuck.any()


def test_refuses_other_joints_missing_desired_motion_and_nothing_left() -> None:
    with pytest.raises(DataError, match="the log has the joints b, a"):
        build_dataset(replace(LOG, names=("b", "a")), SPEC, preset("default"))
    with pytest.raises(DataError, match="no desired motion") as problem:
        build_dataset(LOG, SPEC, preset("thesis"))
    assert problem.value.exit_code == 3
    with pytest.raises(DataError, match="nothing is left of this log of 32 s"):
        build_dataset(LOG, SPEC, DataConfig(trim_s=20.0))


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
        DataConfig(**options)  # type: ignore[arg-type]


def test_presets() -> None:
    assert preset("default") == DataConfig()
    with pytest.raises(UsageError, match=r"unknown data preset 'best'.*default, thesis"):
        preset("best")
    assert PRESETS["thesis"].inputs == "desired"


def test_a_short_log_keeps_more_samples_a_second_and_the_thesis_does_not() -> None:
    log = log_of(np.arange(0.0, 6.0, 0.01))
    config = DataConfig(cutoff_hz=20.0)
    counts = [len(build_dataset(log, SPEC, replace(config, least_samples=n))) for n in (0, 150, 10**6)]
    assert counts[0] == pytest.approx(6.0 * 8.0, rel=0.1)
    assert counts[1] >= 140  # the ends are trimmed afterwards
    assert counts[2] == pytest.approx(600, abs=15)  # all there are
    assert preset("thesis").least_samples == 0
    assert duration(log) == pytest.approx(5.99)
