"""Take-off, approach, flight, return and landing: one motion from rest to rest, certified, also as played."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.campaign import There, there_and_back
from etude.deploy import certify_played
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits import APPROACH, FeasibleSet, certify, scaled
from etude.protocols import Limit, Trajectory
from etude.trajectories import Chain, Splined
from etude.types import Array
from etude_quadrotor import KIND, OFFBOARD, POLY4D, FlightConfig, QuadrotorSpec, flight_family
from etude_quadrotor.motions import approaches, home, limits
from etude_quadrotor.spec_file import check_spec

SPEC: QuadrotorSpec = KIND.spec(KIND.built_in()["quadrotor"])
SMALL = replace(
    SPEC, lower=(-1.0, -1.0, 0.0), upper=(1.0, 1.0, 2.0), speed=2.0, margin=0.25, vertical_margin=0.25
)
LABELS = ["take-off", "approach", "lead-in", "segment", "lead-out", "return", "landing"]


def flown(spec: QuadrotorSpec, seed: int, seconds: float = 15.0) -> tuple[There, tuple[Limit, ...], Array]:
    """A large random flight, in motion at its ends, from the ground and back."""
    config = FlightConfig(2, seconds, tilt=0.4363)
    own, allowed = flight_family(config), limits(spec, config, {})
    room = FeasibleSet.of(allowed, own, home(spec))
    flight = own.trajectory(scaled(np.random.default_rng(seed), room)[0])
    pose = KIND.poses(spec)["ground"]
    found = there_and_back(flight, pose, lambda m, p: approaches(spec, m, p), allowed, home(spec))
    assert found is not None
    return found, allowed, pose


def whole_of(found: There) -> Trajectory:
    assert found.whole is not None
    return found.whole


@pytest.mark.parametrize("seed", range(3))
def test_a_flight_starts_and_ends_on_the_ground_at_rest_within_three_quarters_of_a_minute(seed: int) -> None:
    found, allowed, pose = flown(SMALL, seed)
    whole = whole_of(found)
    assert [label for _, label, _ in whole.pieces()] == LABELS
    certificate = certify(whole, allowed)
    assert certificate.ok
    assert certificate.at_rest
    assert APPROACH not in certificate.not_verified
    assert whole.duration <= 45.0
    ends = whole.motion(np.array([0.0, whole.duration]), 4).orders
    np.testing.assert_allclose(ends[0], [pose, pose], atol=1e-9)
    assert np.abs(ends[1:]).max() <= 1e-9
    t = np.linspace(0.0, whole.duration, 20_001)
    jumps = np.abs(np.diff(whole.motion(t, 4).orders, axis=1)).max(axis=(1, 2))
    assert np.all(jumps <= np.array([0.005, 0.01, 0.03, 0.2])), "smooth up to jerk, where pieces meet too"


def test_only_a_way_straight_up_from_the_ground_may_be_below_the_margins() -> None:
    (box, *_) = limits(SMALL, FlightConfig(), {})
    up = np.array([[0.3, 0.2, 0.0], [0.3, 0.2, 1.0]])
    rest = np.zeros((3, 2, 3))
    take_off = Splined(np.array([0.0, 3.0]), np.concatenate([up[None], rest]))
    assert certify(take_off, [box]).ok
    assert box.prove(take_off)[2].lower == pytest.approx(0.0, abs=1e-3)
    aslant, low, below = (up.copy() for _ in range(3))
    aslant[1, 0] += 0.01
    low[:, 2] = 0.1, 1.0
    below[:, 2] = -0.1, 1.0
    for points in (aslant, low, below):
        wrong = replace(take_off, points=np.concatenate([points[None], rest]))
        assert not certify(wrong, [box]).ok
    moving = take_off.points.copy()
    moving[1, 0, 2] = 0.5
    assert not certify(replace(take_off, points=moving), [box]).ok, "it does not start from rest"


@pytest.mark.parametrize("exporter", [OFFBOARD, POLY4D])
def test_receivers_play_the_whole_and_are_certified_piece_by_piece(exporter) -> None:  # type: ignore[no-untyped-def]
    found, allowed, _ = flown(SMALL, 1)
    whole = whole_of(found)
    files = exporter(whole, KIND, SMALL)
    certificate = certify_played(exporter, files, allowed, whole)
    assert certificate.ok or max(row.proved_upper - row.upper for row in certificate.failed) < 1e-5
    lows = sorted(row.lower for row in certificate.rows if (row.axis, row.quantity) == ("z", "position"))
    assert lows == pytest.approx([0.0, 0.25], abs=1e-3), "the ground for two pieces, the margin for the rest"
    played = exporter.back(files)
    t = np.linspace(0.0, whole.duration - 0.02, 2001)
    off = np.abs(played.motion(t, 1).orders[0] - whole.motion(t, 1).orders[0]).max()
    assert off < 0.05


def test_from_hover_there_is_no_take_off_and_a_wall_in_the_way_is_refused() -> None:
    found, allowed, _ = flown(SPEC, 2)
    assert [label for _, label, _ in whole_of(found).pieces()] == LABELS
    middle = whole_of(found).pieces()[3][2]
    hover = there_and_back(middle, home(SPEC), lambda m, p: approaches(SPEC, m, p), allowed, home(SPEC))
    assert hover is not None
    assert [label for _, label, _ in whole_of(hover).pieces()] == LABELS[1:-1]
    outside = np.array([9.6, 0.0, 2.0])
    with pytest.raises(UnsafeTrajectoryError, match="position of 'x'"):
        there_and_back(middle, outside, lambda m, p: approaches(SPEC, m, p), allowed, home(SPEC))


def test_parts_that_jump_in_speed_are_no_chain() -> None:
    found, _, _ = flown(SMALL, 0)
    pieces = [(label, piece) for _, label, piece in whole_of(found).pieces()]
    pieces[2] = ("lead-in", pieces[2][1].slowed(2.0))
    with pytest.raises(UsageError, match="do not meet"):
        Chain(tuple(pieces))
    with pytest.raises(UsageError, match="ground at 1 m is not below"):
        check_spec(replace(SPEC, ground=1.0))
