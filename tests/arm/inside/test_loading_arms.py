"""Arms that nobody here has made: from the file to a model with collision shapes; -s prints the table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from loading_examples import bullet_robot, example_robot

from etude.errors import UsageError
from etude_arm import KIND
from etude_arm.loading.load import load


@dataclass(frozen=True)
class Arm:
    """A file of a package, what to choose of it, and the numbers of joints, geoms and meshes to come."""

    file: str
    counts: tuple[int, int, int]
    joints: tuple[str, ...] | None = None
    bullet: bool = False

    def path(self) -> Path:
        return bullet_robot(self.file) if self.bullet else example_robot(self.file)


PR2 = ("r_shoulder_*_joint", "r_upper_arm_roll_joint", "r_elbow_flex_joint", "r_forearm_roll_joint")
ARMS = (
    Arm("panda_description/urdf/panda.urdf", (7, 17, 9)),
    Arm("panda_description/urdf/panda_collision.urdf", (7, 39, 0)),
    Arm("franka_panda/panda.urdf", (7, 11, 11), bullet=True),
    Arm("ur_description/urdf/ur3_robot.urdf", (6, 8, 7)),
    Arm("ur_description/urdf/ur5_robot.urdf", (6, 8, 7)),
    Arm("ur_description/urdf/ur10_robot.urdf", (6, 8, 7)),
    Arm("ur_description/urdf/ur5_joint_limited_robot.urdf", (6, 8, 7)),
    Arm("ur_description/urdf/ur5_gripper.urdf", (6, 11, 7)),
    Arm("kinova_description/robots/kinova.urdf", (6, 11, 11)),
    Arm("xarm_description/urdf/xarm7.urdf", (7, 8, 8)),
    Arm("xarm/xarm6_robot.urdf", (6, 7, 7), bullet=True),
    Arm("xarm/xarm6_with_gripper.urdf", (6, 14, 14), bullet=True),
    Arm("kuka_iiwa/model.urdf", (7, 8, 8), bullet=True),
    Arm("z1_description/urdf/z1.urdf", (6, 12, 4)),
    Arm("so_arm_description/urdf/so100.urdf", (5, 8, 8)),
    Arm("so_arm_description/urdf/so101.urdf", (5, 17, 17)),
    Arm("tiago_description/robots/tiago_no_hand.urdf", (7, 26, 12), ("arm_*_joint",)),
    Arm("tiago_description/robots/tiago.urdf", (7, 64, 32), ("arm_*_joint",)),
    Arm("tiago_description/robots/tiago_dual.urdf", (7, 112, 59), ("arm_left_*_joint",)),
    Arm("tiago_pro_description/robots/tiago_pro.urdf", (7, 51, 38), ("arm_left_*_joint",)),
    Arm("talos_data/robots/talos_left_arm.urdf", (6, 17, 15)),
    Arm("talos_data/robots/talos_full_v2.urdf", (7, 52, 47), ("arm_left_*_joint",)),
    Arm("baxter_description/urdf/baxter.urdf", (7, 41, 2), ("left_[sew]?",)),
    Arm("pr2_description/urdf/pr2.urdf", (7, 32, 31), (*PR2, "r_wrist_*_joint")),
    Arm("centauro_description/urdf/centauro.urdf", (6, 45, 39), ("j_arm1_*",)),
    Arm("romeo_description/urdf/romeo.urdf", (7, 44, 44), ("LShoulder*", "LElbow*", "LWrist*")),
    Arm("icub_description/robots/icub.urdf", (7, 28, 28), ("l_shoulder*", "l_elbow", "l_wrist*")),
    Arm(
        "alex_description/urdf/alex_nub_hands.urdf",
        (7, 22, 22),
        ("LeftShoulder*", "LeftElbow*", "LeftWrist*", "LeftGripperYaw"),
    ),
    Arm("anymal_b_simple_description/robots/anymal-kinova.urdf", (6, 54, 11), ("j2s6s200_joint_?",)),
    Arm("b1_description/urdf/b1-z1.urdf", (6, 42, 4), ("joint?",)),
    Arm(
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        (7, 36, 24),
        ("left_shoulder*", "left_elbow*", "left_wrist*"),
    ),
)
LEGGED = (
    "a1_description/urdf/a1.urdf",
    "anymal_b_simple_description/robots/anymal.urdf",
    "go1_description/urdf/go1.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
    "solo_description/robots/solo12.urdf",
    "bolt_description/robots/bolt.urdf",
    "icub_description/robots/icub.urdf",
    "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "baxter_description/urdf/baxter.urdf",
    "allegro_hand_description/urdf/allegro_left_hand.urdf",
)


def check(arm: Arm) -> None:
    loaded = load(arm.path(), arm.joints)
    model = loaded.model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = [model.geom(g).name for g in range(model.ngeom)]
    assert (model.njnt, model.ngeom, len(loaded.assets)) == arm.counts
    assert set(loaded.joints) == {model.joint(j).name for j in range(model.njnt)}
    assert model.nbody == model.njnt + 1  # every part that moves is one body
    assert all("#" in name for name in names)
    assert len(set(names)) == len(names)
    assert not any("missing" in sentence or "guessed" in sentence for sentence in loaded.unverified)
    assert np.all(np.isfinite(data.qfrc_bias))
    repairs = sum("repaired" in note for note in loaded.notes)
    counts = f"{model.njnt} joints, {model.ngeom:3d} shapes, {len(loaded.assets):2d} of them meshes"
    print(f"{Path(arm.file).stem:24s} {counts}, {len(loaded.held):2d} joints held, repairs: {repairs}")


def test_an_arm_of_a_package_loads_with_its_collision_shapes() -> None:
    check(ARMS[0])


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.file)
def test_every_arm_loads_with_its_collision_shapes(arm: Arm) -> None:
    check(arm)


@pytest.mark.parametrize("name", LEGGED[:1])
def test_a_robot_on_legs_is_refused_with_its_limbs(name: str) -> None:
    with pytest.raises(UsageError, match=r"several limbs begin at the base: .* and \d more.*--joints"):
        load(example_robot(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", LEGGED[1:])
def test_every_robot_on_legs_is_refused_with_its_limbs(name: str) -> None:
    test_a_robot_on_legs_is_refused_with_its_limbs(name)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("hector_description/robots/quadrotor_base.urdf", "no arm: nothing in the file moves"),
        ("iris_description/robots/iris.urdf", "no arm.*iris__rotor_0_joint"),
        ("ur_description/urdf/ur3.urdf", "describes no link"),
        (
            "tiago_description/robots/tiago_no_hand.urdf",
            "several limbs begin after joint 'torso_lift_joint': head",
        ),
    ],
)
def test_what_is_no_arm_says_why(name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        load(example_robot(name))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["tiago_description/robots/tiago_no_hand.urdf", "panda_description/urdf/panda.urdf"]
)
def test_a_campaigns_copy_is_the_robot(name: str, tmp_path: Path) -> None:
    """What `etude init` writes loads, away from the package, to the same shapes at the same places."""
    from etude_arm.loading.load import load_arm

    joints = ("arm_*_joint",) if "tiago" in name else ()
    described = KIND.chosen(example_robot(name), joints, {}, (), {})
    for file, data in described.files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(data)
    copy = load_arm(KIND.spec(tmp_path / "robot.toml")).model()
    model = load(example_robot(name), joints or None).model()
    assert [copy.geom(g).name for g in range(copy.ngeom)] == [model.geom(g).name for g in range(model.ngeom)]
    one, other = mujoco.MjData(copy), mujoco.MjData(model)
    for each, data in ((copy, one), (model, other)):
        data.qpos[:] = 0.3
        mujoco.mj_forward(each, data)
    np.testing.assert_allclose(one.geom_xpos, other.geom_xpos, atol=1e-6)
    np.testing.assert_allclose(one.qfrc_bias, other.qfrc_bias, rtol=1e-9)


@pytest.mark.slow
def test_bent_links_that_touch_often_are_cut_and_touch_less(tmp_path: Path) -> None:
    """A UR5's forearm and upper arm: of random poses half as many overlap, and none that did not before."""
    from etude_arm.loading.load import load_arm

    path = example_robot("ur_description/urdf/ur5_robot.urdf")
    described = KIND.described(path)
    for file, data in described.files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(data)
    spec = KIND.spec(tmp_path / "robot.toml")
    poses = np.random.default_rng(1).uniform(spec.lower, spec.upper, (200, spec.dof))
    before = overlaps(load(path).model(), poses)
    cut = load_arm(spec).model()
    after = overlaps(cut, poses)
    assert {name for name in map(link_of, range(cut.ngeom), [cut] * cut.ngeom) if name[1] > 1} == {
        ("upper_arm_link", 4),
        ("forearm_link", 4),
    }
    assert before.mean() > 0.45
    assert after.mean() < 0.33
    assert not np.any(after & ~before)


def link_of(g: int, model: mujoco.MjModel) -> tuple[str, int]:
    """The link of a geom, and how many shapes it has."""
    links = [model.geom(k).name.rpartition("#")[0] for k in range(model.ngeom)]
    return links[g], links.count(links[g])


def overlaps(model: mujoco.MjModel, poses: np.ndarray) -> np.ndarray:
    """Whether any two shapes overlap, but for those of neighbours."""
    from etude_arm.loading.overlapping_links import REACH, _pairs

    data, pairs, found = mujoco.MjData(model), list(_pairs(model)), []
    for q in poses:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        found.append(any(mujoco.mj_geomDistance(model, data, a, b, REACH, None) < 0 for a, b in pairs))
    return np.array(found)
