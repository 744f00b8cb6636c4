"""Makes ur10.urdf, a rigid-body model without meshes, from published figures: python make_urdf.py.

Kinematics, masses and centres of mass: Universal Robots, "DH Parameters for calculations of kinematics and
dynamics" (support article), UR10. Inertias are not published there: each link is a homogeneous cylinder of
the radius and length below along its longest side, good enough as a starting point for identification.
Limits: UR10 technical data (120 deg/s for joints 1 and 2, 180 deg/s for the others) and the maximum torques
of the joints (330, 330, 150, 56, 56, 56 N m).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin
from pathlib import Path


@dataclass(frozen=True)
class Link:
    """One row of the DH table (m, rad) with the dynamics of its link (kg, m) and its joint's limits."""

    joint: str
    a: float
    d: float
    alpha: float
    mass: float
    centre: tuple[float, float, float]  # in the DH frame at the link's end
    radius: float
    length: float
    along: str  # axis of the cylinder in the DH frame
    speed: float  # deg/s
    torque: float  # N m


LINKS = (
    Link("shoulder_pan_joint", 0.0, 0.1273, pi / 2, 7.1, (0.021, 0.0, 0.027), 0.075, 0.18, "y", 120, 330),
    Link("shoulder_lift_joint", -0.612, 0.0, 0.0, 12.7, (0.38, 0.0, 0.158), 0.075, 0.612, "x", 120, 330),
    Link("elbow_joint", -0.5723, 0.0, 0.0, 4.27, (0.24, 0.0, 0.068), 0.06, 0.572, "x", 180, 150),
    Link("wrist_1_joint", 0.0, 0.163941, pi / 2, 2.0, (0.0, 0.007, 0.018), 0.045, 0.12, "z", 180, 56),
    Link("wrist_2_joint", 0.0, 0.1157, -pi / 2, 2.0, (0.0, 0.007, 0.018), 0.045, 0.12, "z", 180, 56),
    Link("wrist_3_joint", 0.0, 0.0922, 0.0, 0.365, (0.0, 0.0, -0.026), 0.037, 0.04, "z", 180, 56),
)


def inertia(link: Link) -> tuple[float, float, float]:
    """Principal inertias about x, y, z of the link's cylinder."""
    axial = 0.5 * link.mass * link.radius**2
    across = link.mass * (3 * link.radius**2 + link.length**2) / 12
    x, y, z = (axial if axis == link.along else across for axis in "xyz")
    return x, y, z


def link_text(number: int, link: Link) -> str:
    """The link's inertial, moved from its DH frame to the URDF frame, which stands at the joint."""
    x, y, z = link.centre
    c, s = cos(link.alpha), sin(link.alpha)
    centre = (link.a + x, c * y - s * z, link.d + s * y + c * z)
    ixx, iyy, izz = inertia(link)
    return f"""  <link name="link_{number}">
    <inertial>
      <origin xyz="{centre[0]:.6f} {centre[1]:.6f} {centre[2]:.6f}" rpy="{link.alpha:.9f} 0 0"/>
      <mass value="{link.mass}"/>
      <inertia ixx="{ixx:.6f}" iyy="{iyy:.6f}" izz="{izz:.6f}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
"""


def joint_text(number: int, link: Link, before: Link | None) -> str:
    """The joint about the z axis of the DH frame before it."""
    a, d, alpha = (before.a, before.d, before.alpha) if before else (0.0, 0.0, 0.0)
    turn, speed = 2 * pi, radians(link.speed)
    return f"""  <joint name="{link.joint}" type="revolute">
    <parent link="link_{number - 1}"/>
    <child link="link_{number}"/>
    <origin xyz="{a} 0 {d}" rpy="{alpha:.9f} 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="{-turn:.6f}" upper="{turn:.6f}" velocity="{speed:.6f}" effort="{link.torque}"/>
  </joint>
"""


def urdf() -> str:
    """The whole file."""
    parts = ['<?xml version="1.0"?>\n<!-- Made by make_urdf.py. -->\n<robot name="ur10">\n']
    parts.append('  <link name="link_0"/>\n')
    for number, link in enumerate(LINKS, 1):
        parts.append(link_text(number, link))
        parts.append(joint_text(number, link, LINKS[number - 2] if number > 1 else None))
    return "".join(parts) + "</robot>\n"


if __name__ == "__main__":
    Path(__file__).with_name("ur10.urdf").write_text(urdf(), encoding="utf-8")
