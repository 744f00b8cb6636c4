"""How far a motion deviates from what was wanted: of few coordinates in doubt, rates have to follow too."""

from __future__ import annotations

import numpy as np
import pytest
from alignment_cases import Case

from etude.logs.alignment.alignment import CLEAR_OF_FEW, FEW, Overlap, SampledPlan, allowed

RATE, DURATION = 50.0, 30.0
T = np.arange(0.0, DURATION, 1.0 / RATE)
SLOW, QUICK = 2 * np.pi / DURATION, 2 * np.pi * 6 / DURATION

RESEMBLING = (20572, 20774, 30474, 32944)
"""Other motions of three coordinates that come within what is allowed in position."""


def plan(coordinates: int) -> SampledPlan:
    values = np.sin(SLOW * T)[:, None] * np.ones(coordinates)
    return SampledPlan(values, RATE, DURATION, np.ones(coordinates))


def ripple(coordinates: int, size: float) -> Overlap:
    """A motion with a quick harmonic of that size beside the slow one."""
    wanted = plan(coordinates)
    return Overlap.of(T, wanted.values + size * np.sin(QUICK * T)[:, None], wanted)


@pytest.mark.parametrize("size", [0.0, 0.3, 0.6])
def test_deviations_are_those_of_sines(size: float) -> None:
    found = ripple(4, size)
    assert found.pooled == pytest.approx(size, abs=2e-3)
    # a difference over s seconds shows a sine of w rad/s by 2 sin(w s / 2)
    seconds = 0.01 * DURATION
    gain = np.sin(0.5 * QUICK * seconds) / np.sin(0.5 * SLOW * seconds)
    assert found.rates == pytest.approx(size * gain, rel=0.02)
    assert found.mismatch == found.pooled


def test_of_few_coordinates_in_doubt_the_rates_count() -> None:
    assert ripple(FEW, 0.6).mismatch == ripple(FEW, 0.6).rates > allowed(1.0, FEW)
    assert ripple(FEW + 1, 0.6).mismatch == pytest.approx(0.6, abs=2e-3)
    assert ripple(FEW, 0.95 * CLEAR_OF_FEW).mismatch < CLEAR_OF_FEW


def test_too_few_rows_have_no_rates() -> None:
    few = Overlap.of(T[:5], plan(FEW).values[:5] + 0.9, plan(FEW))
    assert np.isnan(few.rates)
    assert few.mismatch == few.pooled


@pytest.mark.parametrize("seed", RESEMBLING)
def test_motions_that_resemble_each_other_in_position_are_refused(seed: int) -> None:
    assert Case.of(seed).refused()
