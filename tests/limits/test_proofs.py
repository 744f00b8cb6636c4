"""What is proved, pinned: the numbers that the certificates of 0.1 gave for the same bytes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from limit_examples import GRAVITY, flights, room

from etude.limits import AxisLimit, FeasibleSet, certify
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory, PointToPoint

NAMES = ("a", "b")
ARM = (
    AxisLimit("position", 0, NAMES, np.array([-1.0, 0.1]), np.array([0.5, 2.0])),
    AxisLimit("velocity", 1, NAMES, -np.array([0.6, 1.0]), np.array([0.6, 1.0]), rest=True),
    AxisLimit("acceleration", 2, NAMES, -np.array([1.0, 3.0]), np.array([1.0, 3.0])),
)
TABLE = 0.3 * np.sin(1.0 + np.arange(14.0)).reshape(7, 2)
FLIGHT = flights(3, 0.7, centre=(0.1, 0.2))
CONTROLLED = room(speed=5.0, radius=9.0, tilt=0.3, thrust=(7.0, 11.0))


def chosen() -> np.ndarray:
    p = np.sin(2.0 + np.arange(FLIGHT.size))
    p[12] = 2.5
    return p


def assert_rows(motion, limits, expected) -> None:
    found = {(row.axis, row.quantity): row for row in certify(motion, limits).rows}
    assert list(found) == [(axis, quantity) for axis, quantity, _, _ in expected], "order of the rows"
    for axis, quantity, low, high in expected:
        row = found[(axis, quantity)]
        assert (row.proved_lower, row.proved_upper) == pytest.approx((low, high), rel=1e-12), quantity


def test_an_arm() -> None:
    expected = [
        ("a", "position", -0.2919199574229572, 1.29336094985425),
        ("a", "velocity", -0.7058340804723784, 0.6882725003076609),
        ("a", "acceleration", -0.6650253444476081, 0.49985156160711075),
        ("b", "position", -0.8563090502906455, 1.2153475675719392),
        ("b", "velocity", -0.6809516394419228, 0.6332916111259776),
        ("b", "acceleration", -0.5633342507964402, 0.691419805766026),
    ]
    assert_rows(FourierTrajectory(TABLE, 0.4, 20.0), ARM, expected)


def test_a_phase_ramp_costs_less_than_it_did() -> None:
    """0.1 added the largest p'' and the largest c p', which are never reached together."""
    rows = certify(FourierTrajectory(TABLE, 0.4, 20.0, 2.0), ARM).rows
    old = {"a": (-0.6650253444476081, 0.49985156160711075), "b": (-0.5633342507964402, 0.691419805766026)}
    speed = {"a": 0.7058340804723784, "b": 0.6809516394419228}
    for row in rows:
        if row.quantity == "acceleration":
            extra = 15.0 / 16.0 * speed[row.axis]
            assert old[row.axis][0] - extra < row.proved_lower < old[row.axis][0]
            assert old[row.axis][1] < row.proved_upper < old[row.axis][1] + extra


def test_moves() -> None:
    points = np.array([[0.0, 0.2], [0.4, 1.5], [-0.9, 0.3]])
    moves = PointToPoint(points, np.array([0.3, 0.5]), 0.5, np.array([0.8, 2.0]))
    expected = [
        ("a", "position", -0.9, 0.4),
        ("a", "velocity", -0.3, 0.15384615384615385),
        ("a", "acceleration", -0.11369359147118786, 0.11369359147118786),
        ("b", "position", 0.2, 1.5),
        ("b", "velocity", -0.27692307692307694, 0.5),
        ("b", "acceleration", -0.3158155318644107, 0.3158155318644107),
    ]
    assert_rows(moves, ARM, expected)


def test_a_flight() -> None:
    expected = [
        ("x", "position", -2.130332050995179, 2.213589208984934),
        ("y", "position", -2.047061110069338, 2.4715227991136093),
        ("z", "position", 0.5758729755483374, 4.303903548689427),
        ("vehicle", "speed", -3.8260788291436447, 3.8260788291436447),
        ("vehicle", "radius", -3.283172898077494, 3.283172898077494),
        ("vehicle", "lift", 6.456422439117677, 13.21453868826465),
        ("vehicle", "thrust", 6.892248247010667, 13.817673540140653),
        ("vehicle", "tilt", -0.47113499793762714, 0.47113499793762714),
    ]
    assert_rows(FLIGHT.trajectory(chosen()), CONTROLLED, expected)


def test_the_gauge_of_an_arm() -> None:
    family = FourierFamily.of(FourierConfig(3, 5.0 * math.pi, 0.4, "none"), 2)
    feasible = FeasibleSet.of(ARM, family, np.array([-0.25, 1.05]))
    p = family.parameters(TABLE)
    np.testing.assert_allclose(feasible.gauge(p), [2.0590217568895732, 2.0077461567364203], rtol=1e-14)
    smooth = feasible.smooth_gauge(p)[0]
    np.testing.assert_allclose(smooth, [2.1424254683519814, 2.0929358752063414], rtol=1e-14)


def test_lines_through_the_set_of_flights() -> None:
    feasible = FeasibleSet.of(CONTROLLED, FLIGHT, np.array([0.1, 0.2, 2.65]))
    direction, point = np.cos(np.arange(FLIGHT.size)), feasible.centre + 0.2 * chosen()
    for start, ends in (
        (feasible.centre, (-0.4164973764888578, 0.34658827410811854)),
        (point, (-0.6625094640483432, 0.1269775681906481)),
    ):
        low, high = feasible.chord(start[None], direction[None])
        np.testing.assert_allclose((low[0], high[0]), ends, rtol=1e-13)
    assert feasible.gauge(feasible.centre + direction)[0] == pytest.approx(1.0 / 0.34658827410811854)
    np.testing.assert_allclose(
        feasible.widths()[[0, 1, 2, 12, 13, 14, 15]],
        [
            4.27733026594221,
            2.138665132971105,
            1.4257767553140699,
            1.831963650011575,
            1.2823745550081025,
            0.8116050597714404,
            0.541070039847627,
        ],
        rtol=1e-12,
    )


def test_tilt_of_a_level_circle() -> None:
    """The lean is constant, atan(a/g)."""
    omega0, radius = 1.0, 3.0
    table = np.zeros((3, 3))
    table[1, 0], table[2, 1], table[0, 2] = radius * omega0, radius * omega0, 2.0
    row = certify(FourierTrajectory(table, omega0, 2.0 * np.pi), room(tilt=0.5)).rows[-1]
    assert row.quantity == "tilt"
    assert row.proved_upper == pytest.approx(math.atan2(radius * omega0**2, GRAVITY), abs=3e-4)


def test_nothing_is_proved_of_the_tilt_of_a_vehicle_that_turns_over() -> None:
    table = np.zeros((3, 3))
    table[0, 2], table[1, 2] = 2.0, 20.0
    rows = {
        row.quantity: row for row in certify(FourierTrajectory(table, 1.0, 2.0 * np.pi), room(tilt=0.5)).rows
    }
    assert rows["tilt"].proved_upper == math.pi
    assert rows["lift"].proved_lower < rows["lift"].lower
