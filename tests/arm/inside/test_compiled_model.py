"""What is compiled of a model file is the robot that it describes, mounted and loaded: pinocchio judges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from etude.errors import UnsafeModelError
from etude_arm import ArmSpec
from etude_arm.clearance.distances import CUTOFF
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.surroundings import Box, Collision, Floor, Surroundings
from etude_arm.loading import mjcf_writer, urdf
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.loading.load import load_arm
from etude_arm.model_file import spec_from_model
from etude_arm.physics import rigid_tree
from etude_arm.physics.geometry import read_geometry
from etude_arm.physics.kinematics import body_motion
from etude_arm.physics.newton_euler import nominal_commands
from etude_arm.rehearsal.rehearsed_robot import rehearsed

PACKAGE = "cmeel.prefix/share/example-robot-data/robots"
ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "panda": ("panda_description/urdf/panda.urdf", ()),
    "z1": ("z1_description/urdf/z1.urdf", ()),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ()),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", ("arm_*_joint",)),
}
WALL = Mounting((0.0, 0.3, 1.2), (0.0, np.pi / 2, 0.0))
CEILING = Mounting((0.5, 0.0, 2.0), (np.pi, 0.0, 0.4))
LEANING = Mounting((0.1, -0.2, 0.3), (np.pi / 6, 0.0, -1.0))
TOOL = Attached(mass=0.4, centre=(0.0, 0.01, 0.05), shape="cylinder", size=(0.03, 0.1))
LOAD = Attached(mass=0.9, centre=(0.02, 0.0, 0.12), inertia=(0.004, 0.005, 0.006, 0.0, 0.0, 0.001))

LINKS = """<link name="l1">{mass1}<collision><origin xyz="0 0 .15"/><geometry><sphere radius="0.02"/>
</geometry></collision></link><link name="{tip}"><inertial><mass value="2"/>
<origin xyz="0.4 0 0" rpy="0.1 0.2 0.3"/>
<inertia ixx=".01" iyy=".02" izz=".02" ixy=".001" ixz="0" iyz="0"/></inertial><collision>
<origin xyz="0.25 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>"""
MASS = """<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial>"""
LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="50"/>'
FOOT = """<link name="foot"><collision><geometry><box size="0.1 0.1 0.02"/></geometry></collision></link>
<joint name="fix" type="fixed"><parent link="{root}"/><child link="foot"/>
<origin xyz="0.02 0.01 0.1" rpy="0.2 0 0.5"/></joint>"""
JOINTS = """<joint name="a" type="revolute"><parent link="{foot}"/><child link="l1"/>
<axis xyz="0 0 1"/>{limit}</joint>
<joint name="b" type="{kind}"><parent link="l1"/><child link="{tip}"/><origin xyz="0 0 .3"/>
<axis xyz="0 1 0"/>{limit}</joint>"""
NAMES = (
    "world",
    "base_link",
    "room",
    "tool",
    "payload",
    "own_world",
    "box: table",
    "a/b",
    "l1#0",
    "x y",
    "ä",
    "*",
)


Array = NDArray[np.float64]


def two(root: str, tip: str = "l2", *, own: str = "", described: bool = True, kind: str = "revolute") -> str:
    """Two joints on a foot that is fixed to the root; `own` is what the root has."""
    links = f'<link name="{root}">{own}</link>' if described else ""
    links += FOOT.format(root=root) + LINKS.format(mass1=MASS, tip=tip)
    return f'<robot name="two">{links}{JOINTS.format(foot="foot", tip=tip, kind=kind, limit=LIMIT)}</robot>'


def written(folder: Path, text: str, **more: Any) -> ArmSpec:
    path = folder / "arm.urdf"
    path.write_text(text)
    return replace(spec_from_model(path).spec, **more)


def example(name: str, **more: Any) -> ArmSpec:
    from importlib.metadata import PackageNotFoundError, distribution

    file, joints = ARMS[name]
    try:
        path = distribution("example-robot-data").locate_file(f"{PACKAGE}/{file}")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")
    return replace(spec_from_model(Path(str(path)), joints=joints or None).spec, **more)


class Judge:
    """The same arm in pinocchio, from the file alone: joints that are held reduced, masses appended."""

    def __init__(self, spec: ArmSpec) -> None:
        pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install pin")
        whole = pin.buildModelFromXML(spec.model_file.read_text())  # type: ignore[union-attr]
        zero, held = pin.neutral(whole), load_arm(spec, shapes=False).held
        for name, value in held.items():
            joint = whole.joints[whole.getJointId(name)]
            turns = joint.nq == 2
            zero[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if turns else value
        locked = [k for k, name in enumerate(whole.names) if k and name not in spec.names]
        self.pin, self.whole, self.zero, self.locked = pin, whole, zero, locked
        self.model = pin.buildReducedModel(whole, locked, zero)
        mounting = spec.mounting or Mounting()
        turn = pin.rpy.rpyToMatrix(*mounting.rotation)
        self.base = pin.SE3(turn, np.array(mounting.position))
        self.model.gravity.linear = turn.T @ np.array([0.0, 0.0, -9.81])
        for one in (spec.tool, spec.payload):
            if one:
                own = pin.Inertia(one.mass, np.array(one.centre), one.moments())
                last = self.model.getJointId(spec.names[-1])
                self.model.appendBodyToJoint(last, own, pin.SE3.Identity())
        self.data = self.model.createData()
        self.order = [self.model.joints[self.model.getJointId(name)] for name in spec.names]
        self.ids = [self.model.getJointId(name) for name in spec.names]

    def q(self, pose: Array) -> Array:
        full = self.pin.neutral(self.model)
        for value, joint in zip(pose, self.order, strict=True):
            turns = joint.nq == 2
            full[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if turns else value
        return np.asarray(full)

    def gravity(self, pose: Array) -> Array:
        found = self.pin.computeGeneralizedGravity(self.model, self.data, self.q(pose))
        return np.array([found[joint.idx_v] for joint in self.order])

    def frames(self, pose: Array) -> Array:
        """(J, 4, 4) of what each joint moves, in the room."""
        self.pin.forwardKinematics(self.model, self.data, self.q(pose))
        return np.array([(self.base * self.data.oMi[k]).homogeneous for k in self.ids])


def require_alike(spec: ArmSpec) -> None:
    """Gravity torques and forward kinematics at random poses, by what learning and designs use."""
    judge, found = Judge(spec), read_geometry(spec)
    assert found is not None
    poses = np.random.default_rng(4).uniform(spec.lower, spec.upper, (5, spec.dof))
    still = np.zeros_like(poses)
    torque, motion = (
        nominal_commands(found, poses, still, still),
        body_motion(found.tree, poses, still, still),
    )
    bodies = found.tree.joint_body
    for k, pose in enumerate(poses):
        np.testing.assert_allclose(torque[k], judge.gravity(pose), atol=1e-6)
        wanted = judge.frames(pose)
        np.testing.assert_allclose(motion.position[bodies, k], wanted[:, :3, 3], atol=1e-7)
        np.testing.assert_allclose(motion.rotation[bodies, k], wanted[:, :3, :3], atol=1e-7)


@pytest.mark.parametrize("root", NAMES)
def test_the_name_of_the_root_changes_nothing(root: str, tmp_path: Path) -> None:
    require_alike(written(tmp_path, two(root), mounting=WALL, tool=TOOL, payload=LOAD))


@pytest.mark.parametrize("tip", NAMES)
def test_nor_does_that_of_a_link_that_moves(tip: str, tmp_path: Path) -> None:
    require_alike(written(tmp_path, two("trunk", tip), mounting=LEANING, tool=TOOL, payload=LOAD))


@pytest.mark.parametrize(
    "own", ["", MASS, '<collision><geometry><box size="1 1 0.1"/></geometry></collision>']
)
def test_a_root_called_world_may_have_mass_and_shape(own: str, tmp_path: Path) -> None:
    require_alike(written(tmp_path, two("world", own=own), mounting=CEILING))


def test_nor_need_it_be_described(tmp_path: Path) -> None:
    """pinocchio does not know such a file: the one that describes the root judges."""
    described, bare = (two("world", described=known) for known in (True, False))
    judge, spec = (
        Judge(written(tmp_path, described, mounting=CEILING)),
        written(tmp_path, bare, mounting=CEILING),
    )
    known, q, still = read_geometry(spec), np.array([[0.3, -1.1]]), np.zeros((1, 2))
    assert known is not None
    np.testing.assert_allclose(nominal_commands(known, q, still, still)[0], judge.gravity(q[0]), atol=1e-6)


def test_a_slide_on_a_wall(tmp_path: Path) -> None:
    require_alike(written(tmp_path, two("world", kind="prismatic"), mounting=WALL, payload=LOAD))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("mounting", [WALL, CEILING, LEANING], ids=["wall", "ceiling", "leaning"])
def test_arms_of_others_mounted_and_loaded(name: str, mounting: Mounting) -> None:
    require_alike(example(name, mounting=mounting, tool=TOOL, payload=LOAD))


@pytest.mark.parametrize("root", ["world", "base_link"])
def test_the_distance_of_a_mounted_arm_from_a_box(root: str, tmp_path: Path) -> None:
    """A sphere and an upright box have it in closed form."""
    spec = written(tmp_path, two(root), mounting=WALL)
    box = Box("table", (0.5, 0.3, 1.0), (0.4, 0.3, 0.2))
    gaps = gaps_of(load_arm(spec), spec.lower, spec.upper, Surroundings(box=(box,)))
    [k] = [k for k, gap in enumerate(gaps.list) if gap.names == ("l2", "table")]
    judge, poses = Judge(spec), gaps.skeleton.random_poses(np.random.default_rng(1), 200)
    found = gaps.of_poses(poses)[:, k]
    centres = np.array([judge.frames(pose)[1] @ [0.25, 0.0, 0.0, 1.0] for pose in poses])[:, :3]
    beyond = np.abs(centres - box.centre) - 0.5 * np.array(box.size)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    clear = (outside > 0.06) & (outside < 0.05 + CUTOFF)
    assert clear.sum() > 50
    np.testing.assert_allclose(found[clear], outside[clear] - 0.05, atol=2e-4)


@pytest.mark.parametrize("name", ["table", "base", "floor", "box: table"])
def test_a_link_called_like_what_stands_around_hides_none_of_it(name: str, tmp_path: Path) -> None:
    """Who ignores the distance of two links has not said that the table of that name may be hit."""
    box = Box("table" if name == "box: table" else name, (0.5, 0.3, 1.0), (0.4, 0.3, 0.2))
    around = Surroundings(floor=Floor(0.8)) if name == "floor" else Surroundings(box=(box,))
    more = (
        f'<link name="{name}"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
        f'<joint name="more" type="fixed"><parent link="foot"/><child link="{name}"/></joint></robot>'
    )
    texts = two("world"), two("world").replace("</robot>", more)
    ignoring = replace(around, collision=Collision(ignore=(("l2", name),)))
    poses, found = np.random.default_rng(1).uniform(-2.0, 2.0, (50, 2)), []
    for text, own in zip(texts, (around, ignoring), strict=True):
        spec = written(tmp_path, text, mounting=WALL)
        gaps = gaps_of(load_arm(spec), spec.lower, spec.upper, own)
        shapes = gaps.skeleton.shapes
        things = [gap.other < 0 or shapes[gap.other].box for gap in gaps.list]
        assert sum(things) == 2, "l1 and l2"
        found.append(gaps.of_poses(poses)[:, things])
    np.testing.assert_array_equal(*found)


def test_the_distance_of_a_ur5_on_a_wall_from_a_table() -> None:
    """Against coal's distances of the hulls of its meshes; the UR's root is called world."""
    coal = pytest.importorskip("coal", reason="coal is not installed: pip install coal")
    spec = example("ur5", mounting=WALL)
    box = Box("table", (0.6, 0.3, 0.9), (0.4, 0.8, 0.4))
    gaps = gaps_of(load_arm(spec), spec.lower, spec.upper, Surroundings(box=(box,)))
    own = [k for k, gap in enumerate(gaps.list) if gap.names[1] == "table"]
    judge = Judge(spec)
    folder = str(spec.model_file).partition("/robots/")[0].rpartition("/")[0]
    pin = judge.pin
    solids = pin.buildGeomFromUrdf(
        judge.whole, str(spec.model_file), pin.GeometryType.COLLISION, package_dirs=folder
    )
    for one in solids.geometryObjects:
        if isinstance(one.geometry, coal.BVHModelBase):
            one.geometry.buildConvexHull(True, "Qt")
            one.geometry = one.geometry.convex
    table, place = coal.Box(*box.size), coal.Transform3s(np.eye(3), np.array(box.centre))
    data, places, compared = judge.whole.createData(), solids.createData(), 0
    for pose in np.random.default_rng(2).uniform(spec.lower, spec.upper, (40, spec.dof)):
        pin.updateGeometryPlacements(judge.whole, data, solids, places, judge.q(pose))
        nearest = np.inf
        for one, at in zip(solids.geometryObjects, places.oMg, strict=True):
            if one.parentJoint:
                there = judge.base * at
                result = coal.DistanceResult()
                transform = coal.Transform3s(there.rotation, there.translation)
                coal.distance(one.geometry, transform, table, place, coal.DistanceRequest(), result)
                nearest = min(nearest, result.min_distance)
        if 1e-3 < nearest < CUTOFF:
            compared += 1
            assert abs(gaps.of_poses(pose[None])[0, own].min() - nearest) < 5e-4
    assert compared > 5


MJCF = """<mujoco><worldbody><geom name="slab" type="box" size=".2 .2 .01"/><body name="{one}" pos="0 0 .2">
<joint name="a" axis="0 1 0" range="-1 1"/><geom size=".1" mass="1"/><body{two} pos=".5 0 0" euler="10 20 30">
<joint name="b" axis="0 1 0" range="-1 1"/><geom type="box" size=".1 .1 .1" mass="1"/></body></body>
</worldbody></mujoco>"""


def mjcf(folder: Path, one: str = "upper", two: str = ' name="fore"', **more: Any) -> ArmSpec:
    (folder / "arm.xml").write_text(MJCF.format(one=one, two=two))
    limits = {"velocity": 1.0, "command": 10.0}
    spec = spec_from_model(folder / "arm.xml", given={"a": limits, "b": limits}).spec
    return replace(spec, **more)


@pytest.mark.parametrize("one", ["body2", "tool", "carried tool", "own_body2", "upper#0", "a/b", "slab"])
def test_no_name_of_an_mjcf_changes_what_is_compiled(one: str, tmp_path: Path) -> None:
    plain = load_arm(mjcf(tmp_path, two="", mounting=WALL, tool=TOOL)).model()
    other = load_arm(mjcf(tmp_path, one, two="", mounting=WALL, tool=TOOL)).model()
    for name in ("body_mass", "body_pos", "body_quat", "body_inertia", "jnt_axis", "geom_pos", "geom_size"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(other, name))


def test_a_mounted_mjcf_weighs_as_by_levers(tmp_path: Path) -> None:
    """By the potential of two point masses: tau = dV/dq, of the file's own lengths."""
    spec, step = mjcf(tmp_path, mounting=WALL, payload=LOAD), 1e-6
    known = read_geometry(spec)
    assert known is not None
    q, still = np.array([[0.4, -0.7]]), np.zeros((1, 2))
    turn = _about(1, WALL.rotation[1])

    def potential(pose: Array) -> float:
        first = _about(1, pose[0])
        tilt = _about(0, np.radians(10)) @ _about(1, np.radians(20)) @ _about(2, np.radians(30))
        second = first @ tilt @ _about(1, pose[1])
        elbow = np.array([0.0, 0.0, 0.2]) + first @ [0.5, 0.0, 0.0]
        moment = 1.0 * np.array([0.0, 0.0, 0.2]) + elbow + LOAD.mass * (elbow + second @ LOAD.centre)
        return float(9.81 * (turn @ moment)[2])

    wanted = [(potential(q[0] + e) - potential(q[0] - e)) / (2 * step) for e in step * np.eye(2)]
    np.testing.assert_allclose(nominal_commands(known, q, still, still)[0], wanted, atol=1e-6)


def _about(axis: int, angle: float) -> Array:
    turn, (i, j) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
    return turn


def _names_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(urdf, "body_names", lambda links: {link: link for link in links})


def _without(what: str) -> Callable[[pytest.MonkeyPatch], None]:
    """Writers that forget the mounting, or what is carried."""

    def broken(monkeypatch: pytest.MonkeyPatch) -> None:
        whole, drop = urdf.add_to_urdf, {what: None if what == "mounting" else ()}
        monkeypatch.setattr(
            urdf,
            "add_to_urdf",
            lambda new, tree, joints, added, bodies: whole(new, tree, joints, replace(added, **drop), bodies),
        )
        if what == "mounting":
            monkeypatch.setattr(mjcf_writer, "mounted", lambda world, mounting: world)
        else:
            monkeypatch.setattr(mjcf_writer, "add_carried", lambda *given: None)

    return broken


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (_names_kept, "the base is .* 90 deg away from .*gravity in the frame of the base"),
        (_without("mounting"), "the base is .* 90 deg away from .*gravity in the frame of the base"),
        (_without("carried"), r"weighs .*the payload \(0.9 kg\) is not there"),
    ],
    ids=["names", "mounting", "payload"],
)
@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_a_writer_that_forgets_is_found_out(
    broken: Callable[[pytest.MonkeyPatch], None],
    said: str,
    form: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if form == "mjcf" and broken is _names_kept:
        pytest.skip("MuJoCo itself refuses an MJCF whose body is called world")
    more = {"mounting": WALL, "payload": LOAD}
    spec = mjcf(tmp_path, **more) if form == "mjcf" else written(tmp_path, two("world"), **more)
    broken(monkeypatch)
    with pytest.raises(UnsafeModelError, match=said) as refusal:
        load_arm(spec)
    assert refusal.value.exit_code == 4
    assert str(spec.model_file) in str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('mass value="2.0"', 'mass value="2.1"', "joint 'b' moves weighs 2.1 kg, to be 2"),
        ('axis xyz="0 1 0"', 'axis xyz="0 -1 0"', "joint 'b' moves is .* deg away|the axis of joint 'b'"),
        ('origin xyz="0 0 .3"', 'origin xyz="0 0 .301"', "joint 'b' moves is 0.001 m"),
        ('origin xyz="0.4 0 0" rpy', 'origin xyz="0.41 0 0" rpy', "centre of mass .* off by 0.01 m"),
        ('izz="0.02"', 'izz="0.025"', "inertia of what joint 'b' moves is off by"),
        ('origin xyz="0.25 0 0"', 'origin xyz="0.26 0 0"', "a sphere of 'l2' stands at"),
        ('sphere radius="0.05"', 'sphere radius="0.04"', "a sphere of 'l2' stands at"),
        ('box size="0.1 0.1 0.02"', 'box size="0.1 0.1 0.03"', "a box of 'foot' stands at"),
        ('name="b" type="revolute"', 'name="b" type="prismatic"', "joint 'b' is to be a hinge"),
        ('name="b" type="revolute"', 'name="c" type="revolute"', "its joints are a, c, to be a, b"),
    ],
)
def test_whatever_the_text_loses_is_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    loaded = load_arm(written(tmp_path, two("world"), mounting=WALL))
    assert old in loaded.xml
    with pytest.raises(UnsafeModelError, match=said):
        replace(loaded, xml=loaded.xml.replace(old, new)).model()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gravity": np.array([0.0, 0.0, 9.81])}, r"gravity asks .* N m of joint 'b', to be"),
        (
            {"joint_axis": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])},
            "what joint 'b' moves is .* deg away",
        ),
    ],
    ids=["gravity", "axis"],
)
def test_the_tree_that_learning_and_exports_use_is_held_against_it_too(
    change: dict[str, Any], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, whole = written(tmp_path, two("world"), mounting=LEANING), rigid_tree.tree_from_mujoco
    monkeypatch.setattr(rigid_tree, "tree_from_mujoco", lambda *given: replace(whole(*given), **change))
    with pytest.raises(UnsafeModelError, match=said):
        read_geometry(spec)


@pytest.mark.parametrize("name", ["ur5", "z1"])
def test_what_is_rehearsed_hangs_where_it_is_mounted(name: str) -> None:
    """At rest its drives carry what pinocchio says; limits far above, since the wall is no place for them."""
    spec = example(name, mounting=WALL, payload=LOAD)
    spec = replace(spec, axes=tuple(replace(axis, command=500.0) for axis in spec.axes))
    robot, judge = rehearsed(spec), Judge(spec)
    poses = np.random.default_rng(6).uniform(spec.lower, spec.upper, (4, spec.dof))
    still = np.zeros_like(poses)
    wanted = [judge.gravity(pose) for pose in poses]
    np.testing.assert_allclose(robot.inverse(poses, still, still), wanted, atol=1e-6)


GEARED = """<mujoco><worldbody><body name="u" pos="0 0 .5"><joint name="a" axis="0 1 0" range="-90 90"/>
<geom type="capsule" fromto="0 0 0 .3 0 .1" size=".04" mass="2"/><body name="f" pos=".3 0 .1">
<joint name="b" axis=".2 1 0" range="-90 90"/>
<geom type="capsule" fromto="0 0 0 .2 .05 0" size=".03" mass="1"/>
</body></body></worldbody><actuator><motor joint="a" gear="{0}" ctrlrange="-{1} {1}"/>
<motor joint="b" gear="{0}" ctrlrange="-{1} {1}"/></actuator></mujoco>"""


@pytest.mark.parametrize("gear", [1.0, 50.0, -2.0])
def test_commands_are_forces_at_the_joints_whatever_the_gear(gear: float, tmp_path: Path) -> None:
    """MuJoCo's inverse dynamics judges; limits of actuators are limits at the joints, too."""
    path = tmp_path / "geared.xml"
    path.write_text(GEARED.format(gear, 20.0 / abs(gear)))
    spec = spec_from_model(path, given={j: {"velocity": 2.0, "acceleration": 4.0} for j in "ab"}).spec
    np.testing.assert_allclose(spec.command, 20.0)
    geometry = read_geometry(spec)
    assert geometry is not None
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, 20, 2))
    model = mujoco.MjModel.from_xml_path(str(path))
    data, wanted = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, qd, qdd, strict=True):
        mujoco.mj_inverse(model, data)
        wanted.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(nominal_commands(geometry, q, qd, qdd), wanted, atol=1e-9)
