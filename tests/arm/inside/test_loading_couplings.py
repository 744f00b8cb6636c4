"""What an MJCF has beside a tree: loops and locks are refused; springs, stops, its own gravity are said."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm import KIND
from etude_arm.loading.load import load, load_arm
from etude_arm.loading.pack import packed

ARM = """<mujoco><option {option}/>{head}<worldbody><body name="base"><geom size=".1"/>
<body name="a" pos="0 0 .2"><joint name="one" axis="0 0 1" range="-90 90"/><geom size=".05" mass="2"/>
<body name="b" pos="0 0 .3" {body}><joint name="two" axis="0 1 0" range="-90 90"/>
<geom size=".05" pos="0 0 .1" mass="1"/>
<body name="c" pos="0 0 .3"><joint {name} axis="0 1 0" range="-90 90"/>
<geom size=".04" mass="1" pos=".1 0 0"/>
<site name="tip"/></body></body></body></body>{scene}</worldbody>{more}</mujoco>"""


def arm(folder: Path, **parts: str) -> Path:
    given = dict.fromkeys(("option", "head", "body", "scene", "more"), "") | {"name": 'name="three"'}
    path = folder / "arm.xml"
    path.write_text(ARM.format(**(given | parts)))
    return path


@pytest.mark.parametrize(
    ("equality", "words"),
    [
        ('<connect body1="c" body2="base" anchor="0 0 .1"/>', "a loop: 'c' and 'base' are connected"),
        ('<weld body1="c" body2="a"/>', "a loop: 'c' and 'a' are connected"),
        ('<weld site1="tip" site2="foot"/>', "a loop: 'c' and 'base' are connected"),
        ('<joint joint1="three" polycoef="0.3 0 0 0 0"/>', "locks joint 'three'.*--hold three=0.3"),
    ],
)
def test_an_open_chain_against_a_loop_or_a_lock_is_refused(tmp_path: Path, equality: str, words: str) -> None:
    path = arm(tmp_path, more=f"<equality>{equality}</equality>")
    path.write_text(path.read_text().replace('<geom size=".1"/>', '<geom size=".1"/><site name="foot"/>', 1))
    with pytest.raises(UsageError, match=words):
        load(path)


@pytest.mark.parametrize(
    ("equality", "joints"),
    [
        ('<joint joint1="three" polycoef="0.3 0 0 0 0"/>', ["one", "two"]),  # what the message says to do
        ('<weld body1="c" body2="b"/>', ["one", "two"]),  # nothing that moves lies between
        ('<connect body1="c" body2="base" anchor="0 0 .1" active="false"/>', None),
        ('<weld body1="c" body2="hand"/>', None),  # led by the simulation
        ('<weld body1="c" body2="cube"/>', None),  # holds an object
    ],
)
def test_what_is_no_loop_of_the_arm_loads(tmp_path: Path, equality: str, joints: list[str] | None) -> None:
    scene = (
        '<body name="hand" mocap="true"/><body name="cube" pos="1 0 0"><freejoint/><geom size=".1"/></body>'
    )
    loaded = load(arm(tmp_path, scene=scene, more=f"<equality>{equality}</equality>"), joints)
    assert loaded.joints == (tuple(joints) if joints else ("one", "two", "three"))
    assert "'cube' is free and assumed to stay at its position in the file" in loaded.unverified
    assert loaded.unverified[0] == "the base is assumed to be fixed"


def test_the_joints_before_a_loop_are_proposed_and_load(tmp_path: Path) -> None:
    path = arm(tmp_path, more='<equality><connect body1="c" body2="b" anchor="0 0 .1"/></equality>')
    with pytest.raises(UsageError, match=r"--joints one two, or remove the equality"):
        load(path)
    assert load(path, ["one", "two"]).joints == ("one", "two")


def test_a_free_robot_is_no_object_beside_one(tmp_path: Path) -> None:
    path = arm(tmp_path)
    path.write_text(path.read_text().replace('<body name="base">', '<body name="base"><freejoint name="f"/>'))
    with pytest.raises(UsageError, match="base is not fixed: joint 'f' is free"):
        load(path)
    assert "although 'f' leaves it free" in load(path, ["one", "two"]).unverified[0]
    path.write_text(path.read_text().replace('<freejoint name="f"/>', "<freejoint/>"))
    with pytest.raises(UsageError, match="base is not fixed: joint 'base_joint' is free"):
        load(path)
    assert "although 'base_joint' leaves it free" in load(path, ["one", "two"]).unverified[0]


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"option": 'gravity="0 0 0"'}, "disables gravity"),
        ({"option": 'gravity="0 -9.81 0"'}, r"Gravity in the file is \(0, -9.81, 0\)"),
        ({"body": 'gravcomp="1"'}, r"compensates the weight of b \(gravcomp\)"),
        ({"name": 'name="three" stiffness="0.4"'}, r"springs of three are no part of its torques"),
        ({"name": ""}, "called after their bodies: c_joint"),
    ],
)
def test_what_changes_torques_or_names_is_to_be_confirmed(
    tmp_path: Path, parts: dict[str, str], words: str
) -> None:
    assert any(re.search(words, note) for note in load(arm(tmp_path, **parts)).notes)
    assert not any(re.search(words, note) for note in load(arm(tmp_path)).notes)


@pytest.mark.parametrize(
    ("drives", "idle"),
    [
        ("", ""),
        ('<motor joint="two"/><motor joint="three"/>', "drives one:"),
        ('<motor tendon="t"/>', "drives one:"),
        ('<motor joint="one"/><position jointinparent="two"/><motor tendon="t"/>', ""),
    ],
)
def test_joints_that_nothing_drives_are_said_where_others_are_driven(
    tmp_path: Path, drives: str, idle: str
) -> None:
    fixed = '<fixed name="t"><joint joint="two" coef="1"/><joint joint="three" coef="1"/></fixed>'
    path = arm(tmp_path, more=f"<tendon>{fixed}</tendon><actuator>{drives}</actuator>")
    said = [note for note in load(path).notes if "No actuator of the file" in note]
    assert len(said) == bool(idle)
    assert all(idle in note for note in said)


def test_springs_and_stops_of_tendons_are_said(tmp_path: Path) -> None:
    fixed = '<joint joint="two" coef="1"/><joint joint="three" coef="1"/>'
    more = f'<tendon><fixed name="t" stiffness="9" limited="true" range="-1 1">{fixed}</fixed></tendon>'
    loaded = load(arm(tmp_path, more=more))
    assert "The springs of tendons are ignored: t." in loaded.notes
    assert "the limits of tendons over several joints: t" in loaded.unverified
    assert not any(
        "tendon" in one for one in (*load(arm(tmp_path, more=more), ["one"]).unverified, *loaded.joints)
    )


def test_joints_without_names_are_the_same_in_a_campaign(tmp_path: Path) -> None:
    """From the file through its copy to the model: the third joint, at the same pose."""
    path = arm(tmp_path, name="")
    limits = {"*": {"velocity": 1.0, "command": 40.0}}
    described = KIND.chosen(path, (), {}, (), limits)
    for file, data in described.files.items():
        (tmp_path / file).write_bytes(data)
    spec = KIND.spec(tmp_path / "robot.toml")
    assert spec.names == ("one", "two", "c_joint")
    copy, given = load_arm(spec).model(), mujoco.MjModel.from_xml_path(str(path))
    one, other = mujoco.MjData(copy), mujoco.MjData(given)
    one.qpos[:] = other.qpos[:] = [0.1, 0.4, -0.7]
    mujoco.mj_forward(copy, one)
    mujoco.mj_forward(given, other)
    np.testing.assert_allclose(one.qfrc_bias, other.qfrc_bias, rtol=1e-9)
    assert np.abs(one.qfrc_bias).max() > 1.0


def test_a_file_that_attaches_another_stands_alone_in_its_copy(tmp_path: Path) -> None:
    arm(tmp_path).rename(tmp_path / "child.xml")
    path, copy = tmp_path / "whole.xml", tmp_path / "alone" / "whole.xml"
    attach = '<body name="table"><attach model="c" prefix="left_"/></body>'
    path.write_text(
        f'<mujoco><asset><model name="c" file="child.xml"/></asset><worldbody>{attach}</worldbody></mujoco>'
    )
    data, _ = packed(path)
    copy.parent.mkdir()
    copy.write_bytes(data)
    assert load(copy).joints == load(path).joints == ("left_one", "left_two", "left_three")
    np.testing.assert_allclose(load(copy).model().body_mass, load(path).model().body_mass)


def test_one_mesh_that_is_missing_takes_no_other_along(tmp_path: Path) -> None:
    cube = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "there.obj").write_text(cube)
    head = '<compiler meshdir="m"/><asset><mesh file="there.obj"/><mesh file="gone.obj"/></asset>'
    path = arm(tmp_path, head=head)
    geoms = (
        '<geom type="mesh" mesh="there" mass="1"/><geom type="mesh" mesh="gone" mass="1"/><site name="tip"/>'
    )
    path.write_text(path.read_text().replace('<site name="tip"/>', geoms))
    data, meshes = packed(path)
    assert list(meshes) == ["robot_meshes/0_there.obj"]
    copy = tmp_path / "alone"
    (copy / "robot_meshes").mkdir(parents=True)
    (copy / "arm.xml").write_bytes(data)
    (copy / "robot_meshes" / "0_there.obj").write_bytes(meshes["robot_meshes/0_there.obj"])
    loaded = load(copy / "arm.xml")
    assert len(loaded.assets) == 1
    assert any("Meshes are missing: gone.obj" in note for note in load(path).notes)


def test_a_body_that_weighs_what_its_missing_mesh_would_says_so(tmp_path: Path) -> None:
    path = arm(tmp_path, head='<asset><mesh name="m" file="gone.stl"/></asset>')
    path.write_text(
        path.read_text().replace('<geom size=".04" mass="1" pos=".1 0 0"/>', '<geom type="mesh" mesh="m"/>')
    )
    with pytest.raises(UsageError, match=r"Meshes are missing: gone\.stl"):
        load(path)
