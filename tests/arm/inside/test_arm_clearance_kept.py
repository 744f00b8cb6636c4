"""How far pairs are kept apart: neighbours by what they have in clear poses, all others by the margin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clearance_examples import planar_spec

from etude_arm.clearance.clearance_limit import FLOOR, Clearance, neighbours
from etude_arm.clearance.robot_clearance import clearance_of, one_turn, reachable
from etude_arm.clearance.surroundings import Collision, Floor, Search, Surroundings

# the hand's corners pass the upper arm at 5 mm where it leans over, and at 65 mm upright
NECK = """<mujoco model="planar"><compiler angle="radian"/><worldbody>
<geom name="base#0" type="box" size=".1 .1 .1" pos="0 0 -.3"/>
<body name="upper"><joint name="j1" axis="0 1 0" range="-1 1"/>
<geom name="upper#0" type="capsule" size=".04" fromto="0 0 0 0 0 .3"/>
<body name="wrist" pos="0 0 .385"><joint name="j2" axis="0 0 1" range="-2 2"/>
<inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
<body name="hand"><joint name="j3" axis="0 1 0" range="-1.2 1.2"/>
<geom name="hand#0" type="box" size=".06 .02 .02" pos="0 0 .03"/>
</body></body></body></worldbody></mujoco>"""


def neck(folder: Path, home: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Clearance:
    around = Surroundings(search=Search(home), floor=Floor(-0.2))
    found = clearance_of(planar_spec(folder, around, NECK), {})
    assert found is not None
    return found


def kept_of(limit: Clearance) -> dict[str, float]:
    return {" and ".join(row): float(m) for row, m in zip(limit.rows, limit.row_margins, strict=True)}


def test_neighbours_keep_what_clear_poses_leave_them_whatever_home_is(tmp_path: Path) -> None:
    upright, leaning = neck(tmp_path), neck(tmp_path, (0.0, 0.0, 0.9))
    assert kept_of(upright) == kept_of(leaning)
    assert 0.9 * FLOOR <= kept_of(upright)["hand and upper"] < 0.005
    poses = upright.gaps.skeleton.random_poses(np.random.default_rng(5), 2000)
    pair = upright.rows.index(("hand", "upper"))
    apart = upright._by_row(upright.gaps.of_poses(poses))
    apart = apart[np.all(apart > 0.0, axis=1), pair]
    assert np.mean(apart >= upright.row_margins[pair]) > 0.93
    assert np.mean(apart >= upright.margin) < 0.9, "the margin alone would forbid more"


def test_all_others_keep_the_margin(tmp_path: Path) -> None:
    found = kept_of(neck(tmp_path))
    assert {name: found[name] for name in found if "floor" in name or "base" in name} == {
        "hand and base": 0.01,
        "upper and floor": 0.01,
        "hand and floor": 0.01,
    }
    limit = neck(tmp_path)
    own = dict(zip((gap.text for gap in limit.gaps.list), neighbours(limit.gaps).tolist(), strict=True))
    assert own == {
        "world and hand": False,
        "upper and hand": True,
        "upper and floor": False,
        "hand and floor": False,
    }


def test_a_margin_below_the_floor_of_neighbours_stays(tmp_path: Path) -> None:
    around = Surroundings(collision=Collision(margin=0.001), search=Search((0.0, 0.0, 0.0)))
    found = clearance_of(planar_spec(tmp_path, around, NECK), {})
    assert found is not None
    assert set(found.row_margins.tolist()) == {0.001}


def test_poses_of_the_pool_are_clear_and_see_home(tmp_path: Path) -> None:
    limit = neck(tmp_path)
    found = reachable(limit)
    np.testing.assert_array_equal(found.poses[0], limit.home)
    assert len(found.poses) > 100
    part = np.linspace(0.0, 1.0, 41)[:, None, None]
    line = (limit.home + part * (found.poses - limit.home)).reshape(-1, 3)
    assert np.all(limit._by_row(limit.gaps.of_poses(line)) >= limit.row_margins)
    again = reachable(neck(tmp_path))
    np.testing.assert_array_equal(found.poses, again.poses)


def test_ranges_are_cut_to_a_turn_about_home_inside_the_limits() -> None:
    lower, upper = np.array([-6.0, -1.0, -6.0]), np.array([6.0, 1.0, 6.0])
    low, high = one_turn(lower, upper, np.array([0.5, 0.9, 5.0]), np.array([False, False, True]))
    assert low.tolist() == pytest.approx([0.5 - np.pi, -1.0, -6.0])
    assert high.tolist() == pytest.approx([0.5 + np.pi, 1.0, 6.0])
    low, high = one_turn(lower, upper, np.array([5.0, 0.0, 0.0]), np.zeros(3, dtype=np.bool_))
    assert (low[0], high[0]) == pytest.approx((6.0 - 2.0 * np.pi, 6.0))
