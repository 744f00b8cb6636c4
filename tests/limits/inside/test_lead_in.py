"""Lead-ins: from rest along a series' own path into its motion, and out of it again."""

from __future__ import annotations

import numpy as np
import pytest

from etude.limits import AxisLimit, NormLimit, at_rest, certify
from etude.limits.lead_ins import can_lead, lead_in, lead_out, moves_at
from etude.trajectories import Chain, FourierTrajectory, from_json, segment_starts


def flight(seed: int, duration: float = 15.0) -> FourierTrajectory:
    """Of three axes, in motion at its ends; also of less than a period."""
    table = np.random.default_rng(seed).normal(size=(5, 3))
    return FourierTrajectory(table, 2.0 * np.pi / 15.0, duration)


@pytest.mark.parametrize("duration", [15.0, 11.0])
@pytest.mark.parametrize("lasting", [2.0, 3.1])
def test_a_lead_meets_the_motion_to_jerk_and_rests_at_its_other_end(duration: float, lasting: float) -> None:
    motion = flight(0, duration)
    for led, at, own, rest in ((lead_in, 0.0, -1, 0), (lead_out, duration, 0, -1)):
        part = led(motion, lasting)
        ends = part.motion(np.array([0.0, lasting]), 4).orders
        joined = motion.motion(np.array([at]), 4).orders[:, 0]
        np.testing.assert_allclose(ends[:, own], joined, rtol=1e-9, atol=1e-9)
        assert np.abs(ends[1:, rest]).max() < 1e-9
        assert part.duration == lasting
        assert part.form == motion.form, "its margins are those of the motion"


def test_its_points_derivatives_are_those_of_its_path() -> None:
    """Differences of each order about its points are the next order there."""
    motion = flight(1)
    part = lead_in(motion, 3.0)
    h = 1e-4
    for order in range(3):
        inner = part.times[1:-1]
        after, before = (part.motion(inner + side, 4).orders[order] for side in (h, -h))
        np.testing.assert_allclose(
            (after - before) / (2 * h), part.points[order + 1, 1:-1], rtol=1e-4, atol=1e-4
        )
    t = np.linspace(0.0, 3.0, 400)
    places = part.motion(t, 1).orders[0]
    full = (
        FourierTrajectory(motion.coefficients, motion.omega0, 15.0)
        .motion(np.linspace(0, 15, 30_001), 1)
        .orders[0]
    )
    nearest = np.array([np.linalg.norm(full - place, axis=1).min() for place in places])
    assert nearest.max() < 2e-3, "it stays on the path, within the samples of it"


def test_a_motion_from_rest_is_one_chain_that_reads_back() -> None:
    motion = flight(2)
    assert moves_at(motion) == (True, True)
    limits = [NormLimit("speed", 1, (0, 1, 2), 20.0)]
    whole = at_rest(motion, limits)
    assert isinstance(whole, Chain)
    assert [label for _, label, _ in whole.pieces()] == ["lead-in", "segment", "lead-out"]
    assert moves_at(whole) == (False, False)
    assert segment_starts(whole) == [0.0], "a lead-in belongs to its segment"
    assert from_json(whole.to_json()).to_json() == whole.to_json()
    assert at_rest(whole, limits) is whole
    assert certify(whole, limits).at_rest


def test_what_uses_all_of_a_limit_is_slowed_until_its_lead_is_proved() -> None:
    """One harmonic: its acceleration is largest where its speed is zero, so it begins at that limit."""
    w = 2.0 * np.pi / 15.0
    motion = FourierTrajectory(np.array([[0.0], [np.sqrt(0.5)], [np.sqrt(0.5)]]), w, 15.0)
    most = 1.01 * w
    limits = [AxisLimit("acceleration", 2, ("x",), np.array([-most]), np.array([most]))]
    assert certify(motion, limits).ok
    whole = at_rest(motion, limits)
    assert certify(whole, limits).ok
    assert whole.pieces()[1][2].duration <= 1.1 * motion.duration


def test_what_rests_or_does_not_go_on_is_left_alone() -> None:
    ramped = FourierTrajectory(flight(3).coefficients, 0.4, 12.0, ramp=2.0)
    assert not can_lead(ramped)
    assert at_rest(ramped, []) is ramped
