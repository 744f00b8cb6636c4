"""The filter smears friction at a fast reversal: samples there do not teach, once there are plenty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.types import Array, Log, Mask, Samples
from etude_arm import KIND, ArmSpec, Axis
from etude_arm.preprocessing import ArmData, near_reversals, samples_of, spared

SPEC = ArmSpec("arm", tuple(Axis(n, -2.0, 2.0, 2.0, 8.0, 90.0) for n in ("a", "b")), "N m", 100.0)
CHANNELS = {channel.name: channel for channel in SPEC.channels()}
T = np.arange(0.0, 60.0, 0.01)
INERTIA, COULOMB = 2.0, 5.0
ALL, LEFT = ArmData(reversal=0.0), ArmData(plenty=0)


def log_of(q: Array, qd: Array, qdd: Array) -> Log:
    """Inertia and Coulomb's friction alone."""
    values = {"q": q, "command": INERTIA * qdd + COULOMB * np.sign(qd)}
    return Log(T, {name: CHANNELS[name] for name in values}, values, source="run")


def swung() -> Log:
    """Both joints turn round without stopping."""
    phase = T[:, None] * np.array([1.1, 1.7])
    w = np.array([1.1, 1.7])
    return log_of(np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase))


def built(log: Log, config: ArmData) -> Samples:
    return samples_of(SPEC, config, [log], [np.zeros(len(log), dtype=np.int64)])


def error(samples: Samples) -> Array:
    """(n, J) of the exact model."""
    qd, qdd = samples.log["qd"], samples.log["qdd"]
    return np.abs(samples.command - INERTIA * qdd - COULOMB * np.sign(qd))


def kept(samples: Samples) -> Mask:
    return np.asarray(samples.usable & samples.moving)


def test_the_exact_model_is_right_where_samples_teach_and_wrong_where_they_do_not() -> None:
    everything, left = built(swung(), ALL), built(swung(), LEFT)
    assert error(everything)[kept(everything)].max() > 0.1 * COULOMB
    assert error(left)[kept(left)].max() < 0.02 * COULOMB
    assert 0.3 < kept(left).sum() / kept(everything).sum() < 0.95
    assert np.array_equal(left.moving, everything.moving)


def test_a_joint_that_stands_before_it_turns_is_masked_as_it_was() -> None:
    wave = np.clip(1.4 * np.sin(1.1 * T), -1.0, 1.0)[:, None] * np.ones(2)  # rests for a second at its ends
    qd = np.gradient(wave, T, axis=0)
    log = log_of(wave, qd, np.gradient(qd, T, axis=0))
    assert np.array_equal(kept(built(log, LEFT)), kept(built(log, ALL)))


def test_few_samples_all_teach() -> None:
    some = built(swung(), replace(LEFT, plenty=10**6))
    assert np.array_equal(kept(some), kept(built(swung(), ALL)))


def test_plenty_is_counted_for_each_joint_over_all_logs() -> None:
    usable = np.array([[True, False], [True, True], [False, True], [True, True]])
    samples = built(swung(), ALL).take(slice(0, 4))
    one = replace(samples, usable=usable, moving=np.array([[True, True]] * 3 + [[True, False]]))
    assert np.array_equal(spared(one, 3).usable, np.column_stack([usable[:, 0], np.ones(4, dtype=bool)]))
    groups = [np.zeros(len(T), dtype=np.int64)] * 2
    count = kept(built(swung(), LEFT)).sum(axis=0).max()
    two = samples_of(SPEC, replace(LEFT, plenty=int(count) + 1), [swung(), swung()], groups)
    assert not two.usable.all(axis=0).any()


def test_the_thesis_leaves_none_out() -> None:
    thesis = replace(ArmData(**KIND.presets["thesis"]["data"]), cutoff_hz=2.0, stick_fraction=0.05, plenty=0)
    assert built(swung(), replace(thesis, inputs="measured")).usable.all()


@pytest.mark.parametrize("reach", [0, 3])
def test_rows_of_a_reversal(reach: int) -> None:
    speed = np.array([1.0, 1, 1, 1, 0, -1, -1, -1, -1, -1, 0, 0, 0, 1, 1, 1, 0, 1])[:, None]
    near = near_reversals(speed, speed == 0.0, reach, longest=2)
    assert np.flatnonzero(near[:, 0]).tolist() == list(range(3 - reach, 5 + reach + 1))


@given(st.integers(0, 20), st.integers(1, 20), st.integers(0, 1000))
def test_time_may_run_backwards(reach: int, longest: int, seed: int) -> None:
    speed = np.random.default_rng(seed).normal(size=(60, 2)).cumsum(axis=0)
    slow = np.abs(speed) < 0.5
    forth = near_reversals(speed, slow, reach, longest)
    back = near_reversals(-speed[::-1], slow[::-1], reach, longest)[::-1]
    assert np.array_equal(forth, back)
