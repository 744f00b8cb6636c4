"""What motions visit of where a robot can be, and motions that are looked for where none was yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from etude.design.candidates import BINS, SLOW, ClearPoseSource, ReachablePoses, Region, VisitedTimes
from etude.design.chain_design import nearest_order
from etude.limits import AxisLimit
from etude.protocols import Family, Trajectory
from etude.trajectories import FourierConfig, FourierFamily, FourierTrajectory, PointToPoint
from etude.types import Array, Cone, Motion, Proof, Reachable

NAMES = ("x", "y")
ENDS = np.array([3.0, 3.0])
FAMILY = FourierFamily.of(FourierConfig(3, 10.0), axes=2)


@dataclass(frozen=True, eq=False)
class Corridor:
    """An L: |x| <= 0.4 or |y| <= 0.4. Any box about the corner is narrow, and a path is not."""

    lower: Array
    upper: Array
    name: str = "corridor"

    def about(self, lower: Array, upper: Array) -> Corridor:
        return Corridor(lower, upper)

    def roughly(self, form: str, pose: Array) -> Callable[[Array], bool]:
        return self.holds

    def holds(self, poses: Array) -> bool:
        return bool(np.all(np.abs(poses).min(axis=1) <= 0.4))

    def cones(self, family: Family) -> list[Cone]:
        return list(AxisLimit("box", 0, NAMES, self.lower, self.upper).cones(family))

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        return 0.0, np.zeros_like(motion.orders)

    def keeps(self, piece: Trajectory) -> bool:
        return self.holds(self.of_motion(piece.motion(np.linspace(0.0, piece.duration, 301), 1)))

    def prove(self, piece: Trajectory) -> list[Proof]:
        far = float(
            np.abs(piece.motion(np.linspace(0.0, piece.duration, 3001), 1).orders[0]).min(axis=1).max()
        )
        return [Proof("both", "corridor", -np.inf, 0.4, 0.0, far, "samples")]

    def of_motion(self, motion: Motion) -> Array:
        return np.asarray(motion.orders[0])


@dataclass(frozen=True, eq=False)
class WeakDrives:
    """Drives that hold the robot within 0.3 of one pose: most poses that are clear are none to rest at."""

    pose: Array
    name: str = "torque"

    def blocked(self, form: str, pose: Array) -> str:
        return "" if np.linalg.norm(pose - self.pose) <= 0.3 else "the torque of x"

    def cones(self, family: Family) -> list[Cone]:
        return []

    def penalty(self, motion: Motion) -> tuple[float, Array]:
        return 0.0, np.zeros_like(motion.orders)

    def prove(self, piece: Trajectory) -> list[Proof]:
        far = float(np.linalg.norm(way(piece) - self.pose, axis=1).max())
        return [Proof("both", "torque", -np.inf, 0.3, 0.0, far, "samples")]

    def of_motion(self, motion: Motion) -> Array:
        return np.asarray(motion.orders[0])


LIMITS = (
    AxisLimit("position", 0, NAMES, -ENDS, ENDS),
    AxisLimit("velocity", 1, NAMES, -2.0 * np.ones(2), 2.0 * np.ones(2), rest=True),
    AxisLimit("acceleration", 2, NAMES, -4.0 * np.ones(2), 4.0 * np.ones(2)),
    Corridor(-0.4 * np.ones(2), 0.4 * np.ones(2)),
)


def poses() -> Array:
    tried = np.random.default_rng(1).uniform(-ENDS, ENDS, (400, 2))
    return np.concatenate([np.zeros((1, 2)), tried[np.abs(tried).min(axis=1) <= 0.4]])


def source(visited: VisitedTimes | None = None, total: float = 30.0) -> ClearPoseSource:
    reach = Reachable(-ENDS, ENDS, poses())
    return ClearPoseSource.of(
        FAMILY, LIMITS, ReachablePoses(reach, visited or VisitedTimes.nothing(reach), total), "scaled"
    )


def way(motion: Trajectory) -> Array:
    return motion.motion(np.linspace(0.0, motion.duration, 400), 1).orders[0]


def test_bins_count_with_half_a_percent_of_the_segments_time_and_links_do_not() -> None:
    table = np.zeros((7, 1))
    table[0], table[1] = 0.5, 0.5 * 2.0 * np.pi / 10.0  # 0 to 1 and back, fast in the middle
    swing = FourierTrajectory(table, 2.0 * np.pi / 10.0, 10.0)
    reach = Reachable(np.array([-1.0]), np.array([1.0]), np.zeros((0, 1)))
    assert VisitedTimes.nothing(reach).share().tolist() == [0.0]
    half = VisitedTimes.nothing(reach).adding([swing])
    assert half.share() == pytest.approx(0.5)
    assert half.bins().tolist() == [[False] * (BINS // 2) + [True] * (BINS // 2)]
    assert half.seconds.sum() == pytest.approx(10.0)
    assert half.share(total=300.0).tolist() == [0.1], "of a longer recording only where it turns round"
    link = PointToPoint(np.array([[-1.0], [1.0]]), 1.0)
    link_alone = VisitedTimes.nothing(reach).adding_poses(way(link), 0.0)
    assert link_alone.share().tolist() == [0.0]


def test_candidates_go_through_a_corridor_farther_than_any_box() -> None:
    rng = np.random.default_rng(0)
    found = source().candidates(rng, 24)
    for one in found:
        assert isinstance(one, Region)
        assert all(row.proved_upper <= 0.41 for row in LIMITS[3].prove(one.trajectory))
        assert np.ptp(way(one.trajectory), axis=0).max() > 2.0, "a clear box about home is 0.8 wide"
        np.testing.assert_allclose(np.ptp(way(one.family.trajectory(one.standing)), axis=0), 0.0, atol=1e-12)


def test_motions_are_centred_where_drives_hold_the_robot() -> None:
    """One pose in fifty, so that random ones alone would hardly find any."""
    reach = Reachable(-ENDS, ENDS, poses())
    roam = ReachablePoses(reach, VisitedTimes.nothing(reach), 30.0)
    weak = WeakDrives(np.array([2.0, 0.0]))
    held = [pose for pose in reach.poses if not weak.blocked("", pose)]
    assert 0 < len(held) <= len(reach.poses) // 15
    for seed in range(5):
        roamed = ClearPoseSource.of(FAMILY, (*LIMITS, weak), roam, "scaled")
        for one in roamed.candidates(np.random.default_rng(seed), 24):
            assert weak.prove(one.trajectory)[0].proved_upper <= 0.3
            assert np.ptp(way(one.trajectory), axis=0).max() > 0.02, "it moves"


def test_each_side_is_widened_by_itself() -> None:
    """A wall on one side leaves the other alone."""
    roamed = source()
    p = FAMILY.parameters(np.vstack([np.zeros((1, 2)), np.full((6, 2), 0.02)]))
    stand = roamed.stand(FAMILY)
    kept = roamed._nonconvex(FAMILY, p)
    before = way(FAMILY.trajectory(p))
    p = kept.widened(
        roamed.ordered(FAMILY),
        FAMILY,
        p,
        stand,
        (2.0, 1.4, 1.15),
        lambda q: way(FAMILY.trajectory(q))[:, 0].max() <= 0.5,
    )
    after = way(FAMILY.trajectory(p))
    assert after[:, 0].max() <= 0.5
    assert after[:, 0].min() < 4.0 * before[:, 0].min()
    assert np.ptp(after[:, 1]) > 4.0 * np.ptp(before[:, 1])


def test_what_was_visited_is_left_for_what_was_not() -> None:
    """One arm of the L has been visited: next motions are mostly in the other."""
    reach = Reachable(-ENDS, ENDS, poses())
    seen = np.column_stack([np.linspace(-3.0, 3.0, 600), np.linspace(-0.4, 0.4, 600)])
    visited = VisitedTimes.nothing(reach).adding_poses(seen, 60.0)
    news = [source(visited, 120.0), source(None, 120.0)]
    wide = []
    for one in news:
        approaches = [
            way(c.trajectory)
            for seed in range(6)
            for c in one.candidates(np.random.default_rng(seed), 24)[:1]
        ]
        wide.append(np.mean([np.ptp(w[:, 1]) > np.ptp(w[:, 0]) for w in approaches]))
    assert wide[0] >= 0.8
    assert wide[0] > wide[1] - 1e-9


def test_slow_candidates_are_drawn_anew() -> None:
    """Speeds are compared with what the limits alone allow."""
    roamed = source()
    curves = roamed._rough_curves(np.random.default_rng(3), 12, widened=True)
    best = roamed.candidates(np.random.default_rng(3), 24)[0]
    fastest = max(curve.speed for curve in curves)
    assert fastest >= SLOW
    assert roamed._speed(best.family, best.p) > 0.0


def test_segments_are_chained_near_to_near() -> None:
    def at(pose: float) -> FourierTrajectory:
        table = np.zeros((7, 1))
        table[0] = pose
        return FourierTrajectory(table, 1.0, 2.0 * np.pi)

    def approaches(motion: Trajectory, pose: Array) -> tuple[Trajectory, Trajectory]:
        first = motion.motion(np.zeros(1), 1).orders[0, 0]
        ends = np.stack([pose, first])
        return PointToPoint(ends, 1.0), PointToPoint(ends[::-1], 1.0)

    order = nearest_order([at(2.0), at(-0.1), at(1.0), at(0.2)], approaches, np.zeros(1))
    assert order == [1, 3, 2, 0]
