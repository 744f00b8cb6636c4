"""A torso's two arms of up to seven joints each, side by side: one robot of as many joints as are asked for.

Its links are those of `seven_joints`. It is simulated from its model file with the defaults of such a robot.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

from etude_studies.seven_joints import AXES, LIGHT, RATE, REACH
from etude_studies.world import World

MOST = 2 * len(LIGHT.links)
SHOULDER = 0.2
"""m from the middle; each arm begins pointing outwards."""


@cache
def two_arms(joints: int) -> World:
    """The robot with the first `joints` of a1 ... a7, b1 ... b7, from files as somebody would write them."""
    folder = Path(tempfile.mkdtemp(prefix="two_arms_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)  # physics read it again
    (folder / "arms.xml").write_text(mjcf(joints))
    (folder / "arms.toml").write_text(robot_toml(joints))
    return World.of(folder / "arms.toml")


def counts(joints: int) -> tuple[tuple[str, int, int], ...]:
    """Name, side and joints of each arm."""
    first = min(joints, len(LIGHT.links))
    return tuple((n, s, c) for n, s, c in (("a", 1, first), ("b", -1, joints - first)) if c)


def mjcf(joints: int) -> str:
    """Chains of rods, outwards from both shoulders; what has no joint any more is not there."""
    chains = "".join(_chain(*arm) for arm in counts(joints))
    return f'<mujoco model="two_arms"><compiler angle="radian"/><worldbody>{chains}</worldbody></mujoco>\n'


def _chain(name: str, side: int, count: int) -> str:
    opened = [f'<body name="{name}" pos="0 {side * SHOULDER} 1.2" euler="{-side * 1.5707963} 0 0">']
    for i, (length, mass, _) in enumerate(LIGHT.links[:count]):
        place = LIGHT.links[i - 1][0] if i else 0.05
        across = mass * (length**2 / 12.0 + 0.05**2 / 4.0)
        opened.append(
            f'<body name="{name}{i + 1}" pos="0 0 {place}"><joint name="{name}{i + 1}" axis="{AXES[i]}"/>'
            f'<inertial pos="0.01 0.02 {length / 2}" mass="{mass}" '
            f'diaginertia="{across} {across} {mass * 0.05**2 / 2.0}"/>'
        )
    return "".join(opened) + "</body>" * (count + 1)


def robot_toml(joints: int) -> str:
    """The robot file: limits and the model file beside it."""
    head = f'name = "two_arms"\ncommand_unit = "N m"\nrate = {RATE}\nmodel_file = "arms.xml"\n'
    axes = (
        f'[[axis]]\nname = "{name}{i + 1}"\nlower = {-REACH[i]}\nupper = {REACH[i]}\n'
        f"velocity = {LIGHT.velocity[i]}\nacceleration = {LIGHT.acceleration[i]}\n"
        f"command = {LIGHT.links[i][2]}\n"
        for name, _, count in counts(joints)
        for i in range(count)
    )
    return head + "".join(axes)
