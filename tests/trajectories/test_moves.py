from __future__ import annotations

import numpy as np
import pytest
from trajectory_examples import robot

from etude.errors import UsageError
from etude.trajectories.moves import PointToPoint, random_moves
from etude.trajectories.trajectory_file import from_json


def test_one_move_by_hand() -> None:
    move = PointToPoint(np.array([[0.0, 1.0], [1.5, 1.0]]), 0.5, dwell=1.0)
    assert move.times == pytest.approx([1.875 * 1.5 / 0.5])
    assert move.duration == pytest.approx(5.625 + 2.0)
    halfway = move.sample(np.array([1.0 + 0.5 * 5.625]))
    assert halfway.q[0] == pytest.approx([0.75, 1.0])
    assert halfway.qd[0] == pytest.approx([0.5, 0.0])
    assert halfway.qdd[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_acceleration_stretches_short_moves() -> None:
    move = PointToPoint(np.array([[0.0], [0.01]]), 5.0, 0.0, peak_acceleration=0.2)
    samples = move.sample(np.linspace(0.0, move.duration, 20001))
    assert np.abs(samples.qdd).max() == pytest.approx(0.2, rel=1e-6)
    assert np.abs(samples.qd).max() < 5.0


def test_each_move_has_its_own_speed_and_waypoints_are_reached() -> None:
    points = np.array([[0.0], [1.0], [0.5], [0.5]])
    moves = PointToPoint(points, np.array([[0.1], [0.2], [0.3]]), dwell=0.5)
    stops = 0.5 + np.cumsum(moves.times + 0.5) - 0.25
    np.testing.assert_allclose(moves.sample(stops).q, points[1:], atol=1e-14)
    assert not moves.sample(stops).qd.any()
    assert np.abs(moves.sample(np.linspace(0, moves.duration, 5001)).qd).max() == pytest.approx(0.2, rel=1e-5)


def test_random_moves_use_the_asked_share_of_box_and_speed() -> None:
    spec = robot(2)
    moves = random_moves(np.random.default_rng(0), spec, 40, (0.2, 0.6), box_fraction=0.5)
    middle, half = 0.5 * (spec.lower + spec.upper), 0.5 * (spec.upper - spec.lower)
    assert np.abs((moves.waypoints - middle) / half).max() <= 0.5
    assert len(moves.waypoints) == 41
    share = moves.peak_velocity / spec.velocity
    assert 0.2 <= share.min() <= share.max() <= 0.6
    np.testing.assert_allclose(np.ptp(share, axis=1), 0.0, atol=1e-12)


def test_json_keeps_every_bit() -> None:
    moves = random_moves(np.random.default_rng(0), robot(), 4)
    again = from_json(moves.to_json())
    assert isinstance(again, PointToPoint)
    assert again.waypoints.tobytes() == moves.waypoints.tobytes()
    t = np.linspace(0.0, moves.duration, 50)
    np.testing.assert_array_equal(again.sample(t).q, moves.sample(t).q)
    np.testing.assert_array_equal(PointToPoint.from_json(moves.to_json()).times, moves.times)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((1, 2)), 1.0), "waypoints must be"),
        ((np.array([[0.0], [np.nan]]), 1.0), "waypoints must be"),
        ((np.array([[0.0], [1.0]]), -1.0), "peak_velocity must be positive"),
        ((np.array([[0.0], [1.0]]), np.ones(3)), "does not fit"),
        ((np.array([[0.0], [1.0]]), 1.0, -0.1), "dwell"),
        ((np.array([[0.0], [0.0]]), 1.0, 0.0), "all the same point"),
    ],
)
def test_bad_input(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        PointToPoint(*arguments)


def test_bad_fractions() -> None:
    with pytest.raises(UsageError, match="fractions in"):
        random_moves(np.random.default_rng(0), robot(), 3, (0.5, 1.5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"\xff\x00", "not JSON"),
        (b"{", "not JSON"),
        (b"[]", "'kind'"),
        (b'{"kind": "spline"}', "fourier, moves"),
        (b'{"kind": "fourier"}', "does not describe"),
        (b'{"kind": "fourier", "coefficients": [["a"]], "omega0": 1, "duration": 2}', "does not describe"),
        (b'{"kind": "moves", "waypoints": [[0], [1]], "peak_velocity": 1, "speed": 3}', "does not describe"),
        (b'{"kind": "fourier", "coefficients": [[0],[0],[NaN]], "omega0": 1, "duration": 2}', "finite"),
    ],
)
def test_bad_trajectory_files(text: bytes, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        from_json(text)
