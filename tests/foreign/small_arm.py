"""A description of an arm of three joints, and campaigns of it that cost a few seconds."""

from __future__ import annotations

from pathlib import Path

from etude.campaign import Campaign, create_campaign, open_campaign

LINK = """<link name="{name}"><inertial><origin xyz="{x} 0 {z}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/>
<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/></joint>"""
URDF = "".join(
    [
        '<robot name="three"><link name="base"/>',
        LINK.format(name="column", x=0, z=0.1, mass=3.0, i=0.02),
        LINK.format(name="upper", x=0.2, z=0, mass=2.5, i=0.03),
        LINK.format(name="fore", x=0.15, z=0.02, mass=1.5, i=0.012),
        JOINT.format(
            name="turn", parent="base", child="column", x=0, z=0.2, axis="0 0 1",
            lower=-2.5, upper=2.5, velocity=2.0, effort=40,
        ),
        JOINT.format(
            name="lift", parent="column", child="upper", x=0, z=0.2, axis="0 1 0",
            lower=-1.6, upper=1.6, velocity=1.5, effort=60,
        ),
        JOINT.format(
            name="bend", parent="upper", child="fore", x=0.4, z=0, axis="0 1 0",
            lower=-2.0, upper=2.0, velocity=2.0, effort=30,
        ),
        "</robot>",
    ]
)  # fmt: skip
QUICK = """\
kind = "arm"
preset = "default"
seed = {seed}
[trajectory]
duration = {duration}
[design]
candidates = 4
refine = 1
steps = 3
points = 20
reference_points = 30
[model]
candidates = ["default"]
steps = 8
"""


def campaign_of_small_arm(folder: Path, duration: float = 24.0, seed: int = 0) -> Campaign:
    """A campaign of the arm whose designs take a second."""
    file = folder / "three.urdf"
    file.write_text(URDF)
    path = create_campaign(folder / "lab", str(file), seed=seed)[0].path
    (path / "campaign.toml").write_text(QUICK.format(seed=seed, duration=duration))
    return open_campaign(path)
