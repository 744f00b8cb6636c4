"""A campaign of an arm of boxes over a floor, beside a table, with one trajectory, for pictures in space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from synthetic_campaign import DEFAULT, proposed, told

from etude.campaign import config_text
from etude.trajectories import FourierTrajectory
from etude_arm import KIND
from journal_facts import commit

LINKS = ("base", "turn", "upper", "fore")
BOXES = {
    "base": (0.2, 0.2, 0.1),
    "turn": (0.1, 0.1, 0.2),
    "upper": (0.08, 0.08, 0.4),
    "fore": (0.06, 0.1, 0.3),
}
JOINTS = (
    ("a_joint_with_a_name_that_is_as_long_as_a_phone_is_wide", "0 0 1", "0 0 0.05"),
    ("lift", "0 1 0", "0 0.1 0.2"),
    ("elbow", "0 1 0", "0 -0.1 0.4"),
)
ROBOT = """
name = "<img src=x onerror=alert(1)>"
command_unit = "N m"
rate = 100.0
model_file = "arm.urdf"
{axes}
[floor]
height = -0.05
[[box]]
name = "table </script><b>"
centre = [0.6, 0.0, 0.15]
size = [0.3, 0.5, 0.4]
[search]
home = [0.0, 0.5, 1.0]
lower = [-0.6, 0.3, 0.8]
upper = [0.6, 0.7, 1.2]
"""


def urdf() -> str:
    """Four links of one box each, on three hinges."""
    links = []
    for name, (x, y, z) in BOXES.items():
        middle = 0.0 if name == "base" else 0.5 * z
        shape = f'<origin xyz="0 0 {middle}"/><geometry><box size="{x} {y} {z}"/></geometry>'
        inertial = (
            f'<inertial><origin xyz="0 0 {middle}"/><mass value="2"/>'
            '<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
        )
        links.append(f'<link name="{name}">{inertial}<collision>{shape}</collision></link>')
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="{LINKS[j]}"/><child link="{LINKS[j + 1]}"/>'
        f'<origin xyz="{place}" rpy="0 0 {0.1 * j}"/><axis xyz="{axis}"/>'
        '<limit lower="-1.5" upper="1.5" velocity="1.5" effort="100"/></joint>'
        for j, (name, axis, place) in enumerate(JOINTS)
    ]
    return f'<robot name="boxes">{"".join([*links, *joints])}</robot>'


def write_space(folder: Path, *, ran: bool = False) -> FourierTrajectory:
    """The folder of the campaign, and what was asked for; with the log of it."""
    axes = "".join(
        f'[[axis]]\nname = "{name}"\nlower = -1.5\nupper = 1.5\nvelocity = 1.5\nacceleration = 3.0\n'
        "command = 100.0\n"
        for name, _, _ in JOINTS
    )
    (folder / "arm.urdf").write_text(urdf())
    (folder / "robot.toml").write_text(ROBOT.format(axes=axes))
    (folder / "campaign.toml").write_text(config_text(DEFAULT, KIND))
    commit(folder, "created", None, "0" * 64, [], seed=3)
    robot, rng = KIND.spec(folder / "robot.toml"), np.random.default_rng(1)
    trajectory = proposed(folder, robot, 1, 1)
    if ran:
        told(folder, robot, trajectory, 1, rng)
    return trajectory
