"""URDF and MJCF: joints by name, limits never guessed in silence."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm.loading.load import load_arm
from etude_arm.model_file import STOPPING_TIME, spec_from_model

MESH = '<visual><geometry><mesh filename="package://arm/meshes/link.stl"/></geometry></visual>'
URDF = f"""<robot name="arm">
  <link name="base"/>
  <link name="upper">{MESH}<collision><geometry><mesh filename="package://arm/c.dae"/></geometry></collision>
    <inertial><origin xyz="0.2 0 0"/><mass value="3"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore">{MESH}<inertial><origin xyz="0.1 0 0"/><mass value="1"/>
      <inertia ixx="0.001" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="frame"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" velocity="3" effort="40"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="4" effort="20"/></joint>
  <joint name="flange" type="revolute"><parent link="fore"/><child link="frame"/><axis xyz="1 0 0"/>
    <mimic joint="elbow"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>
  <transmission name="t"><type>SimpleTransmission</type></transmission>
  <gazebo reference="upper"><material>Gazebo/Grey</material></gazebo>
</robot>
"""
MJCF = """<mujoco><compiler meshdir="gone"/>
  <asset><mesh name="m" file="link.stl"/></asset>
  <worldbody><body><inertial pos=".2 0 0" mass="3" diaginertia=".01 .02 .02"/>
    <joint name="shoulder" axis="0 1 0" range="-60 90"/><geom type="mesh" mesh="m"/>
    <body pos=".4 0 0"><joint name="slide" type="slide" range="0 0.3" actuatorfrcrange="-9 9"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body></body></worldbody>
  <actuator><motor joint="shoulder" gear="50" ctrlrange="-2 2"/></actuator></mujoco>
"""


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    return path


def test_a_file_without_masses_is_read_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    bare = re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S)
    path.write_text(bare)
    assert spec_from_model(path).spec.names == spec_from_model(_whole(tmp_path)).spec.names
    path.write_text(bare.replace('velocity="3"', ""))
    with pytest.raises(UsageError, match="limits are missing: velocity of shoulder"):
        spec_from_model(path)


def _whole(folder: Path) -> Path:
    (folder / "whole.urdf").write_text(URDF)
    return folder / "whole.urdf"


@pytest.mark.parametrize("attribute", ["drake:acceleration", "acceleration"])
def test_accelerations_that_the_file_states_are_its_own_with_prefixes_that_nobody_declared(
    tmp_path: Path, attribute: str
) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.replace('velocity="3"', f'velocity="3" {attribute}="2.5"'))
    found = spec_from_model(path)
    np.testing.assert_array_equal(found.spec.acceleration, [2.5, 4.0 / STOPPING_TIME])
    (assumed,) = [sentence for sentence in found.confirm if "cceleration" in sentence]
    assert "shoulder" not in assumed
    assert load_arm(found.spec).model().nv == 2


def test_urdf_gives_limits_and_lists_what_it_derived(urdf: Path) -> None:
    found = spec_from_model(urdf)
    assert found.spec.names == ("shoulder", "elbow")  # the mimic joint is no axis
    np.testing.assert_array_equal(found.spec.upper, [2.0, 1.5])
    np.testing.assert_array_equal(found.spec.command, [40.0, 20.0])
    np.testing.assert_allclose(found.spec.acceleration, found.spec.velocity / STOPPING_TIME)
    (assumed,) = [sentence for sentence in found.confirm if "cceleration" in sentence]
    assert "assumed" in assumed
    assert "shoulder 6, elbow 8" in assumed


def test_gravity_torque_from_a_meshless_model(urdf: Path) -> None:
    import mujoco

    spec = spec_from_model(urdf).spec
    loaded = load_arm(spec, shapes=False)
    model = loaded.model()
    data = mujoco.MjData(model)
    mujoco.mj_inverse(model, data)
    # Stretched out along x, axis y: a positive turn lowers the arm, so holding it takes a negative torque.
    rows = loaded.columns(model)
    expected = [-9.81 * (3 * 0.2 + 1 * 0.5), -9.81 * 0.1]
    np.testing.assert_allclose(data.qfrc_inverse[rows], expected, rtol=1e-6)


def test_joints_are_matched_by_name_in_any_order(urdf: Path) -> None:
    spec = spec_from_model(urdf, joints=("elbow", "shoulder")).spec
    loaded = load_arm(spec)
    assert loaded.joints == ("elbow", "shoulder")
    assert loaded.columns(loaded.model()).tolist() == [1, 0]


def test_missing_limits_are_all_listed(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = URDF.replace('velocity="3"', 'velocity="0"').replace('effort="20"', "")
    path.write_text(
        text.replace('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    )
    with pytest.raises(UsageError) as problem:
        spec_from_model(path)
    assert "velocity of shoulder; command of elbow" in str(problem.value)
    assert "--velocity shoulder=2.0 --command elbow=50," in str(problem.value)  # of those that lack it
    given = {
        "shoulder": {"velocity": 1.0},
        "elbow": {"lower": -1, "upper": 1, "command": 5, "acceleration": 2},
    }
    spec = spec_from_model(path, given=given).spec
    np.testing.assert_allclose(spec.acceleration, [1.0 / STOPPING_TIME, 2.0])


def test_mjcf_loads_without_its_meshes(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    with pytest.raises(UsageError, match=r"velocity of shoulder, slide \["):
        spec_from_model(path)
    given = {"shoulder": {"velocity": 1.0}, "slide": {"velocity": 0.5, "acceleration": 1.0}}
    spec = spec_from_model(path, given=given, command_unit="N").spec
    for all_or_one in ({"*": {"velocity": 0.5}, "shoulder": {"velocity": 1.0}}, given):
        assert spec_from_model(path, given=all_or_one).spec.velocity.tolist() == [1.0, 0.5]
        assert spec_from_model(path, given=dict(reversed(all_or_one.items()))).spec.velocity[0] == 1.0
    np.testing.assert_allclose(spec.lower, [-np.pi / 3, 0.0])
    np.testing.assert_allclose(spec.command, [100.0, 9.0])
    assert load_arm(spec).model().ngeom == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a readable URDF or MJCF"),
        ("<sdf/>", "root element is <sdf>"),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', "Expand it first"),
        (URDF.replace('upper="2"', 'upper="two"'), "this is not a number.*shoulder"),
        (URDF.replace('upper="2"', 'upper="120"'), "looks like degrees"),
        (URDF.replace('upper="2"', 'upper="-2"'), "lower limit -1 is not below upper limit -2"),
    ],
)
def test_bad_model_files(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(UsageError, match=words):
        spec_from_model(path)


def test_wrong_joints_name_the_models_joints(urdf: Path) -> None:
    with pytest.raises(UsageError, match=r"no moving joint knee.*shoulder, elbow"):
        spec_from_model(urdf, joints=("knee",))
    spec = spec_from_model(urdf).spec
    wrong = replace(spec, axes=(replace(spec.axes[0], name="knee"),))
    with pytest.raises(UsageError, match=r"no moving joint knee.*shoulder"):
        load_arm(wrong)


def test_floating_bases_and_absent_models_are_refused(tmp_path: Path, urdf: Path) -> None:
    path = tmp_path / "drone.xml"
    arm = '<body><joint name="arm"/><geom size=".1"/></body>'
    base = f'<body><freejoint name="base"/><geom size=".1"/>{arm}</body>'
    path.write_text(f"<mujoco><worldbody>{base}</worldbody></mujoco>")
    spec = spec_from_model(urdf).spec
    with pytest.raises(UsageError, match="base is not fixed: joint 'base' is free"):
        spec_from_model(path)
    held = replace(spec, axes=(replace(spec.axes[0], name="arm"),), model_file=path)
    assert any("although 'base' leaves it free" in sentence for sentence in load_arm(held).unverified)
    with pytest.raises(UsageError, match="has no model_file"):
        load_arm(replace(spec, model_file=None))
    with pytest.raises(UsageError, match="there is no model file"):
        load_arm(replace(spec, model_file=tmp_path / "gone.urdf"))


@pytest.mark.parametrize(
    ("text", "named", "unnamed"),
    [(URDF, '<robot name=" lbr ">', "<robot>"), (MJCF, '<mujoco model="lbr">', '<mujoco model="">')],
)
def test_a_robot_is_called_what_its_file_calls_it(
    tmp_path: Path, text: str, named: str, unnamed: str
) -> None:
    path, begin, given = tmp_path / "model.xml", text.split(">", 1)[0] + ">", {"*": {"velocity": 1.0}}
    path.write_text(text.replace(begin, named, 1))
    assert spec_from_model(path, given=given).spec.name == "lbr"
    assert spec_from_model(path, given=given, name="mine").spec.name == "mine"
    path.write_text(text.replace(begin, unnamed, 1))
    assert spec_from_model(path, given=given).spec.name == "model"
