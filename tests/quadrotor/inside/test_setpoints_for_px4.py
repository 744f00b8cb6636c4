"""PX4's cascade makes the planned accelerations of those in the set-points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.deploy import MotionWithCommands
from etude.trajectories import FourierTrajectory
from etude.types import Array
from etude_quadrotor import KIND, NED, OFFBOARD, QuadrotorSpec

SPEC: QuadrotorSpec = KIND.spec(Path(__file__).parents[3] / "examples" / "px4" / "px4_quad.toml")
DRAG, DT, G = 0.4, 0.002, 9.80665


def motion(pace: float) -> FourierTrajectory:
    """Two whole periods along x, y and z, at rest at both ends."""
    table = np.zeros((5, 3))
    table[0, 2] = 2.0
    table[[1, 2], 0], table[[1, 2], 1], table[[3, 4], 2] = (1.0, -1.0), (-0.6, 0.6), (0.4, -0.2)
    return FourierTrajectory(table, pace, 4.0 * np.pi / pace)


def told(own: FourierTrajectory) -> MotionWithCommands:
    def acceleration(t: Array) -> Array:
        orders = own.motion(t, 3).orders
        return np.asarray(orders[2] + DRAG * orders[1])

    return MotionWithCommands(own, acceleration=acceleration)


def table(own: FourierTrajectory, spec: QuadrotorSpec = SPEC) -> Array:
    """Rows of setpoints.csv."""
    return rows_of(OFFBOARD(told(own), KIND, spec))


def rows_of(files: Mapping[str, bytes]) -> Array:
    """Numbers of setpoints.csv."""
    return np.loadtxt(files["setpoints.csv"].decode().splitlines(), delimiter=",", skiprows=1)


def answered(sent: Array, velocity: Array, spec: QuadrotorSpec) -> Array:
    """(T, 2) m/s^2 of thrust that an attitude behind by one lag makes of set-points, apart by DT.

    The velocity controller takes the measured acceleration times its D off. The drag is that of the plan.
    """
    force, out = np.zeros(2), np.zeros((len(sent), 2))
    for k in range(len(sent)):
        out[k] = force
        rate = force - DRAG * velocity[k]
        force = force + DT * spec.attitude_gain * (sent[k] - spec.velocity_damping * rate - force)
    return out


def miss(pace: float, spec: QuadrotorSpec, *, allows: bool = True) -> float:
    """Largest error of what the cascade makes of the rows, relative to the largest planned acceleration."""
    own, rows = motion(pace), table(motion(pace), spec)
    sent = rows[:, 7:9] - (0.0 if allows else rows[:, 14:16])
    t = np.arange(0.0, own.duration, DT)
    velocity = (own.motion(t, 2).orders[1] @ NED.T)[:, :2]
    planned = (told(own).acceleration(t) @ NED.T)[:, :2]  # type: ignore[misc]
    held = np.stack([np.interp(t, rows[:, 0], column) for column in sent.T], axis=1)
    inner = np.abs(t / own.duration - 0.5) < 0.35  # the lead grows with the motion, and ends before it
    return float(np.abs(answered(held, velocity, spec) - planned)[inner].max() / np.abs(planned).max())


@pytest.mark.parametrize(("gain", "damping"), [(6.5, 0.2), (4.0, 0.35), (8.0, 0.0)])
def test_a_lagging_attitude_answers_them_with_the_planned_accelerations(gain: float, damping: float) -> None:
    """To second order in lag times pace: half of the pace leaves a quarter of the error."""
    spec = replace(SPEC, attitude_gain=gain, velocity_damping=damping)
    quick, slow = miss(1.0, spec), miss(0.5, spec)
    assert quick < 0.04 * (6.5 / gain) ** 2
    assert slow < 0.3 * quick
    assert miss(1.0, spec, allows=False) > 4.0 * quick


def test_they_are_at_rest_before_and_after_and_begin_and_end_without_a_step() -> None:
    rows = table(motion(1.0))
    for part in (rows[:, 7:10], rows[:, 14:17]):
        assert not part[0].any()
        assert not part[-20:].any()
        assert np.abs(np.diff(part, axis=0)).max() < 0.25
    assert np.abs(rows[:, 14:16]).max() > 0.3
    assert not rows[:, 16].any(), "thrust is not late"


def test_without_drag_they_are_the_motion_alone() -> None:
    own = motion(1.0)
    none = MotionWithCommands(own, acceleration=lambda t: own.motion(t, 3).orders[2])
    rows = np.loadtxt(
        OFFBOARD(none, KIND, SPEC)["setpoints.csv"].decode().splitlines(), delimiter=",", skiprows=1
    )
    assert not rows[:, 11:].any()


def test_what_was_played_is_the_motion() -> None:
    own = motion(1.0)
    played = OFFBOARD.back(OFFBOARD(told(own), KIND, SPEC))
    orders = own.motion(np.minimum(played.times, own.duration), 3).orders
    np.testing.assert_allclose(played.points, orders, atol=2e-6)


def test_no_vehicle_tilts_further_than_its_limit_whatever_its_damping() -> None:
    """Not one without delay and damping either, and with MPC_ACC_DECOUPLE of 0 or 1."""
    own = motion(1.6)
    force = told(own).acceleration(np.linspace(0.0, own.duration, 999))  # type: ignore[misc]
    needed = float(np.arctan2(np.hypot(force[:, 0], force[:, 1]), G + force[:, 2]).max())
    tilt = 1.001 * needed
    files = [OFFBOARD(replace(told(own), tilt=most), KIND, SPEC) for most in (math.inf, tilt)]
    free, bound = map(rows_of, files)

    def tilts(rows: Array) -> Array:
        level = np.hypot(rows[:, 7], rows[:, 8])
        return np.array([np.arctan2(level, lift).max() for lift in (G, G - rows[:, 9])])

    assert tilts(free).max() > 1.05 * tilt
    assert tilts(bound).max() <= tilt * (1.0 + 1e-6)
    assert np.abs(bound[:, 7:9] - free[:, 7:9]).max(axis=1).astype(bool).mean() < 0.5, "only where it must"
    stated = OFFBOARD(replace(told(own), tilt=tilt), KIND, replace(SPEC, damping_stated=True))
    np.testing.assert_array_equal(rows_of(stated)[:, :-1], free[:, :-1])
    possible = OFFBOARD.answered(files[1])
    assert possible is not None
    lean = np.arctan2(np.hypot(possible[:, 0], possible[:, 1]), G + possible[:, 2])
    assert needed * 0.99 < lean.max() <= tilt * (1.0 + 1e-6)
