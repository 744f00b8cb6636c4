"""An MJCF written anew: the same physics, chosen joints alone, its own shapes and exclusions."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm.loading.load import load
from etude_arm.loading.pack import packed

CUBE = " ".join(f"{x} {y} {z}" for x in (0, 0.2) for y in (-0.1, 0.1) for z in (-0.05, 0.05))
GONE = '<texture name="t" file="gone.png" type="2d"/>'
MJCF = f"""<mujoco><compiler angle="degree" eulerseq="zyx"/><option gravity="0.5 0 -9"/>
  <asset><mesh name="m" vertex="{CUBE}" scale="1 1 2" inertia="exact"/>{GONE}
    <material name="s" texture="t"/></asset>
  <default><joint armature="0.1" damping="2"/></default>
  <worldbody><geom type="plane" size="1 1 1"/>
   <frame euler="20 10 5" pos="0 0 1"><body name="a" pos="0.1 0 0" euler="0 0 30">
    <joint name="one" axis="0 1 0.2" pos="0.02 0 0.1" range="-60 90" ref="10"/>
    <joint name="two" axis="1 0 0.3" pos="0 0.05 0" range="-90 90"/>
    <geom type="mesh" mesh="m" pos="0 0 0.1" euler="10 0 0" material="s"/>
    <geom size=".02" contype="0" conaffinity="0"/>
    <body name="b" pos=".4 0 0"><joint name="slide" type="slide" axis="1 1 0" range="0 0.3"
      actuatorfrcrange="-9 9"/>
     <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
     <body name="c" pos=".3 0 0"><joint name="three" axis="0 0 1"/>
      <geom type="box" size=".03 .02 .01" pos="0 .02 0" mass="0.3"/>
      <site name="end"/><body name="f1"><joint name="g1" type="slide" range="0 .04"/><geom size=".01"/>
       </body><body name="f2"><joint name="g2" type="slide" range="-.08 .04"/><geom size=".01"/></body>
      </body></body></body></frame></worldbody>
  <contact><exclude body1="a" body2="c"/></contact>
  <equality><joint joint1="g2" joint2="g1" polycoef="0 -2 0 0 0"/></equality>
  <actuator><motor joint="one" gear="50" ctrlrange="-2 2"/><position joint="g1"/></actuator>
  <keyframe><key qpos="0 0 0 0 0 0"/></keyframe></mujoco>"""


@pytest.fixture
def mjcf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    return path


def original() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MJCF.replace(GONE, "").replace('texture="t"', ""))


def test_to_hold_a_joint_is_to_leave_it_where_it_has_been_moved(mjcf: Path) -> None:
    """Against the file as MuJoCo has it: references, anchors, frames, Euler angles, two joints in a body."""
    at = {"one": -0.4, "slide": 0.11, "g1": 0.02, "g2": -0.04}
    loaded = load(mjcf, ["three", "two"], held={"one": -0.4, "slide": 0.11, "g1": 0.02})
    model, whole = loaded.model(), original()
    assert loaded.held == pytest.approx(at)
    assert model.nv == 2
    assert model.nu == 0
    data, other = mujoco.MjData(model), mujoco.MjData(whole)
    data.qpos[loaded.columns(model)] = [0.3, -0.8]
    for name, value in {**at, "three": 0.3, "two": -0.8}.items():
        other.joint(name).qpos[:] = value
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(whole, other)
    np.testing.assert_allclose(data.body("c").xpos, other.body("c").xpos, atol=1e-12)
    np.testing.assert_allclose(data.body("c").xmat, other.body("c").xmat, atol=1e-12)
    for name in loaded.joints:
        expected = other.qfrc_bias[whole.joint(name).dofadr]
        np.testing.assert_allclose(data.qfrc_bias[model.joint(name).dofadr], expected, rtol=1e-9)
        assert abs(float(expected[0])) > 1e-3
        assert model.dof_armature[model.joint(name).dofadr] == 0.1
    np.testing.assert_allclose(model.opt.gravity, [0.5, 0, -9])


def test_shapes_are_what_collides_by_the_name_of_its_body(mjcf: Path) -> None:
    loaded = load(mjcf)
    model = loaded.model()
    assert loaded.joints == ("one", "two", "slide", "three")  # the fingers are held, one follows
    names = [model.geom(g).name for g in range(model.ngeom)]
    assert sorted(names) == ["a#0", "b#0", "c#0", "f1#0", "f2#0"]
    assert model.body(int(model.geom_bodyid[names.index("f1#0")])).name == "c"
    assert loaded.excluded == (("a#0", "c#0"),)
    assert [plane.point for plane in loaded.planes] == [(0.0, 0.0, 0.0)]
    assert loaded.beside == {}
    np.testing.assert_allclose(np.ptp(model.mesh_vert, axis=0), [0.2, 0.2, 0.2], atol=1e-6)
    np.testing.assert_allclose(np.sum(model.body_mass), np.sum(original().body_mass))


def test_a_held_joint_behind_a_moving_one_of_its_body_is_refused(mjcf: Path) -> None:
    with pytest.raises(UsageError, match="'two' cannot be fixed: one before it in its body moves"):
        load(mjcf, ["one", "three"])


def test_drives_come_along_where_they_are_asked_for(mjcf: Path) -> None:
    model = load(mjcf, drives=True).model()
    assert model.nu == 1  # the gripper's has nothing to move
    np.testing.assert_allclose(model.actuator_gear[0, 0], 50)
    assert load(mjcf).model().nu == 0


def test_a_mesh_that_is_gone_takes_its_shape_along_and_is_said(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    bodies = '<body name="a"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="j"/>{}</body>'
    geoms = '<geom type="mesh" mesh="x"/><geom size=".1"/>'
    asset = '<asset><mesh name="x" file="gone.stl"/></asset>'
    path.write_text(f"<mujoco>{asset}<worldbody>{bodies.format(geoms)}</worldbody></mujoco>")
    loaded = load(path, ["j"])
    assert "the shape of body 'a': its mesh is missing" in loaded.unverified
    assert loaded.model().ngeom == 1


def test_what_mujoco_cannot_load_is_said_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text('<mujoco><worldbody><body><joint name="j"/></body></worldbody></mujoco>')
    with pytest.raises(UsageError, match=r"MuJoCo cannot load the model.*mass and inertia") as refused:
        load(path)
    assert refused.value.where == str(path)


def test_a_packed_file_has_its_meshes_beside_it(tmp_path: Path) -> None:
    """Two meshes of one file name, in folders below the meshdir, under the names they had."""
    for part, size in (("a", 0.1), ("b", 0.2)):
        (tmp_path / "assets" / part).mkdir(parents=True)
        corners = [f"v {x} {y} {z}" for x in (0, size) for y in (0, size) for z in (0, size)]
        (tmp_path / "assets" / part / "link.obj").write_text("\n".join(corners))
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><compiler meshdir="assets"/><asset><mesh name="one" file="a/link.obj"/>'
        '<mesh file="b/link.obj"/></asset><worldbody><body><joint name="j" axis="0 1 0"/>'
        '<geom type="mesh" mesh="one"/><geom type="mesh" mesh="link"/></body></worldbody></mujoco>'
    )
    data, meshes = packed(path)
    assert sorted(meshes) == ["robot_meshes/0_link.obj", "robot_meshes/1_link.obj"]
    alone = tmp_path / "alone" / "robot.xml"
    for name, content in {alone.name: data, **meshes}.items():
        (alone.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (alone.parent / name).write_bytes(content)
    one, other = load(alone, ["j"]).model(), load(path, ["j"]).model()
    np.testing.assert_array_equal(one.mesh_vert, other.mesh_vert)
    np.testing.assert_array_equal(one.body_inertia, other.body_inertia)
