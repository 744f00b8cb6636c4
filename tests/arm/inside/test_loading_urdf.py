"""A URDF written anew: what moves, what is held, what collides, what weighs, and what is said of it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
from loading_examples import ARM, BOX, CUBE, INERTIAL, LIMIT, MESH, joint, link, robot, write

from etude.errors import UsageError
from etude_arm import KIND
from etude_arm.loading.inertia import SMALLEST, possible
from etude_arm.loading.load import load
from etude_arm.loading.loaded_model import Loaded
from etude_arm.loading.overlapping_links import links_that_overlap, overlap_sentences, overlaps_of
from etude_arm.loading.pack import packed
from etude_arm.loading.rotations import angles_of, turn_of


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    return write(tmp_path)


def state(loaded: Loaded, **at: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = loaded.model()
    data = mujoco.MjData(model)
    for name, value in at.items():
        data.joint(name).qpos[:] = value
    mujoco.mj_forward(model, data)
    return model, data


def test_the_arm_is_chosen_shaped_named_and_fused(urdf: Path) -> None:
    loaded = load(urdf)
    model = loaded.model()
    assert loaded.joints == ("shoulder", "elbow", "wrist")
    assert [model.joint(j).name for j in range(model.njnt)] == list(loaded.joints)
    assert loaded.held == {"finger_left": 0.01, "finger_right": pytest.approx(-0.005)}
    names = {model.geom(g).name: model.body(int(model.geom_bodyid[g])).name for g in range(model.ngeom)}
    hand = dict.fromkeys(["hand#0", "left#0", "right#0"], "hand")
    assert names == {"base#0": "world", "upper#0": "upper", "fore#0": "fore", **hand}
    np.testing.assert_allclose(model.body("hand").mass, 0.7)
    assert loaded.source == str(urdf)
    assert loaded.unverified[0] == "the base 'base' is assumed to be fixed"


def test_a_mesh_is_its_hull_to_scale_where_the_file_puts_it(urdf: Path) -> None:
    model, data = state(load(urdf, ["shoulder"]))
    first, count = int(model.mesh_vertadr[0]), int(model.mesh_vertnum[0])
    corners = model.mesh_vert[first : first + count] @ data.geom("upper#0").xmat.reshape(3, 3).T
    corners = (corners + data.geom("upper#0").xpos - data.body("upper").xpos) @ data.body(
        "upper"
    ).xmat.reshape(3, 3)
    given = np.array([row.split()[1:] for row in CUBE.splitlines()], dtype=float) * [1, 1, 2] + [0.1, 0, 0]
    np.testing.assert_allclose(sorted(corners.round(6).tolist()), sorted(given.round(6).tolist()), atol=2e-6)


def test_to_hold_a_joint_is_to_leave_it_where_it_has_been_moved(urdf: Path) -> None:
    """Poses of all shapes and the torques of gravity, of a hinge, one without end, and a slide."""
    at = {"elbow": 0.7, "wrist": -2.1, "finger_left": 0.03}
    held, one = state(load(urdf, ["shoulder"], held=at), shoulder=0.4)
    free = load(urdf, ["shoulder", "elbow", "wrist", "finger_left"], held={"finger_right": -0.03 + 0.005})
    moved, other = state(free, shoulder=0.4, **at)
    for g in range(moved.ngeom):
        name = moved.geom(g).name
        np.testing.assert_allclose(one.geom(name).xpos, other.geom(name).xpos, atol=1e-12)
        np.testing.assert_allclose(one.geom(name).xmat, other.geom(name).xmat, atol=1e-12)
    assert held.ngeom == moved.ngeom
    torque = other.qfrc_bias[moved.joint("shoulder").dofadr]
    np.testing.assert_allclose(one.qfrc_bias, torque, rtol=1e-9)
    assert abs(float(torque[0])) > 0.1


def test_soft_limits_narrow_hard_ones_and_the_rest_is_said(urdf: Path) -> None:
    from etude_arm.model_file import spec_from_model

    found = spec_from_model(urdf)
    np.testing.assert_allclose(found.spec.lower, [-1.5, -1.0, -np.pi])
    np.testing.assert_allclose(found.spec.upper, [2.0, 2.0, np.pi])
    assert found.spec.held == {"finger_left": 0.01}  # a follower follows
    assert sum("cceleration" in sentence for sentence in found.confirm) == 1
    assert any("Ranges are assumed" in sentence and "wrist" in sentence for sentence in found.confirm)
    assert any("These joints are fixed: 'finger_left' at 0.01 m." in sentence for sentence in found.confirm)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</robot>", f"{link('base')}</robot>", "link 'base' is described 2 times"),
        ('name="elbow"', 'name="shoulder"', "joint 'shoulder' is described 2 times"),
        ('<link name="hand">', '<link name="">', "a link has no name"),
        ('<child link="hand"/>', '<child link="hnd"/>', "names a link 'hnd' that does not exist"),
        (
            '<child link="hand"/>',
            '<child link="upper"/>',
            "'upper' is the child of two joints: shoulder, wrist",
        ),
        (
            '<parent link="base"/>',
            '<parent link="hand"/>',
            "the joints form a circle|2 base links|names a link",
        ),
        ("</robot>", f"{link('stray')}</robot>", "2 base links: base, stray"),
        (
            'name="shoulder" type="revolute"',
            'name="shoulder" type="floating"',
            "base is not fixed: joint 'shoulder'",
        ),
        (
            'name="shoulder" type="revolute"',
            'name="shoulder" type="planar"',
            "base is not fixed: joint 'shoulder'",
        ),
        ('value="3.0"', 'value="-3.0"', "a mass cannot be -3 kg"),
        ('value="3.0"', 'value="heavy"', "not a number"),
    ],
)
def test_bad_files_are_refused_with_the_reason(urdf: Path, old: str, new: str, words: str) -> None:
    text = robot()
    assert old in text
    urdf.write_text(text.replace(old, new, 1))
    with pytest.raises(UsageError, match=words) as refused:
        load(urdf)
    assert str(urdf) in refused.value.where


def test_a_floating_base_is_fixed_only_if_joints_are_named(urdf: Path) -> None:
    urdf.write_text(robot().replace('name="shoulder" type="revolute"', 'name="shoulder" type="floating"'))
    loaded = load(urdf, ["elbow", "wrist"])
    assert (
        loaded.unverified[0]
        == "the base 'base' is assumed to be fixed although 'shoulder' is floating or planar"
    )


XACRO = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="m" value="2"/>'


def test_values_of_xacro_that_nothing_refers_to_are_no_reason_to_expand_a_file(tmp_path: Path) -> None:
    path = write(tmp_path)
    plain = load(path)
    path.write_text(robot().replace('<robot name="arm">', XACRO))
    assert load(path).xml == plain.xml
    for used in ('<box size="${m} 0.1 0.1"/>', "<xacro:box/>"):
        path.write_text(robot(ARM.replace(BOX, used)).replace('<robot name="arm">', XACRO))
        with pytest.raises(UsageError, match="xacro file"):
            load(path)


@pytest.mark.parametrize("name", ["arm.urdf", "arm.urdf.xacro", "arm.xacro"])
def test_xacro_is_refused_with_how_to_expand_it_into_a_new_file(tmp_path: Path, name: str) -> None:
    """What it says to type must not empty the very file, nor one that lies beside it."""
    path = tmp_path / name
    path.write_text('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>')
    new = "arm_expanded.urdf" if name == "arm.urdf" else "arm.urdf"
    with pytest.raises(UsageError, match=rf"xacro file.*Expand it first: xacro {name} > {new} "):
        load(path)
    (tmp_path / new).write_text("mine")
    with pytest.raises(UsageError, match=rf"xacro {name} > (?!{new})"):
        load(path)
    assert KIND.recognises(path)


def test_without_any_mass_joints_and_shapes_count_and_what_lacks_one_is_asked(urdf: Path) -> None:
    root = ET.fromstring(robot())
    for name in root.findall("link"):
        for inertial in name.findall("inertial"):
            name.remove(inertial)
    urdf.write_text(ET.tostring(root, encoding="unicode"))
    loaded = load(urdf)
    assert any("The model file gives no masses" in note for note in loaded.notes)
    assert loaded.model().ngeom == load(write(urdf.parents[2] / "whole")).model().ngeom
    urdf.write_text(robot().replace(INERTIAL.format(mass=3.0), ""))
    loaded = load(urdf)
    assert any("No mass is given for the part that upper carries" in note for note in loaded.notes)
    assert loaded.model().body("upper").mass < 1e-6  # not what its shape would weigh


def test_inertias_are_repaired_and_named_with_their_old_values(urdf: Path) -> None:
    zero = '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    start = robot().index("<inertia ixx")
    text = robot()[:start] + zero + robot()[robot().index("/>", start) + 2 :]
    urdf.write_text(text)
    loaded = load(urdf)
    assert any("'upper' (3 kg, ixx 0, iyy 0, izz 0)" in note for note in loaded.notes)
    np.testing.assert_allclose(loaded.model().body("upper").inertia, SMALLEST, rtol=1e-6)


def test_a_possible_inertia_is_left_alone_and_an_impossible_one_becomes_one() -> None:
    sound = np.diag([1.0, 2.0, 2.5])
    assert possible(sound) is sound
    turn = turn_of(0.3, 0.4, 0.5)
    for moments in ([1.0, 2.0, 4.0], [0.0, 0.0, 1.0], [-1.0, 1.0, 1.0], [0.0, 0.0, 0.0]):
        repaired = np.linalg.eigvalsh(possible(turn @ np.diag(moments) @ turn.T))
        assert repaired[0] > 0
        assert repaired[2] <= repaired[0] + repaired[1]
    np.testing.assert_allclose(np.linalg.eigvalsh(possible(np.diag([1.0, 2, 4]))), [2, 3, 5], rtol=1e-8)


def test_a_missing_mesh_is_replaced_by_what_is_drawn_and_then_by_a_guess(urdf: Path) -> None:
    (urdf.parents[1] / "meshes/cube.obj").unlink()
    loaded = load(urdf)
    assert any("package://arm/meshes/cube.obj" in n and "--mesh-root" in n for n in loaded.notes)
    assert any(
        "'upper': its mesh is missing, so the visual geometry" in sentence for sentence in loaded.unverified
    )
    assert loaded.model().geom("upper#0").type == mujoco.mjtGeom.mjGEOM_BOX
    urdf.write_text(robot().replace(f"<visual><geometry>{BOX}</geometry></visual>", ""))
    loaded = load(urdf)
    assert any("'upper': its mesh is missing, so a capsule is assumed" in s for s in loaded.unverified)
    model, data = state(loaded)
    geom, way = data.geom("upper#0"), data.body("fore").xpos - data.body("upper").xpos
    assert model.geom("upper#0").type == mujoco.mjtGeom.mjGEOM_CAPSULE
    np.testing.assert_allclose(geom.xpos, data.body("upper").xpos + way / 2, atol=1e-9)
    np.testing.assert_allclose(geom.xmat.reshape(3, 3)[:, 2], way / np.linalg.norm(way), atol=1e-9)


def test_what_is_drawn_counts_where_a_moving_part_has_no_collision_shape(urdf: Path) -> None:
    shape = '<collision><origin xyz="0.1 0 0"/><geometry>' + MESH + "</geometry></collision>"
    urdf.write_text(robot().replace(shape, ""))
    loaded = load(urdf)
    assert any("The visual geometry of upper is used as shape" in note for note in loaded.notes)
    drawn = f"<visual><geometry>{BOX}</geometry></visual>"
    urdf.write_text(robot().replace(shape, "").replace(drawn, ""))
    assert "the shape of link 'upper': the file has none" in load(urdf).unverified


def test_sensor_shells_of_a_part_that_has_shapes_are_left_out(urdf: Path) -> None:
    camera = link("camera", 0.1, drawn=BOX) + joint("mount", "fore", "camera", "fixed", limit="")
    urdf.write_text(robot(ARM + camera))
    model = load(urdf).model()
    assert "camera#0" not in [model.geom(g).name for g in range(model.ngeom)]


def test_a_packed_file_stands_alone_and_loads_to_the_same_model(urdf: Path, tmp_path: Path) -> None:
    data, meshes = packed(urdf)
    alone = tmp_path / "alone" / "robot.urdf"
    for name, content in {alone.name: data, **meshes}.items():
        (alone.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (alone.parent / name).write_bytes(content)
    (urdf.parents[1] / "meshes/cube.obj").unlink()
    again = load(alone)
    assert again.held.keys() == {"finger_left", "finger_right"}
    assert not any("missing" in note for note in again.notes)
    model = again.model()
    assert model.nmesh == 1
    np.testing.assert_allclose(np.ptp(model.mesh_vert, axis=0), [0.2, 0.2, 0.2], atol=1e-6)


def test_angles_give_the_turn_back() -> None:
    rng = np.random.default_rng(0)
    for roll, pitch, yaw in [*rng.uniform(-3, 3, (20, 3)), (0.3, np.pi / 2, 0.4), (0.3, -np.pi / 2, 0.4)]:
        turn = turn_of(roll, pitch, yaw)
        np.testing.assert_allclose(turn_of(*angles_of(turn)), turn, atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(turn_of(0, 0, np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(turn_of(np.pi / 2, 0, 0) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


def test_links_are_crowded_where_shapes_of_distant_parts_overlap(urdf: Path) -> None:
    """Three bars of 0.3 m in a plane: the third lies on the first only if the joint between folds it back."""
    bar = '<collision><origin xyz="0.15 0 0"/><geometry><box size="0.25 0.02 0.02"/></geometry></collision>'
    links = "".join(
        f'<link name="{n}">{INERTIAL.format(mass=1)}{bar}</link>' for n in ("one", "two", "three")
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{a}"/><child link="{b}"/><origin xyz="{x} 0 0"/>'
        f'<axis xyz="0 0 1"/><limit lower="-4" upper="4" velocity="1" effort="1"/></joint>'
        for k, (a, b, x) in enumerate([("base", "one", 0), ("one", "two", 0.3), ("two", "three", 0.05)])
    )
    urdf.write_text(robot(f'<link name="base"/>{links}{joints}'))
    loaded = load(urdf)
    # the third begins beside the end of the first: it lies on it if both turn by the same half turn
    folded = np.array([0.0, 0.0, np.pi - 0.05]), np.array([1.0, 0.0, np.pi + 0.05])
    assert links_that_overlap(overlaps_of(loaded, *folded)) == {"one", "three"}
    assert overlaps_of(loaded, np.array([0.0, 0, -0.2]), np.array([1.0, 0, 0.2])) == {}
    (said,) = overlap_sentences(overlaps_of(loaded, *folded), ())
    assert "one and three in 100%" in said
    assert overlap_sentences(overlaps_of(loaded, *folded), [("three", "one")]) == ()
    seldom = np.array([0.0, 0.0, 2.2]), np.array([1.0, 0.0, np.pi + 0.05])
    assert links_that_overlap(overlaps_of(loaded, *seldom)) == {"one", "three"}
    assert overlap_sentences(overlaps_of(loaded, *seldom), ()) == ()


@pytest.mark.parametrize("limit", ['<limit effort="3"/>', '<limit lower="1" upper="1" effort="3"/>', ""])
def test_a_hinge_without_a_range_has_none_and_mujoco_writes_no_file(
    urdf: Path, limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = urdf.parent / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    urdf.write_text(robot().replace(LIMIT, limit, 1))
    model = load(urdf).model()
    assert not model.jnt_limited[model.joint("shoulder").id]
    if limit:
        np.testing.assert_allclose(model.jnt_actfrcrange[model.joint("shoulder").id], [-3, 3])
    assert list(folder.iterdir()) == []


def test_a_world_that_is_not_described_is_what_drakes_files_weld_their_base_to(urdf: Path) -> None:
    weld = '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>'
    bare = load(urdf)
    urdf.write_text(robot(ARM + weld))
    welded = load(urdf)
    assert welded.joints == bare.joints
    np.testing.assert_array_equal(welded.model().body_mass, bare.model().body_mass)
    assert any("base 'world' is assumed to be fixed" in sentence for sentence in welded.unverified)


def test_of_a_base_that_is_free_an_example_says_how_to_choose(urdf: Path) -> None:
    free = '<joint name="free" type="planar"><parent link="floor"/><child link="base"/></joint>'
    urdf.write_text(robot(f'<link name="floor"/>{ARM}{free}'))
    with pytest.raises(UsageError, match=r"is floating or planar.*--joints shoulder elbow wrist") as refused:
        load(urdf)
    assert refused.value.next_step.endswith("--joints shoulder elbow wrist.")
    assert load(urdf, ["shoulder", "elbow", "wrist"]).joints == ("shoulder", "elbow", "wrist")
