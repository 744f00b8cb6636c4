"""How far joints carry shapes: never farther than the reach says, on chains of any kind."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from clearance_examples import random_chain
from hypothesis import example, given, settings
from hypothesis import strategies as st

from etude_arm.clearance.clearance_limit import excess
from etude_arm.clearance.distances import CUTOFF, Gaps
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.skeleton import Skeleton
from etude_arm.clearance.surroundings import Column, Floor, Surroundings, Wall
from etude_arm.clearance.tracking_distance import all_keep, lost

CHAINS = given(st.integers(0, 10**6), st.integers(2, 7))
AROUND = Surroundings(
    floor=Floor(-0.4), wall=(Wall("fence", (0.5, 0.0, 0.0), (-1.0, 0.3, 0.0)),), column=Column(0.8)
)


def chain(seed: int, joints: int, around: Surroundings = AROUND) -> Gaps:
    limit = np.random.default_rng(seed + 1).uniform(0.3, 2.8, joints)
    return gaps_of(random_chain(np.random.default_rng(seed), joints), -limit, 0.7 * limit, around)


def reached(skeleton: Skeleton, poses: np.ndarray) -> np.ndarray:
    """(G, k) the farthest that any point of each shape is from each joint's axis at these poses."""
    data, found = mujoco.MjData(skeleton.model), np.zeros((len(skeleton.shapes), len(skeleton.joints)))
    for pose in poses:
        data.qpos[skeleton.addresses] = pose
        mujoco.mj_kinematics(skeleton.model, data)
        for g, shape in enumerate(skeleton.shapes):
            x = shape.points @ data.geom_xmat[shape.geom].reshape(3, 3).T + data.geom_xpos[shape.geom]
            for j in np.flatnonzero(skeleton.moves[shape.part]):
                step = x - data.xanchor[skeleton.joints[j]]
                across = np.cross(step, data.xaxis[skeleton.joints[j]])
                found[g, j] = max(found[g, j], np.linalg.norm(across, axis=1).max() + shape.radius)
    return found


@settings(max_examples=10)
@CHAINS
def test_no_point_is_ever_farther_from_an_axis_than_the_reach(seed: int, joints: int) -> None:
    skeleton = chain(seed, joints).skeleton
    poses = skeleton.random_poses(np.random.default_rng(seed), 25)
    hinged = ~skeleton.slides
    seen = reached(skeleton, poses)[:, hinged]
    assert np.all(skeleton.reaches[:, hinged] >= seen - 1e-9)
    assert np.all((skeleton.reaches > 0.0) <= skeleton.moves[[shape.part for shape in skeleton.shapes]])


def test_the_reach_of_a_shapes_own_joint_is_exact() -> None:
    skeleton = chain(3, 5).skeleton
    seen = reached(skeleton, skeleton.random_poses(np.random.default_rng(0), 3))
    for g, shape in enumerate(skeleton.shapes):
        if shape.part and not skeleton.slides[shape.part - 1]:
            assert skeleton.reaches[g, shape.part - 1] == pytest.approx(seen[g, shape.part - 1], rel=1e-12)


@settings(max_examples=10)
@CHAINS
def test_no_distance_changes_faster_than_its_reach(seed: int, joints: int) -> None:
    gaps, rng = chain(seed, joints), np.random.default_rng(seed)
    first = gaps.skeleton.random_poses(rng, 200)
    size = rng.choice([0.01, 0.1, 0.5], (200, 1))
    second = np.clip(
        first + size * rng.standard_normal(first.shape), gaps.skeleton.lower, gaps.skeleton.upper
    )
    one, other = gaps.of_poses(first), gaps.of_poses(second)
    allowed = np.abs(second - first) @ gaps.reach.T
    apart = (one > 0.0) & (other > 0.0)  # how deep shapes overlap is only roughly known
    assert np.all((np.abs(one - other) <= allowed + 2e-5)[apart])
    assert (np.abs(one - other) / np.maximum(allowed, 1e-9))[apart & (one < CUTOFF)].max(initial=0.0) > 0.02


@settings(max_examples=6)
@CHAINS
@example(seed=56, joints=3)  # MuJoCo 4.0.0 gives 15 mm for a capsule whose middle is inside a box
def test_tracking_takes_no_more_than_is_said(seed: int, joints: int) -> None:
    gaps, rng = chain(seed, joints), np.random.default_rng(seed)
    poses, error = gaps.skeleton.random_poses(rng, 25), rng.uniform(0.0, 0.03, joints)
    distances = gaps.of_poses(poses)
    taken = lost(gaps, poses, distances, error, np.full(len(gaps.list), 0.05))
    assert np.all(taken <= (gaps.reach @ error)[None] + 1e-12)
    apart = distances - excess(gaps, poses) > 0.0  # as in the proof: what no slab confirms is no distance
    assert apart.mean() > 0.5
    for _ in range(20):
        signs = np.where(rng.random(poses.shape) < 0.5, rng.choice([-1.0, 1.0], poses.shape), 1.0)
        signs = signs * np.where(rng.random(poses.shape) < 0.3, rng.random(poses.shape), 1.0)
        found = gaps.of_poses(poses + signs * error)
        assert np.all((found >= distances - taken - 2e-5)[apart])


@settings(max_examples=6)
@CHAINS
def test_the_quick_word_of_searches_is_that_of_all_distances(seed: int, joints: int) -> None:
    """At the very limit too: a thousandth of a millimetre more than a gap keeps is not kept."""
    gaps, rng = chain(seed, joints), np.random.default_rng(seed)
    poses = gaps.skeleton.random_poses(rng, 300)
    distances, error = gaps.of_poses(poses), rng.uniform(0.0, 0.03, joints)
    wanted, share = rng.uniform(-0.02, 0.04, len(gaps.list)), rng.uniform(0.0, 1.0, len(gaps.list))
    found = distances - share * lost(gaps, poses, distances, error, wanted)
    for some in np.array_split(rng.permutation(len(poses)), 60):
        least, given = found[some].min(axis=0), (distances[some], error, share, wanted)
        tight = rng.choice(len(gaps.list))
        for more in (-1e-6, 1e-6):
            sought = np.minimum(wanted + 0.002, least - 1e-6)
            sought[tight] = min(wanted[tight] + 0.003, least[tight] + more)
            expected = bool(np.all(found[some] >= sought))
            assert all_keep(gaps, poses[some], *given, sought) == expected


def test_at_the_pose_tracking_takes_much_less_than_at_the_worst_one() -> None:
    gaps = chain(5, 6)
    poses = gaps.skeleton.random_poses(np.random.default_rng(0), 200)
    error, distances = np.full(6, 0.01), gaps.of_poses(poses)
    taken = lost(gaps, poses, distances, error, np.full(len(gaps.list), 1.0))
    apart = distances > 0.0
    assert np.median((taken / np.maximum(gaps.reach @ error, 1e-9))[apart & (distances < CUTOFF)]) < 0.5


@settings(max_examples=6)
@CHAINS
def test_no_distance_is_larger_than_the_gap_between_two_parallel_planes(seed: int, joints: int) -> None:
    """What lies on both sides of a slab is as far apart as the slab is thick: MuJoCo's word is not needed."""
    gaps = chain(seed, joints, Surroundings(floor=Floor(-0.4)))
    poses = gaps.skeleton.random_poses(np.random.default_rng(seed), 25)
    distances = gaps.of_poses(poses)
    apart = distances > 1e-3
    assert (excess(gaps, poses)[apart] > 0.0).mean() < 0.02


def test_what_a_solver_gets_wrong_is_not_confirmed() -> None:
    """A capsule whose middle is inside a box, and that MuJoCo 4.0.0 gives 9 mm."""
    gaps = chain(17081, 5, Surroundings(floor=Floor(-0.4)))
    poses = gaps.skeleton.random_poses(np.random.default_rng(17081), 25)
    found = excess(gaps, poses)
    confirmed = np.minimum(gaps.of_poses(poses), CUTOFF) - found
    one, other = gaps.skeleton.shapes[gaps.list[13].one], gaps.skeleton.shapes[gaps.list[13].other]
    assert (one.name, other.name) == ("b1#0", "b5#1")
    assert confirmed[2, 13] < 0.0
