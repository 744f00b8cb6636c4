"""What stands for shapes of many points holds them, is hardly larger, and proves no less than they keep."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clearance_examples import clearance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from etude.trajectories import FourierTrajectory
from etude_arm import ArmSpec, Axis
from etude_arm.clearance.clearance_limit import Clearance
from etude_arm.clearance.distances import CUTOFF, TOLERANCE, Gaps
from etude_arm.clearance.hull_reduction import MANY, ROOM_FACTOR, Fewer, fewer, hull_proxies, to_triangles
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.robot_clearance import clearance_of
from etude_arm.clearance.surroundings import Collision, Column, Floor, Search, Surroundings
from etude_arm.loading.hulls import hull, obj_text
from etude_arm.loading.loaded_model import Loaded

NAMES = ("j1", "j2", "j3")
LIMIT = np.full(3, 2.5)
AROUND = Surroundings(floor=Floor(-0.2), column=Column(0.9))
INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
XML = f"""<mujoco model="round"><compiler angle="radian"/>
<asset><mesh name="egg" file="egg.obj" scale="1 1.4 .8" refpos=".02 0 0"/>
<mesh name="nut" file="nut.obj"/></asset>
<default><joint axis="0 1 0" range="-2.5 2.5"/></default><worldbody>
<geom name="base#0" type="mesh" mesh="egg" pos="0 0 .1" quat="1 .2 .3 0"/>
<body name="upper" pos="0 0 .4">{INERTIAL}<joint name="j1"/><geom name="upper#0" type="mesh" mesh="nut"/>
<body name="fore" pos="0 0 .3">{INERTIAL}<joint name="j2" axis=".4 1 0"/>
<geom name="fore#0" type="mesh" mesh="egg" quat="1 0 .3 .1"/>
<body name="hand" pos="0 0 .3">{INERTIAL}<joint name="j3"/>
<geom name="hand#0" type="mesh" mesh="egg" pos="0 0 .03"/><geom name="hand#1" size=".05" pos="0 0 .14"/>
</body></body></body></worldbody></mujoco>"""


def cloud(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points (count, 3) on an ellipsoid of 5 to 10 cm, all of them corners of their hull."""
    points = rng.standard_normal((count, 3))
    return rng.uniform(0.05, 0.1, 3) * points / np.linalg.norm(points, axis=1, keepdims=True)


def loaded() -> Loaded:
    """An arm of three, whose eggs have 1,500 points and whose nut has 300."""
    rng = np.random.default_rng(2)
    assets = {f"{name}.obj": obj_text(*hull(cloud(rng, n))) for name, n in (("egg", 1500), ("nut", 300))}
    return Loaded(XML, assets, NAMES)


def both(around: Surroundings = AROUND) -> tuple[Gaps, Gaps]:
    """Of the shapes as they are, and of what stands for them."""
    robot = loaded()
    exact = gaps_of(robot, -LIMIT, LIMIT, around)
    return exact, gaps_of(robot, -LIMIT, LIMIT, around, hull_proxies(exact, np.zeros(3)))


def from_hull(point: np.ndarray, corners: np.ndarray) -> float:
    """m of a point from the hull of corners (V, 3): least squares over weights that are not negative."""
    heavy = 1e3
    weights = nnls(np.vstack([corners.T, np.full(len(corners), heavy)]), np.append(point, heavy))[0]
    return float(np.linalg.norm(corners.T @ weights / weights.sum() - point))


def test_the_points_of_a_shape_are_those_that_its_hull_needs() -> None:
    """As another program finds them, of clouds with points inside."""
    rng = np.random.default_rng(11)
    clouds = {"egg": rng.standard_normal((400, 3)), "nut": rng.uniform(-1.0, 1.0, (300, 3))}
    assets = {f"{name}.obj": obj_text(points, np.zeros((0, 3), int)) for name, points in clouds.items()}
    for shape in gaps_of(Loaded(XML, assets, NAMES), -LIMIT, LIMIT, Surroundings()).skeleton.shapes[:2]:
        points = clouds["nut" if shape.link == "upper" else "egg"]
        assert len(shape.points) == len(ConvexHull(points).vertices) < len(points)


def test_a_point_and_a_triangle() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    points = np.array(
        [[1.0, 1.0, -2.0], [4.0, 3.0, 0.0], [-3.0, -4.0, 0.0], [7.0, 0.0, 4.0], [2.0, -1.0, 1.0]]
    )
    wanted = [2.0, 12.0 / 5.0, 5.0, 5.0, np.sqrt(2.0)]
    for turned in (corners, corners[[1, 2, 0]], corners[[0, 2, 1]]):
        found = to_triangles(points, np.tile(turned, (5, 1, 1)))
        np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_a_triangle_without_area_is_as_far_as_its_longest_edge() -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    assert to_triangles(np.array([[2.0, 0.0, 3.0]]), corners)[0] == pytest.approx(3.0, rel=1e-12)
    assert to_triangles(np.array([[6.0, 0.0, 0.0]]), 0.0 * corners)[0] == pytest.approx(6.0, rel=1e-12)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**20), st.integers(30, 400), st.integers(26, 80))
def test_the_radius_is_the_largest_distance_of_a_point_from_what_was_taken(
    seed: int, count: int, most: int
) -> None:
    points = cloud(np.random.default_rng(seed), count)
    found = fewer(points, most, 0.0)
    assert len(found.points) <= max(most, 26)
    assert {tuple(x) for x in found.points} <= {tuple(x) for x in points}
    true = max(from_hull(point, found.points) for point in points)
    assert found.radius == pytest.approx(true, abs=1e-9)


def test_in_every_direction_it_reaches_as_far_and_by_no_more_than_its_radius_farther() -> None:
    rng = np.random.default_rng(5)
    points, directions = cloud(rng, 3000), rng.standard_normal((3, 5_000))
    directions /= np.linalg.norm(directions, axis=0)
    for close in (0.0, 6e-3):
        found = fewer(points, 100, close)
        beyond = (found.points @ directions).max(axis=0) + found.radius - (points @ directions).max(axis=0)
        assert beyond.min() >= 0.0
        assert beyond.max() <= found.radius * (1.0 + 1e-12)
        assert found.radius > 0.0
    assert len(found.points) < 100
    assert found.radius == pytest.approx(6e-3, rel=0.5), "few are enough for so much"


def test_a_disc_with_a_bump_that_no_axis_sees_is_no_flat_thing() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    disc = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    turn = np.linalg.qr(np.random.default_rng(8).standard_normal((3, 3)))[0]
    points = np.vstack([disc, [[0.1, 0.1, 0.01]]]) @ turn.T
    found = fewer(points, 30, 0.0)
    assert points[-1].tolist() in found.points.tolist()
    true = max(from_hull(point, found.points) for point in points)
    assert found.radius == pytest.approx(true, abs=1e-9)


def test_points_that_are_all_taken_leave_nothing_to_hold() -> None:
    assert fewer(cloud(np.random.default_rng(0), 20)).radius == pytest.approx(0.0, abs=1e-15)


def test_distances_are_less_than_of_the_shapes_themselves_and_by_little() -> None:
    exact, found = both()
    grown = np.array([shape.thickness for shape in found.skeleton.shapes])
    names = [shape.name for shape in found.skeleton.shapes]
    assert [name for name, more in zip(names, grown, strict=True) if more] == ["base#0", "fore#0", "hand#0"]
    poses = exact.skeleton.random_poses(np.random.default_rng(1), 400)
    true, less = exact.of_poses(poses), found.of_poses(poses)
    most = [grown[gap.one] + (grown[gap.other] if gap.other >= 0 else 0.0) for gap in found.list]
    apart = true > 0.0
    assert np.all((less <= true + 1e-7)[apart])
    assert np.all((less >= true - np.array(most) - 0.1 * TOLERANCE)[apart])
    assert not np.any((less > 0.0) & ~apart)
    assert np.ptp((true - less)[:, 0]) > 1e-4, "something is nearer"
    assert np.all(found.reach >= exact.reach - 1e-7)
    assert less[:, 0].max() == pytest.approx(CUTOFF, abs=1e-12), "what is far is as far as anybody looks"


def test_few_points_stay_as_they_are() -> None:
    exact, found = both()
    one, other = (gaps.skeleton.shapes[1] for gaps in (exact, found))
    assert one.name == "upper#0"
    assert len(one.points) < MANY
    np.testing.assert_array_equal(one.points, other.points)
    assert other.radius == 0.0


def test_shapes_that_are_close_at_home_stay_as_they_are() -> None:
    exact = both()[0]
    whole = hull_proxies(exact, np.zeros(3))
    assert set(whole) == {"base#0", "fore#0", "hand#0"}
    near = next(i for i, gap in enumerate(exact.list) if gap.names == ("base", "hand"))
    taken = sum(whole[f"{link}#0"].radius for link in ("base", "hand"))
    poses = exact.skeleton.random_poses(np.random.default_rng(3), 6_000)
    distances = exact.of_poses(poses)
    others = np.delete(distances, near, axis=1).min(axis=1) > 0.05
    close = others & (distances[:, near] > 0.0) & (distances[:, near] < 0.9 * ROOM_FACTOR * taken)
    assert set(hull_proxies(exact, poses[np.flatnonzero(close)[0]])) == {"fore#0"}


def test_what_is_proved_of_stand_ins_the_shapes_keep() -> None:
    exact, found = both()
    own, rng = clearance(found), np.random.default_rng(4)
    proofs = 0
    for _ in range(12):
        motion = FourierTrajectory(0.12 * rng.standard_normal((7, 3)), 1.0, 2.0 * np.pi)
        rows = own.prove(motion)
        if not all(row.proved_lower >= row.lower for row in rows):
            continue
        proofs += 1
        true = clearance(exact).of_motion(motion.motion(np.linspace(0.0, 2.0 * np.pi, 1001), 1)).min(axis=0)
        assert [row.axis for row in rows] == [" and ".join(row) for row in clearance(exact).rows]
        assert np.all(np.array([row.proved_lower for row in rows]) <= true)
    assert proofs >= 3


def test_the_certificate_names_them_and_says_by_how_much(tmp_path: Path) -> None:
    robot = loaded()
    for name, data in robot.assets.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "round.xml").write_text(XML)
    axes = tuple(Axis(name, -2.5, 2.5, 2.0, 4.0, 10.0) for name in NAMES)
    around = replace(AROUND, search=Search((0.0, 0.0, 0.0)))
    limit = clearance_of(ArmSpec("round", axes, "N m", 100.0, tmp_path / "round.xml", around=around), {})
    assert isinstance(limit, Clearance)
    (said,) = (sentence for sentence in limit.not_verified if "fewer points" in sentence)
    most = 1e3 * max(shape.thickness for shape in limit.gaps.skeleton.shapes)
    up_to = float(said.split(" mm")[0].split()[-1])
    assert most <= up_to < most + 0.1
    assert "of world, fore, hand, with" in said, "as MuJoCo calls the base"


def test_without_stand_ins_nothing_is_said() -> None:
    robot = Loaded(XML, {"egg.obj": loaded().assets["nut.obj"], "nut.obj": loaded().assets["nut.obj"]}, NAMES)
    gaps = gaps_of(robot, -LIMIT, LIMIT, replace(AROUND, collision=Collision(margin=0.02)))
    assert hull_proxies(gaps, np.zeros(3)) == {}
    assert isinstance(fewer(gaps.skeleton.shapes[0].points), Fewer)
