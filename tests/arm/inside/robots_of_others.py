"""Robots that nobody here made, by a short name: their files, and which of their joints are the arm."""

from __future__ import annotations

from pathlib import Path

from loading_examples import bullet_robot, example_robot

from etude.campaign import Campaign, RobotPart, create_campaign, open_campaign
from etude_arm import ArmSpec
from etude_arm.model_file import spec_from_model

FILES: dict[str, tuple[str, tuple[str, ...]]] = {
    "panda": ("panda_description/urdf/panda.urdf", ()),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "iiwa": ("kuka_iiwa/model.urdf", ()),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ()),
    "so100": ("so_arm_description/urdf/so100.urdf", ()),
    "z1": ("z1_description/urdf/z1.urdf", ()),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ()),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", ()),
    "so101": ("so_arm_description/urdf/so101.urdf", ()),
    "xarm6": ("xarm/xarm6_robot.urdf", ()),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", ("arm_*_joint",)),
    "baxter": ("baxter_description/urdf/baxter.urdf", ("left_[sew][012]",)),
    "talos": (
        "talos_data/robots/talos_full_v2.urdf",
        ("torso_*", "arm_left_?_joint", "arm_right_?_joint"),
    ),
}
BULLET = ("iiwa", "xarm6")
"""Of pybullet; the others are of example-robot-data."""


def file_of(name: str) -> Path:
    """The robot's URDF; skips where its package is not installed."""
    file = FILES[name][0]
    return bullet_robot(file) if name in BULLET else example_robot(file)


def robot_of(name: str) -> ArmSpec:
    """The robot as its file describes it."""
    return spec_from_model(file_of(name), joints=FILES[name][1] or None).spec


def campaign_of(name: str, folder: Path, config: str = "", simulated: str = "") -> Campaign:
    """A campaign of that robot, or of a built-in one; `config` in place of its campaign.toml, and `simulated`
    the table of its stand-in."""
    file, joints = (str(file_of(name)), FILES[name][1]) if name in FILES else (name, ())
    path = create_campaign(folder / "lab", file, seed=3, part=RobotPart(joints, {}, ()))[0].path
    if config:
        (path / "campaign.toml").write_text(config)
    if simulated:
        robot = path / "robot.toml"
        robot.write_text(f"{robot.read_text()}\n[simulate]\n{simulated}\n")
    return open_campaign(path)
