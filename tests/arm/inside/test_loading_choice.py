"""Which joints are the arm: named, or the only one; what is held, and what is refused with its reason."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from etude.errors import UsageError
from etude_arm.loading.joint_choice import Choice, Moving, choose


def chain(*names: str, before: str = "", **values: float) -> list[Moving]:
    """Hinges from -1 to 1, each on the one before."""
    carriers = (before, *names)
    return [
        Moving(name, carriers[i], **{"lower": -1.0, "upper": 1.0, **values}) for i, name in enumerate(names)
    ]


def chosen(found: list[Moving], wanted: list[str] | None = None, **held: float) -> Choice:
    return choose(found, wanted, held, "arm.urdf")


ARM = chain("a1", "a2", "a3")
ENDLESS = {"endless": True, "lower": -math.inf, "upper": math.inf}


def test_the_only_chain_is_the_arm() -> None:
    assert chosen(ARM).joints == ("a1", "a2", "a3")
    assert chosen(ARM).notes == ()


@pytest.mark.parametrize(
    "more",
    [
        chain("gripper_joint", before="a3"),
        chain("left_finger", before="a3"),
        chain("Jaw", before="a3"),
        [Moving("slider", "a3", 0.0, 0.04, slides=True)],
        chain("one", before="a3") + chain("two", before="a3"),
        chain("finger_1", "tip_1", before="a3") + chain("thumb", before="a3"),
        [*chain("drive", before="a3"), Moving("follower", "a3", -1.0, 1.0, leader="drive")],
        chain("wheel", endless=True, lower=-math.inf, upper=math.inf) + chain("head_pan"),
    ],
    ids=[
        "gripper",
        "finger",
        "jaw",
        "short slide",
        "two singles",
        "hand",
        "with a follower",
        "wheel and head",
    ],
)
def test_hands_wheels_and_heads_are_held_and_named(more: list[Moving]) -> None:
    found = chosen([*ARM, *more])
    assert found.joints == ("a1", "a2", "a3")
    assert set(found.held) == {joint.name for joint in more}
    for joint in more:
        named = any(
            "These joints are fixed" in note and f"'{joint.name}' at 0" in note for note in found.notes
        )
        assert named == (not joint.leader)


def test_a_long_slide_at_the_end_is_an_axis_and_a_finger_alone_is_an_arm() -> None:
    assert chosen([*ARM, Moving("lift", "a3", 0.0, 0.4, slides=True)]).joints[-1] == "lift"
    assert chosen(chain("finger_1", "finger_2")).joints == ("finger_1", "finger_2")
    assert chosen(chain("pendulum")).joints == ("pendulum",)


def test_several_limbs_are_refused_with_their_names() -> None:
    legs = [joint for leg in "ABCD" for joint in chain(f"{leg}1", f"{leg}2", f"{leg}3")]
    with pytest.raises(
        UsageError, match=r"several limbs begin at the base: A1 and 2 more, B1.*bolted.*--joints 'A\*'"
    ):
        chosen(legs)
    torso = [*chain("torso"), *chain("l1", "l2", before="torso"), *chain("r1", "r2", before="torso")]
    with pytest.raises(
        UsageError, match=r"several limbs begin after joint 'torso': l1 and 1 more, r1.*--joints 'l\*'"
    ):
        chosen(torso)
    mixed = [
        *chain("base_yaw"),
        *chain("l1", "elbow", before="base_yaw"),
        *chain("l9", "r2", before="base_yaw"),
    ]
    with pytest.raises(UsageError, match="--joints l1 elbow;"):
        chosen(mixed)
    assert chosen(torso, ["torso", "r?"]).joints == ("torso", "r1", "r2")


@pytest.mark.parametrize("found", [chain("rotor", lower=-math.inf, upper=math.inf), chain("x") + chain("y")])
def test_no_arm_is_said(found: list[Moving]) -> None:
    with pytest.raises(UsageError, match="no arm: no chain of two or more joints"):
        chosen(found)


def test_a_file_in_which_nothing_moves_is_no_arm() -> None:
    with pytest.raises(UsageError, match=r"nothing in the file moves.*an object"):
        chosen([])


def test_a_hand_is_no_arm_but_its_longest_finger_can_be_chosen_as_the_message_says() -> None:
    follower = Moving("index_q2", "index_q1", 0.0, 1.0, leader="index_q1")
    hand = [*chain("index_q1"), follower, *chain("thumb_q1", "thumb_q2")]
    with pytest.raises(UsageError, match=r"without fingers \(by name\).*--joints 'thumb_q\*'"):
        chosen(hand)
    assert chosen(hand, ["thumb_q*"]).joints == ("thumb_q1", "thumb_q2")


def test_names_keep_their_order_and_patterns_go_outwards() -> None:
    assert chosen(ARM, ["a3", "a1"]).joints == ("a3", "a1")
    assert chosen(ARM, ["a3", "a*"]).joints == ("a3", "a1", "a2")
    assert chosen(ARM, ["a3", "a1"]).notes == ()  # who names joints knows which are left
    for wanted in (["knee"], ["b*"]):
        with pytest.raises(UsageError, match=r"no moving joint.*moving joints are a1, a2, a3"):
            chosen(ARM, wanted)
    with pytest.raises(UsageError, match="no joint is named"):
        chosen(ARM, [])
    with pytest.raises(UsageError, match=r"'f' follows 'a3'.*Name 'a3'"):
        chosen([*ARM, Moving("f", "a3", leader="a3")], ["f"])


def test_held_joints_stand_at_zero_or_next_to_it_or_where_they_are_told() -> None:
    found = [*ARM, Moving("up", "a1", 0.2, 0.5), Moving("down", "a1", -2.0, -1.0), Moving("free", "a1")]
    assert chosen(found, ["a?"]).held == {"up": 0.2, "down": -1.0, "free": 0.0}
    assert chosen(found, ["a?"], up=0.4, free=9.0).held == {"up": 0.4, "down": -1.0, "free": 9.0}
    with pytest.raises(UsageError, match=r"'up' cannot be fixed at 0.6: its range is 0.2 to 0.5"):
        chosen(found, ["a?"], up=0.6)
    with pytest.raises(UsageError, match="'a1' moves, so it cannot be fixed"):
        chosen(found, ["a?"], a1=0.0)
    with pytest.raises(UsageError, match="no moving joint knee"):
        chosen(found, ["a?"], knee=0.0)
    assert any("up at 0.2" in sentence for sentence in chosen(found, ["a?"]).unverified)


def test_followers_go_with_their_leader_and_one_of_an_axis_is_not_looked_at() -> None:
    finger = Moving("finger", "a3", 0.0, 0.04, slides=True)
    other = Moving("other", "a3", 0.0, 0.04, slides=True, leader="finger", factor=-2.0, offset=0.01)
    found = chosen([*ARM, finger, other], ["a?"], finger=0.03)
    assert found.held == {"finger": 0.03, "other": pytest.approx(-0.05)}
    assert not any("follows" in sentence for sentence in found.unverified)
    parallel = Moving("bar", "a1", leader="a2", factor=-1.0, offset=0.3)
    found = chosen([*ARM, parallel])
    assert found.held == {"bar": 0.3}
    assert any("'bar' follows 'a2'" in sentence for sentence in found.unverified)


def test_a_follower_of_the_arm_is_to_be_confirmed_for_it_stands_still() -> None:
    found = [*chain("a1", "a2"), Moving("rod", "a2", -1.0, 1.0, leader="a2", factor=-1.0)]
    for choice in (chosen(found), chosen(found, ["a1", "a2"])):
        assert choice.joints == ("a1", "a2")
        (note,) = choice.notes
        assert "'rod' follows 'a2' (<mimic>), but is fixed here: clearances and torques" in note
    assert chosen(found, ["a1"]).notes == ()  # what it follows stands still as well


def test_the_limb_that_is_proposed_ends_before_its_finger() -> None:
    close = Moving("r_close", "r3", 0.0, 0.04, slides=True)
    found = [*chain("r1", "r2", "r3"), close, *chain("puck_x", "puck_y")]
    with pytest.raises(UsageError, match=r"--joints r1 r2 r3\. Walking"):
        chosen(found)


def test_the_limb_that_is_proposed_is_a_leg_only_where_all_are() -> None:
    legs = [*chain("left_hip", "left_knee", "left_ankle"), *chain("right_hip", "right_knee", "right_ankle")]
    with pytest.raises(UsageError, match="--joints torso shoulder"):
        chosen([*legs, *chain("torso", "shoulder")])
    with pytest.raises(UsageError, match=r"--joints 'left_\*'"):
        chosen(legs)


def test_fingers_without_a_name_for_it_end_the_arm_that_an_example_chooses() -> None:
    hand = [joint for k in "123" for joint in chain(f"j{k}0", f"j{k}1", before="a3")]
    with pytest.raises(UsageError, match=r"after joint 'a3'.*If they are a hand.*--joints 'a\*'; the others"):
        chosen([*ARM, *hand])
    assert chosen([*ARM, *hand], ["a*"]).joints == ("a1", "a2", "a3")
    twice = [*chain("l1", "l2", "l3"), *chain("f1", "f2", before="l3"), *chain("g1", before="l3")]
    with pytest.raises(UsageError, match=r"--joints 'l\*'"):
        chosen([*chain("r1", "r2"), *twice])
    with pytest.raises(UsageError, match=r"--joints wheel_left\."):
        chosen(chain("wheel_left", **ENDLESS) + chain("wheel_right", **ENDLESS))


def test_a_last_joint_that_moves_a_gripper_by_name_is_asked_about() -> None:
    jaw = replace(chain("a4", before="a3")[0], carries="gripper")
    (said,) = chosen([*ARM, jaw]).notes
    assert said == "Joint 'a4' moves 'gripper': if that is a finger, exclude it with --joints a1 a2 a3."
    carrying = chosen([*ARM, jaw, *chain("finger", before="a4")]).notes
    assert not any("moves 'gripper'" in note for note in carrying)
    assert chosen([*ARM, replace(jaw, carries="flange")]).notes == ()
    assert chosen([*ARM, jaw], ["a*"]).notes == ()
