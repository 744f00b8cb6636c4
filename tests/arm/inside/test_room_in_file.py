"""What an MJCF's world holds beside the robot becomes floor, boxes and walls that a person can correct."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from etude.errors import UsageError
from etude.types import Described
from etude_arm.clearance.robot_clearance import clearance_of
from etude_arm.description import ROBOT_FILE, describe
from etude_arm.robot_file import read_robot

CELL = """<mujoco model="cell"><compiler angle="radian"/><worldbody>
 <geom name="ground" type="plane" size="0 0 .05" pos="0 0 -.7"/>
 <geom name="back" type="plane" size="2 2 .05" pos="0 1.2 0" zaxis="0 -1 0"/>
 <body name="table" pos=".8 0 -.35" euler="0 0 .3">
  <geom name="top" type="box" size=".3 .5 .02" pos="0 0 .3"/>
  <geom type="box" size=".02 .03 .15" pos=".25 .45 .1" euler="1.5707963267948966 0 0"/>
  <geom type="cylinder" size=".02 .3" pos="-.25 .45 0"/>
 </body>
 <geom name="pedestal" type="box" size=".1 .1 .35" pos="0 0 -.35"/>
 <geom name="ramp" type="box" size=".1 .1 .1" pos="-1 0 0" euler="0 .3 0"/>
 <body name="turret"><joint name="j1" axis="0 0 1" range="-3 3"/>
  <geom type="cylinder" size=".08 .05" pos="0 0 .055" mass="3"/>
  <body name="upper" pos="0 0 .15"><joint name="j2" axis="0 1 0" range="-2 2"/>
   <geom type="capsule" size=".04" fromto="0 0 .02 0 0 .3" mass="2"/>
   <body name="fore" pos="0 0 .35"><joint name="j3" axis="0 1 0" range="-2.4 2.4"/>
    <geom name="fore" type="capsule" size=".03" fromto="0 0 .05 0 0 .3" mass="1"/>
 </body></body></body></worldbody></mujoco>"""
LIMITS = {"*": {"velocity": 2.0, "command": 90.0}}


def described(folder: Path, text: str = CELL) -> tuple[Described, dict[str, Any]]:
    """The campaign's files written to the folder, and robot.toml as a dictionary."""
    (folder / "cell.xml").write_text(text)
    found = describe(folder / "cell.xml", limits=LIMITS)
    for name, data in found.files.items():
        (folder / name).write_bytes(data)
    return found, tomllib.loads(found.files[ROBOT_FILE].decode())


def said(found: Described, *words: str) -> bool:
    """Whether one sentence has all the words."""
    return any(all(word in sentence for word in words) for sentence in found.confirm)


def test_planes_and_boxes_are_taken_and_the_rest_is_named(tmp_path: Path) -> None:
    found, robot = described(tmp_path)
    assert robot["floor"] == {"height": -0.7}
    assert robot["collision"]["boxed"] == ["table#0", "table#1"]
    assert robot["box"] == [
        {"name": "top", "centre": [0.8, 0.0, -0.05], "size": [0.6, 1.0, 0.04], "turn": 0.3},
        {
            "name": "table",
            "centre": pytest.approx([0.8 + 0.25 * np.cos(0.3) - 0.45 * np.sin(0.3), 0.503781, -0.25]),
            "size": pytest.approx([0.3, 0.04, 0.06]),
            "turn": pytest.approx(0.3 - np.pi / 2, abs=1e-6),
        },
    ]
    assert robot["wall"] == [{"name": "back", "point": [0.0, 1.2, 0.0], "normal": [0.0, -1.0, 0.0]}]
    assert said(found, "plane at height -0.7 m", "correct [floor]")
    assert said(found, "box top (0.6 x 1 x 0.04 m at 0.8, 0, -0.05)", "wall back", "Correct [[box]]")
    assert said(found, "parts of the base", "pedestal, below the arm", "ramp, not an upright box", "table 2")
    assert not said(found, "left out")


TABLE = "table of robot.toml"
"""The box: a link of the file keeps the name, with what of that body is no upright box."""


def test_distances_are_those_of_the_file_and_each_thing_counts_once(tmp_path: Path) -> None:
    described(tmp_path)
    spec = read_robot(tmp_path / ROBOT_FILE)
    clearance = clearance_of(spec, {})
    assert clearance is not None
    gaps = clearance.gaps
    rows = [gap.text for gap in gaps.list if "fore" in gap.names]
    base = ["table", "world", "world"]  # the cylinder, the pedestal and the ramp
    assert sorted(rows) == sorted(
        [
            *(f"{name} and fore" for name in base),
            "turret and fore",
            *(f"fore and {n}" for n in ("top", TABLE, "back", "floor")),
        ]
    )
    whole = mujoco.MjModel.from_xml_string(CELL)
    data = mujoco.MjData(whole)
    pose = np.array([0.25, 1.2, 0.4])
    data.qpos[:] = pose
    mujoco.mj_kinematics(whole, data)
    fore = whole.geom("fore").id
    for name, other in (("top", whole.geom("top").id), (TABLE, whole.geom("top").id + 1)):
        true = mujoco.mj_geomDistance(whole, data, fore, other, 0.3, None)
        at = [gap.names for gap in gaps.list].index(("fore", name))
        assert gaps.of_poses(pose[None])[0, at] == pytest.approx(true, abs=1e-4)


def test_a_box_that_a_person_corrects_or_takes_out_counts_as_corrected(tmp_path: Path) -> None:
    described(tmp_path)
    path = tmp_path / ROBOT_FILE
    text = path.read_text()
    path.write_text(text[: text.index("\n[[box]]")] + text[text.index("\n[[wall]]") :])
    clearance = clearance_of(read_robot(path), {})
    assert clearance is not None
    assert [gap for gap in clearance.gaps.list if "top" in gap.names] == []
    assert len([gap for gap in clearance.gaps.list if "table" in gap.names]) == 2  # its cylinder, two links
    path.write_text(text.replace('boxed = ["table#0", "table#1"]', ""))  # it counts again, of the base
    again = clearance_of(read_robot(path), {})
    assert again is not None
    assert len([gap for gap in again.gaps.list if gap.names == ("table", "fore")]) == 3
    path.write_text(text.replace('"table#1"', '"desk#7"'))
    with pytest.raises(UsageError, match="no shape desk#7"):
        clearance_of(read_robot(path), {})


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ("0 0 -.3", ("plane at height -0.3 m is not used", "the base reaches 0.4 m below it")),
        ("0 0 2", ("plane at height 2 m is not used", "below it")),
    ],
)
def test_a_plane_that_cannot_be_the_floor_is_said_and_none_is_assumed(
    tmp_path: Path, at: str, words: tuple[str, ...]
) -> None:
    found, robot = described(tmp_path, CELL.replace("0 0 -.7", at))
    assert "floor" not in robot
    assert said(found, *words)


def test_the_highest_plane_that_the_arm_stands_on_is_the_floor(tmp_path: Path) -> None:
    lower = '<geom type="plane" size="0 0 1" pos="0 0 -2"/><geom type="plane" size="0 0 1" pos="0 0 -.3"/>'
    found, robot = described(tmp_path, CELL.replace("<worldbody>", f"<worldbody>{lower}"))
    assert robot["floor"] == {"height": -0.7}
    assert said(found, "-0.3 m is not used")


def test_without_a_plane_boxes_that_reach_lower_leave_no_floor_at_zero(tmp_path: Path) -> None:
    text = CELL.replace('<geom name="ground" type="plane" size="0 0 .05" pos="0 0 -.7"/>', "")
    text = text.replace('<geom name="pedestal" type="box" size=".1 .1 .35" pos="0 0 -.35"/>', "")
    text = text.replace('<geom type="cylinder" size=".02 .3" pos="-.25 .45 0"/>', "").replace(
        "-1 0 0", "-1 0 .2"
    )
    found, robot = described(tmp_path, text)
    assert "floor" not in robot
    assert said(found, "No floor is assumed", "top, table would reach below it")


def test_a_robot_file_says_itself_what_stands_around(tmp_path: Path) -> None:
    described(tmp_path)
    path = tmp_path / ROBOT_FILE
    text = path.read_text()
    head, search = text[: text.index("[collision]")], text[text.index("[search]") :]
    path.write_text(head + search)
    robot = tomllib.loads(describe(path).files[ROBOT_FILE].decode())
    assert "box" not in robot
    assert "floor" not in robot
    assert any("A plane of the model file is ignored" in sentence for sentence in robot["confirm"])


URDF = """<robot name="bench"><link name="world"/>
 <link name="table"><collision><origin xyz=".8 0 -.05"/><geometry><box size=".6 1 .04"/></geometry>
  </collision></link><joint name="stands" type="fixed"><parent link="world"/><child link="table"/></joint>
 <link name="foot"><collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
 <joint name="bolted" type="fixed"><parent link="world"/><child link="foot"/></joint>{}{}</robot>"""
PART = """<link name="{0}"><inertial><origin xyz="0 0 .15"/><mass value="1"/>
 <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
 <collision><origin xyz="0 0 .17"/><geometry><box size=".06 .06 .22"/></geometry></collision></link>
 <joint name="{0}_joint" type="revolute"><parent link="{1}"/><child link="{0}"/><origin xyz="0 0 {2}"/>
 <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="50"/></joint>"""


def test_a_table_of_a_urdf_is_part_of_the_base_and_what_that_leaves_out_is_said(tmp_path: Path) -> None:
    (tmp_path / "bench.urdf").write_text(
        URDF.format(PART.format("upper", "foot", 0.1), PART.format("fore", "upper", 0.3))
    )
    found = describe(tmp_path / "bench.urdf")
    for name, data in found.files.items():
        (tmp_path / name).write_bytes(data)
    clearance = clearance_of(read_robot(tmp_path / ROBOT_FILE), {})
    assert clearance is not None
    assert {gap.text for gap in clearance.gaps.list} >= {"table and fore", "foot and fore"}
    assert "table and upper" not in {gap.text for gap in clearance.gaps.list}
    assert "The distance of upper from what is fixed to the base: table, foot." in clearance.not_verified


def test_a_floor_that_is_added_answers_the_line_that_asks_for_it(tmp_path: Path) -> None:
    found, _ = described(tmp_path, CELL.replace("0 0 -.7", "0 0 -.3"))
    (asked,) = [line for line in found.confirm if line.endswith("add [floor] with its height.")]
    path = tmp_path / ROBOT_FILE
    assert asked in read_robot(path).confirm
    path.write_text(path.read_text().replace("[search]", "[floor]\nheight = -0.7\n[search]"))
    confirm = read_robot(path).confirm
    assert confirm == tuple(line for line in found.confirm if line != asked)


def test_what_is_only_drawn_beside_the_robot_is_no_obstacle_and_named(tmp_path: Path) -> None:
    """A mark to reach; in a file in which nothing collides it is taken, as all else is."""
    geom = '<geom type="box" size=".1 .1 .1" {}/>'
    mark = f'<body name="goal" mocap="true" pos=".4 0 .5">{geom}</body></worldbody>'
    text = CELL.replace("</worldbody>", mark.format('contype="0" conaffinity="0"'))
    found, robot = described(tmp_path, text)
    assert [box["name"] for box in robot["box"]] == ["top", "table"]
    assert said(found, "Visual geometry outside the robot is ignored: goal.")
    _, robot = described(tmp_path, CELL.replace("</worldbody>", mark.format("")))
    assert [box["name"] for box in robot["box"]] == ["top", "table", "goal"]
    nothing = '<default><geom contype="0" conaffinity="0"/></default><worldbody>'
    found, robot = described(tmp_path, text.replace("<worldbody>", nothing))
    assert [box["name"] for box in robot["box"]] == ["top", "table", "goal"]
    assert not said(found, "Visual geometry")


def test_links_that_an_mjcf_excludes_are_named_on_the_certificate(tmp_path: Path) -> None:
    """But for those that are no pair anyway: neighbours across one joint."""
    pairs = "".join(f'<exclude body1="{a}" body2="fore"/>' for a in ("turret", "upper"))
    described(tmp_path, CELL.replace("</mujoco>", f"<contact>{pairs}</contact></mujoco>"))
    clearance = clearance_of(read_robot(tmp_path / ROBOT_FILE), {})
    assert clearance is not None
    out = [sentence for sentence in clearance.not_verified if "excludes" in sentence]
    assert out == ["The distance of turret and fore, which the file excludes."]
