"""Random recordings of random motions of ten robots are aligned to a sample, another motion is refused."""

from __future__ import annotations

import numpy as np
import pytest
from alignment_cases import KINDS, TEN, Case, failures
from log_examples import CHANNELS, SCALE, Sines, log_with

from etude.logs import align

EVERYDAY_RATE = 200.0
"""Hz; logs of more rows take longer and are left to the slow test."""
EVERYDAY = [seed for seed in range(60) if Case.of(seed).rate < EVERYDAY_RATE][:20]

TOPS = 20444
"""Noise makes several tops of one peak here, one of them near the clock's own start."""
EARLY = (20869, 40524)
"""The recorder begins up to 2.5 rows before the motion and ends with it, by a clock that begins at 0."""


@pytest.mark.parametrize("seed", [*EVERYDAY, TOPS, *EARLY])
def test_a_log_of_the_proposal_is_aligned_to_a_sample(seed: int) -> None:
    case = Case.of(seed)
    assert case.error() <= 1.0 / case.rate + 1e-6, case


@pytest.mark.parametrize("seed", EVERYDAY[::2])
def test_a_log_of_another_motion_is_refused(seed: int) -> None:
    assert Case.of(seed).refused()


def test_the_cases_hold_every_robot_and_nearly_every_kind() -> None:
    cases = [Case.of(seed) for seed in EVERYDAY]
    assert {case.robot.name for case in cases} == set(TEN)
    assert len({case.kind for case in cases}) >= len(KINDS) - 1


def test_the_planned_rates_are_zero_outside_the_motion() -> None:
    """The motion is cut while it moves: its rates at the ends are not 0, and the robot rests outside."""
    motion = Sines(duration=18.3)
    t = np.arange(-2.0, 20.0, 0.01)
    q = motion.motion(t).orders[0]
    found = align(log_with(t, q=q), motion, CHANNELS, "q", SCALE)
    outside = (found.t < -1e-6) | (found.t > motion.duration + 1e-6)
    assert outside.sum() > 300
    for order, name in enumerate(("qd_des", "qdd_des"), 1):
        np.testing.assert_array_equal(found[name][outside], 0.0)
        own = motion.motion(found.t[~outside]).orders[order]
        np.testing.assert_array_equal(found[name][~outside], own)
        assert np.abs(own[-1]).min() > 0.05


@pytest.mark.slow
def test_500_cases_over_10_robots() -> None:
    """Of other seeds: python tests/logs/alignment_cases.py FIRST COUNT."""
    assert failures(0, 500) == ([], [])
