"""The proof between samples: never above what finer sampling finds; every collision is refused by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from clearance_examples import NAMES, REACH, clearance, planar
from hypothesis import given, settings
from hypothesis import strategies as st

from etude.limits import slack
from etude.protocols import Trajectory
from etude.trajectories import FourierTrajectory, PointToPoint, Splined
from etude.types import Array, Motion, Proof
from etude_arm.clearance.clearance_limit import MOST_EVALUATIONS, Clearance, nearest
from etude_arm.clearance.distances import CUTOFF
from etude_arm.clearance.path_poses import path_of
from etude_arm.clearance.surroundings import Box, Floor, Surroundings

LIMIT = clearance(
    planar(Surroundings(floor=Floor(0.0), box=(Box("post", (0.6, 0.0, 0.4), (0.1, 0.4, 0.8)),)))
)
FINE = 20_001


def series(seed: int, size: float = 1.0, ramp: float = 0.0, harmonics: int = 3) -> FourierTrajectory:
    rng = np.random.default_rng(seed)
    table = size * rng.standard_normal((2 * harmonics + 1, 3))
    table[0] *= 0.3
    return FourierTrajectory(table, 1.1, 4.0 * math.pi / 1.1 + ramp, ramp)


def moves(seed: int, count: int = 4, size: float = 1.2) -> PointToPoint:
    points = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    return PointToPoint(points, 1.0, 0.3, 3.0)


class Timed:
    """A trajectory of another form: the same motion, known by its bounds alone."""

    form = "timed"

    def __init__(self, inner: FourierTrajectory, jumps: bool = False) -> None:
        self.inner, self.jumps, self.duration = inner, jumps, inner.duration

    def motion(self, t: Array, orders: int = 3) -> Motion:
        return self.inner.motion(t, orders)

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:
        values, amplitudes, kappa = self.inner.bound(order, degree)
        return (values + np.inf if self.jumps and order > 1 else values), amplitudes, kappa

    def to_json(self) -> str:
        return f"{self.jumps} {self.inner.to_json()}"


def least(limit: Clearance, motion: Trajectory, count: int = FINE) -> Array:
    return limit.of_motion(motion.motion(np.linspace(0.0, motion.duration, count), 3)).min(axis=0)


def ok(rows: list[Proof]) -> bool:
    return min(slack(row) for row in rows) >= 0.0


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.3, 0.6]), st.sampled_from([0.0, 2.0]))
def test_what_is_proved_of_a_series_holds_between_the_samples(seed: int, size: float, ramp: float) -> None:
    motion = series(seed, size, ramp)
    found = least(LIMIT, motion, 2001)
    assert_holds(LIMIT.prove(motion), found)


def assert_holds(rows: list[Proof], found: Array) -> None:
    """What is proved is no more than what is found by sampling; what is refused is truly too near."""
    assert np.all(found <= [row.proved_upper for row in rows])
    if ok(rows):
        assert {row.status for row in rows} == {"proved"}
        assert np.all([row.proved_lower for row in rows] <= found + 1e-12)
    else:
        assert {row.status for row in rows} == {"sampled"}
        assert np.any(found < LIMIT.row_margins + 2e-3), "refused, although everything is clear"


def test_proofs_are_not_loose() -> None:
    """Where motions come near something the proof is, in the median, within centimetres of the samples."""
    spares = []
    for seed in range(40):
        motion = series(seed, 0.3)
        found = least(LIMIT, motion, 501)
        rows = LIMIT.prove(motion)
        if ok(rows):
            spares += [f - row.proved_lower for f, row in zip(found, rows, strict=True) if f < 0.15]
    assert len(spares) >= 5
    assert np.median(spares) < 0.02


@settings(max_examples=10)
@given(st.integers(0, 10**6))
def test_straight_moves(seed: int) -> None:
    motion = moves(seed)
    found = least(LIMIT, motion, 4001)
    assert_holds(LIMIT.prove(motion), found)


@pytest.mark.parametrize("jumps", [False, True])
def test_any_other_form_is_proved_from_its_bounds(jumps: bool) -> None:
    clear = 0
    for seed in range(6):
        motion = Timed(series(seed, 0.2), jumps)
        rows = LIMIT.prove(motion)
        found = least(LIMIT, motion.inner, 2001)
        assert_holds(rows, found)
        assert ok(rows) == ok(LIMIT.prove(motion.inner))
        clear += ok(rows)
    assert clear


def test_a_path_is_proved_for_every_speed_ramp_and_number_of_periods() -> None:
    one = series(1, 0.3)
    whole = FourierTrajectory(one.coefficients, one.omega0, 7.0 * one.duration)
    for other in (whole, one.slowed(4.0), series(1, 0.3, ramp=3.0)):
        for row, again in zip(LIMIT.prove(one), LIMIT.prove(other), strict=True):
            assert again.proved_lower == pytest.approx(row.proved_lower, abs=1e-9)


def test_only_what_is_gone_through_is_proved() -> None:
    """Of a series that ends before its period is over."""
    swing = np.zeros((3, 3))
    swing[1, 0] = -2.0  # the shoulder to -1.57 until 0.9 s, and then on into the floor
    short = FourierTrajectory(swing, 1.0, 0.9)
    assert ok(LIMIT.prove(short))
    assert not ok(LIMIT.prove(FourierTrajectory(swing, 1.0, 2.0 * math.pi)))
    assert path_of(short).knots[-1] == 0.9


def test_held_set_points_are_taken_to_be_joined_by_lines() -> None:
    points = np.array([[[0.0, 0.0, 0.0], [-0.4, 0.3, 0.0], [-0.8, 0.0, 0.2], [-0.2, 0.1, 0.0]]])
    curve = Splined(np.array([0.0, 1.0, 2.0, 3.0]), points, held=True)
    held, moved = LIMIT.prove(curve), LIMIT.prove(PointToPoint(points[0], 1.0))
    assert ok(held)
    for row, line in zip(held, moved, strict=True):
        assert row.proved_lower <= line.proved_lower + 1e-9  # its first intervals are longer


def colliding(seed: int) -> tuple[FourierTrajectory, Array]:
    """A motion through a random pose that collides, and that pose."""
    rng = np.random.default_rng(seed)
    while True:
        pose = rng.uniform(-REACH, REACH, 3)
        if LIMIT.of_motion(Motion(np.zeros(1), pose[None, None]))[0].min() < -0.005:
            break
    table = 0.1 * rng.standard_normal((5, 3))
    path = FourierTrajectory(table, 1.0, 2.0 * math.pi)
    table[0] += pose - path.motion(np.array([rng.uniform(0.0, 6.0)]), 1).orders[0, 0]
    return FourierTrajectory(table, 1.0, 2.0 * math.pi), pose


@pytest.mark.parametrize("seed", range(30))
def test_a_motion_through_a_collision_is_refused_with_pair_and_time(seed: int) -> None:
    motion, _ = colliding(seed)
    failed = [row for row in LIMIT.prove(motion) if slack(row) < 0.0]
    assert failed
    gaps = {gap.text: i for i, gap in enumerate(LIMIT.gaps.list)}
    for row in failed:
        pair, _, time = row.where.rpartition(" at ")
        pose = motion.motion(np.array([float(time.removesuffix(" s"))]), 1).orders[0]
        assert LIMIT.gaps.of_poses(pose)[0, gaps[pair]] < 0.01 + 0.01, "the time has three digits"


def test_what_cannot_be_decided_is_refused() -> None:
    """Distances that touch the limit everywhere need ever more samples."""
    path = path_of(series(0, 1.0))
    touching = nearest(path, lambda poses: np.full((len(poses), 1), 0.01), np.ones((1, 3)), np.array([0.01]))
    assert touching.proved[0] < 0.01
    assert not touching.touched
    assert MOST_EVALUATIONS / 2 < touching.evaluations <= MOST_EVALUATIONS
    clear = nearest(path, lambda poses: np.full((len(poses), 1), 0.3), np.ones((1, 3)), np.array([0.01]))
    assert 0.01 <= clear.proved[0] < 0.3


def test_far_pairs_are_proved_as_far_as_is_looked() -> None:
    rows = LIMIT.prove(series(0, 1e-6))
    assert {row.status for row in rows} == {"proved"}
    assert max(row.proved_lower for row in rows) == pytest.approx(CUTOFF, abs=2e-4)
    assert {row.where for row in rows if row.proved_lower > CUTOFF - 2e-4} == {""}
    assert LIMIT.names == NAMES
