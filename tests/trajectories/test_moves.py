from __future__ import annotations

import numpy as np
import pytest

from etude.errors import UsageError
from etude.trajectories import PointToPoint, from_json, random_moves

LOWER, UPPER = np.array([-2.0, 0.1, -0.4]), np.array([0.5, 0.2, 4.0])
SPEED, BEND = np.array([0.3, 2.0, 9.0]), np.array([5.0, 0.2, 1.0])


def test_one_move_by_hand() -> None:
    move = PointToPoint(np.array([[0.0, 1.0], [1.5, 1.0]]), 0.5, dwell=1.0)
    assert move.times == pytest.approx([1.875 * 1.5 / 0.5])
    assert move.duration == pytest.approx(5.625 + 2.0)
    q, qd, qdd = move.motion(np.array([1.0 + 0.5 * 5.625])).orders
    assert q[0] == pytest.approx([0.75, 1.0])
    assert qd[0] == pytest.approx([0.5, 0.0])
    assert qdd[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_acceleration_stretches_short_moves() -> None:
    move = PointToPoint(np.array([[0.0], [0.01]]), 5.0, 0.0, peak_acceleration=0.2)
    _, qd, qdd = move.motion(np.linspace(0.0, move.duration, 20001)).orders
    assert np.abs(qdd).max() == pytest.approx(0.2, rel=1e-6)
    assert np.abs(qd).max() < 5.0


def test_each_move_has_its_own_speed_and_waypoints_are_reached() -> None:
    points = np.array([[0.0], [1.0], [0.5], [0.5]])
    moves = PointToPoint(points, np.array([[0.1], [0.2], [0.3]]), dwell=0.5)
    stops = 0.5 + np.cumsum(moves.times + 0.5) - 0.25
    q, qd = moves.motion(stops, 2).orders
    np.testing.assert_allclose(q, points[1:], atol=1e-14)
    assert not qd.any()
    fastest = np.abs(moves.motion(np.linspace(0, moves.duration, 5001), 2).orders[1]).max()
    assert fastest == pytest.approx(0.2, rel=1e-5)


def test_the_bound_is_exact() -> None:
    """Every derivative stays between its values and reaches both ends, jerk included."""
    moves = random_moves(np.random.default_rng(1), LOWER, UPPER, SPEED, BEND, 6)
    dense = moves.motion(np.linspace(0.0, moves.duration, 200_001), 4).orders
    for order in range(4):
        values, amplitudes, kappa = moves.bound(order)
        assert kappa == 1.0
        assert not amplitudes.any()
        low, high = dense[order].min(axis=0), dense[order].max(axis=0)
        room = 1e-12 * np.abs(values).max(axis=0)
        assert np.all((values.min(axis=0) - room <= low) & (high <= values.max(axis=0) + room))
        np.testing.assert_allclose(np.ptp(dense[order], axis=0), np.ptp(values, axis=0), rtol=2e-3)
        np.testing.assert_array_equal(moves.bound(order, 2)[0], values)


def test_orders_that_moves_do_not_have() -> None:
    moves = PointToPoint(np.array([[0.0], [1.0]]), 1.0)
    with pytest.raises(UsageError, match="orders 1 to 4, not 5"):
        moves.motion(np.zeros(1), 5)
    with pytest.raises(UsageError, match="nothing bounds derivative 4"):
        moves.bound(4)


def test_slowed_down_they_are_the_same_path() -> None:
    moves = random_moves(np.random.default_rng(2), LOWER, UPPER, SPEED, BEND, 3)
    slow, t = moves.slowed(2.5), np.linspace(0.0, moves.duration, 99)
    assert slow.duration == pytest.approx(2.5 * moves.duration)
    mine, theirs = slow.motion(2.5 * t).orders, moves.motion(t).orders
    for order in range(3):
        np.testing.assert_allclose(mine[order], theirs[order] / 2.5**order, atol=1e-12)


def test_random_moves_use_the_asked_share_of_box_and_speed() -> None:
    moves = random_moves(
        np.random.default_rng(0), LOWER, UPPER, SPEED, BEND, 40, (0.2, 0.6), box_fraction=0.5
    )
    middle, half = 0.5 * (LOWER + UPPER), 0.5 * (UPPER - LOWER)
    assert np.abs((moves.waypoints - middle) / half).max() <= 0.5
    assert len(moves.waypoints) == 41
    share = moves.peak_velocity / SPEED
    assert 0.2 <= share.min() <= share.max() <= 0.6
    np.testing.assert_allclose(np.ptp(share, axis=1), 0.0, atol=1e-12)


def test_json_keeps_every_bit() -> None:
    moves = random_moves(np.random.default_rng(0), LOWER, UPPER, SPEED, BEND, 4)
    again = from_json(moves.to_json())
    assert isinstance(again, PointToPoint)
    assert again.waypoints.tobytes() == moves.waypoints.tobytes()
    t = np.linspace(0.0, moves.duration, 50)
    np.testing.assert_array_equal(again.motion(t).orders, moves.motion(t).orders)
    np.testing.assert_array_equal(again.times, moves.times)


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
        random_moves(np.random.default_rng(0), LOWER, UPPER, SPEED, BEND, 3, (0.5, 1.5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"\xff\x00", "not JSON"),
        (b"{", "not JSON"),
        (b"[]", "'form'"),
        (b'{"kind": "fourier"}', "fourier, moves"),
        (b'{"form": "spline"}', "fourier, moves"),
        (
            b'{"form": "moves", "kind": "moves", "waypoints": [[0], [1]], "peak_velocity": 1}',
            "does not describe",
        ),
        (b'{"form": "fourier"}', "does not describe"),
        (b'{"form": "fourier", "coefficients": [["a"]], "omega0": 1, "duration": 2}', "does not describe"),
        (b'{"form": "moves", "waypoints": [[0], [1]], "peak_velocity": 1, "speed": 3}', "does not describe"),
        (b'{"form": "fourier", "coefficients": [[0],[0],[NaN]], "omega0": 1, "duration": 2}', "finite"),
    ],
)
def test_bad_trajectory_files(text: bytes, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        from_json(text)
