"""URDFs that are none: refused with the place and with what mends it, never loaded as something else."""

from __future__ import annotations

from pathlib import Path

import pytest
from loading_examples import BOX, LIMIT, MESH, robot, write

from etude.errors import UsageError
from etude_arm.description import describe
from etude_arm.loading.load import load
from etude_arm.model_file import spec_from_model

ELBOW = '<joint name="elbow" type="revolute">'
MIMIC = '<mimic joint="finger_left" '


def changed(folder: Path, old: str, new: str) -> Path:
    path, text = write(folder), robot()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (ELBOW, ELBOW.replace("revolute", "Revolute"), "joint 'elbow' has the type 'Revolute'.*continuous"),
        (ELBOW, '<joint name="elbow">', "joint 'elbow' has no type"),
        (MIMIC, '<mimic joint="gone" ', "'finger_right' follows joint 'gone', which is not there"),
        (MIMIC, '<mimic joint="finger_right" ', "'finger_right' follows itself"),
        ('xyz="0.2 1 -0.4"', 'xyz="0 0 0"', "the axis is 0 0 0.*joint 'shoulder'"),
        ('xyz="0.2 1 -0.4"', 'xyz="0.2 1"', "'0.2 1' should be three numbers.*joint 'shoulder'"),
        ('rpy="0.3 -0.2 0.9"', 'rpy="0.3"', "'0.3' should be three numbers.*joint 'shoulder'"),
        ('ixx="0.011"', 'ixx="nan"', "NaN is not a number.*link 'upper'"),
        ('ixx="0.011"', 'ixx="inf"', "an inertia is infinite.*link 'upper'"),
        ('value="3.0"', 'value="inf"', "a mass cannot be inf kg"),
        ('xyz="0.1 0 0.02"', 'xyz="0.1 0"', "should be three numbers.*link 'upper'"),
        ('<sphere radius="0.07"/>', '<sphere radius="0"/>', "a sphere cannot have radius='0'.*'fore'"),
        ('<sphere radius="0.07"/>', "<sphere/>", "a sphere cannot have radius=None.*'fore'"),
        ('<sphere radius="0.07"/>', '<cone radius="1"/>', "a shape <cone> is not known.*'fore'"),
        (BOX, BOX, ""),
        ('value="3.0"', 'value="${heavy}"', "this is not a number.*Expand the file with xacro"),
        (MESH, MESH.replace("1 1 2", "1 1 2 1"), "a mesh cannot be scaled by '1 1 2 1'"),
        (MESH, MESH.replace("1 1 2", "1 0 2"), "a mesh cannot be scaled by '1 0 2'.*'upper'"),
        (MESH, MESH.replace("1 1 2", "1 2"), "a mesh cannot be scaled by '1 2'.*'upper'"),
    ],
)
def test_what_is_no_joint_mass_or_shape_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = changed(tmp_path, old, new)
    if not words:
        load(path)
        return
    with pytest.raises(UsageError, match=words) as refused:
        load(path)
    assert refused.value.next_step


@pytest.mark.parametrize(
    ("limit", "words", "mend"),
    [
        ('lower="-1.5" upper="2" velocity="-3" effort="40"', "'velocity' of joint 'elbow'.*-3", "velocity"),
        ('lower="-1.5" upper="2" velocity="inf" effort="40"', "'velocity' of joint 'elbow'.*inf", "velocity"),
        ('lower="-1.5" upper="2" velocity="3" effort="-4"', "'command' of joint 'elbow'.*-4", "command"),
        ('lower="-1.5" upper="2" velocity="3" effort="1e30"', "'command' of joint 'elbow'.*1e.30", "command"),
        ('lower="-1.5" upper="2" velocity="1000" effort="4"', "1000 of joint 'elbow' looks", "velocity"),
        ('lower="-1.5" upper="2" effort="4"', "velocity of elbow", "velocity"),
        ('lower="-90" upper="90" velocity="3" effort="4"', "90 of joint 'elbow' looks like degrees", "range"),
        ('velocity="3" effort="4"', "lower of elbow; upper of elbow", "range"),
    ],
)
def test_the_option_that_is_named_mends_a_limit(tmp_path: Path, limit: str, words: str, mend: str) -> None:
    """Literally: its example, or a number in the place of dots, starts the robot."""
    path = changed(tmp_path, f"{ELBOW}", f"{ELBOW}<limit {limit}/>")
    path.write_text(path.read_text().replace(f"{LIMIT}<safety", "<safety", 1))
    path.write_text(
        path.read_text().replace('<safety_controller soft_lower_limit="-1" soft_upper_limit="3"/>', "")
    )
    with pytest.raises(UsageError, match=words) as refused:
        spec_from_model(path)
    assert f"--{mend} elbow=" in refused.value.next_step
    given = {
        "range": {"lower": -1.0, "upper": 1.0},
        "velocity": {"velocity": 2.0},
        "command": {"command": 9.0},
    }
    spec = spec_from_model(path, given={"elbow": given[mend]}).spec
    assert spec.names == ("shoulder", "elbow", "wrist")


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ('lower="0" upper="800" velocity="3" effort="40"', "position limit 800 .*mm, not m"),
        ('lower="0" upper="0.8" velocity="300" effort="40"', "velocity limit 300 .*mm/s, not m/s"),
    ],
)
def test_a_slide_in_millimetres_is_suspected(tmp_path: Path, limit: str, words: str) -> None:
    path = changed(tmp_path, 'name="shoulder" type="revolute"', 'name="shoulder" type="prismatic"')
    path.write_text(path.read_text().replace(LIMIT, f"<limit {limit}/>", 1))
    with pytest.raises(UsageError, match=words):
        spec_from_model(path)


def test_soft_limits_beside_the_hard_ones_are_refused(tmp_path: Path) -> None:
    path = changed(
        tmp_path, 'soft_lower_limit="-1" soft_upper_limit="3"', 'soft_lower_limit="4" soft_upper_limit="5"'
    )
    with pytest.raises(UsageError, match=r"soft limits 4\.\.5 do not overlap the range -1\.5\.\.2"):
        describe(path)


@pytest.mark.parametrize(
    ("joint", "drive", "command"),
    [
        ("", '<motor joint="one" gear="2" ctrlrange="-3 9"/>', 6.0),
        ("", '<position joint="one" forcerange="-30 9"/>', 9.0),
        ("", '<motor joint="one" ctrlrange="0 9"/>', 9.0),
        ('actuatorfrcrange="-4 40"', '<motor joint="one" ctrlrange="-50 50"/>', 4.0),
    ],
)
def test_of_a_force_range_the_smaller_side_counts(
    tmp_path: Path, joint: str, drive: str, command: float
) -> None:
    path = tmp_path / "arm.xml"
    body = f'<body><joint name="one" range="-90 90" {joint}/><geom size=".1" mass="1"/></body>'
    path.write_text(f"<mujoco><worldbody>{body}</worldbody><actuator>{drive}</actuator></mujoco>")
    spec = spec_from_model(path, given={"*": {"velocity": 1.0}}).spec
    assert spec.command.tolist() == [command]


def test_a_range_of_nothing_is_asked_for(tmp_path: Path) -> None:
    path = changed(tmp_path, LIMIT, '<limit lower="0" upper="0" velocity="3" effort="40"/>')
    with pytest.raises(UsageError, match=r"lower of shoulder; upper of shoulder.*--range shoulder=-3:3"):
        spec_from_model(path)
    spec = spec_from_model(path, given={"shoulder": {"lower": -1.0, "upper": 1.0}}).spec
    assert (spec.lower[0], spec.upper[0]) == (-1.0, 1.0)
    assert load(path).model().joint("shoulder").name == "shoulder"


def test_one_option_mends_all_limits_that_are_placeholders(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('velocity="3"', 'velocity="1000"'))
    with pytest.raises(
        UsageError, match=r"1000 of joint 'shoulder' \(and of 2 more\).*placeholder"
    ) as refused:
        spec_from_model(path)
    assert "--velocity '*=limit'," in refused.value.next_step
    path.write_text(path.read_text().replace('velocity="1000"', 'velocity="3"', 1))
    with pytest.raises(UsageError, match=r"and of 1 more.*--velocity elbow=limit wrist=limit,"):
        spec_from_model(path)
    assert spec_from_model(path, given={"*": {"velocity": 2.0}}).spec.velocity.tolist() == [2.0] * 3
