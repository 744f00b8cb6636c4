"""Which pairs are looked at, and what is completed where a robot file says nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clearance_examples import NAMES, PLANAR, REACH, planar

from etude.errors import UsageError
from etude_arm.clearance.defaults import ClearanceDefaults, disabled, settled
from etude_arm.clearance.surroundings import Box, Collision, Floor, Room, Search, Surroundings
from etude_arm.loading.loaded_model import Loaded

LIMIT = np.full(3, REACH)
FLOOR = Surroundings(floor=Floor(0.0))


def complete(around: Surroundings = FLOOR, xml: str = PLANAR, **given: object) -> ClearanceDefaults:
    return settled(Loaded(xml, {}, NAMES), -LIMIT, LIMIT, around, **given)  # type: ignore[arg-type]


def names(found: ClearanceDefaults) -> set[str]:
    return {gap.text for gap in found.gaps.list}


def test_neighbours_and_the_base_are_not_paired() -> None:
    found = planar(Surroundings(floor=Floor(0.0), room=Room((-2, -2, -2), (2, 2, 2))))
    links = {"upper", "fore", "hand"}
    with_things = {f"{link} and {thing}" for link in links for thing in ("floor", "room")}
    own = {"base and fore", "base and hand", "upper and hand"}
    assert {gap.text for gap in found.list} == own | with_things
    assert {gap.row for gap in found.sensed} == {("fore", "base"), ("hand", "base"), ("hand", "upper")}


def test_what_the_robot_file_ignores_and_an_mjcf_excludes() -> None:
    ignoring = Surroundings(
        collision=Collision(ignore=(("hand", "upper"), ("fore", "floor"))), floor=Floor(0.0)
    )
    found = planar(ignoring)
    assert not {"upper and hand", "fore and floor"} & {gap.text for gap in found.list}
    excluded = Loaded(PLANAR, {}, NAMES, excluded=(("base#0", "hand#0"),))
    assert "base and hand" not in names(settled(excluded, -LIMIT, LIMIT, FLOOR))
    with pytest.raises(UsageError, match="no link or obstacle is called claw"):
        planar(Surroundings(collision=Collision(ignore=(("claw", "upper"),))))


def test_the_pose_found_is_clear_and_so_is_nearly_all_of_the_box() -> None:
    found = complete()
    search = found.around.search
    assert search is not None
    assert not found.confirm
    home, low, high = (np.array(side) for side in (search.home, search.lower, search.upper))
    assert found.gaps.of_poses(home[None]).min() > 0.05
    assert np.all((low >= -LIMIT) & (low < home) & (home < high) & (high <= LIMIT))
    poses = np.random.default_rng(5).uniform(low, high, (2000, 3))
    assert (found.gaps.of_poses(poses).min(axis=1) > 0.01).mean() > 0.98
    wider = np.random.default_rng(5).uniform(-LIMIT, LIMIT, (2000, 3))
    assert (found.gaps.of_poses(wider).min(axis=1) > 0.01).mean() < 0.65
    assert complete().around == found.around
    again = complete(found.around)
    assert again.around == found.around


def test_a_home_that_is_given_stays_and_has_a_box() -> None:
    home = (0.2, 0.3, -0.4)
    search = complete(replace(FLOOR, search=Search(home))).around.search
    assert search is not None
    assert search.home == home
    assert len(search.lower) == 3


def test_shapes_that_always_overlap_are_left_out_and_named() -> None:
    fat = PLANAR.replace('type="box" size=".1 .1 .1"', 'type="box" size=".6 .6 .6"')  # holds the elbow
    found = complete(Surroundings(), fat)
    assert any("base and fore" in sentence and "not verified" in sentence for sentence in found.confirm)
    assert ("base", "fore") in found.around.collision.ignore
    assert "base and fore" not in names(found)


def test_far_parts_that_overlap_at_home_are_no_artefact() -> None:
    folded = Search((0.0, REACH, 0.0), (-1.0,) * 3, (1.0,) * 3)
    with pytest.raises(UsageError, match=r"at home .*hand.* overlap") as error:
        complete(replace(FLOOR, search=folded))
    assert "state another home" in error.value.next_step


@pytest.mark.parametrize(
    "around",
    [
        Surroundings(floor=Floor(0.5), search=Search((0.0, 0.0, 0.0))),
        Surroundings(box=(Box("shelf", (0.0, 0.0, 0.9), (0.3, 0.3, 0.3)),), search=Search((0.0, 0.0, 0.0))),
    ],
)
def test_a_robot_that_stands_in_something_at_home(around: Surroundings) -> None:
    with pytest.raises(UsageError, match="overlap"):
        complete(around)


def test_a_turning_foot_may_touch_the_floor() -> None:
    around = Surroundings(floor=Floor(0.27), search=Search((0.0, 0.0, 0.0)))
    turning = PLANAR.replace('<joint name="j1"/>', '<joint name="j1" axis="0 0 1"/>')
    found = complete(around, turning)
    assert found.confirm == (
        "The shapes of upper and floor overlap at home: their distance is not verified.",
    )
    with pytest.raises(
        UsageError, match="upper and floor overlap"
    ):  # a file that was complete, and was changed
        complete(replace(found.around, collision=Collision()), turning)
    with pytest.raises(UsageError, match="upper and floor overlap"):  # it tilts, and would go deeper
        complete(around)


def test_an_srdf_gives_leave_to_touch_and_no_order_not_to_look(tmp_path) -> None:
    (tmp_path / "arm.srdf").write_text(
        '<robot name="arm"><disable_collisions link1="upper" link2="hand" reason="Default"/>'
        '<disable_collisions link1="base" link2="hand" reason="Never"/></robot>'
    )
    leave = disabled(tmp_path / "arm.urdf")
    assert leave == {frozenset(("upper", "hand"))}
    assert "upper and hand" in names(complete(leave=leave))
    folded = replace(FLOOR, search=Search((0.0, REACH, 0.0)))
    wide = PLANAR.replace('size=".05 .05 .1"', 'size=".15 .15 .1"')
    with pytest.raises(UsageError, match="base and hand overlap"):
        complete(folded, wide, leave=leave)
    left_out = complete(folded, wide, leave=leave | {frozenset(("base", "hand"))})
    assert not {"upper and hand", "base and hand"} & names(left_out)
    (tmp_path / "srdf").mkdir()
    (tmp_path / "srdf" / "other.srdf").write_text("<robot")
    with pytest.raises(UsageError, match="not a readable SRDF"):
        disabled(tmp_path / "urdf" / "other.urdf")
    assert disabled(tmp_path / "none.urdf") == frozenset()


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (lambda: Collision(margin=0.0), "margin"),
        (lambda: Floor(np.inf), "height"),
        (lambda: Box("b", (0, 0, 0), (1, 0, 1)), "box 'b'"),
        (lambda: Room((0, 0, 0), (1, 0, 1)), "lower below upper"),
        (lambda: Surroundings(box=(Box("b", (0, 0, 0), (1, 1, 1)),) * 2), "share the names b"),
    ],
)
def test_impossible_surroundings(made, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        made()
