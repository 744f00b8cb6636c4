"""Small robots with shapes: random chains, and a planar arm of three that can reach itself and the floor."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from etude_arm import ArmSpec, Axis
from etude_arm.clearance.clearance_limit import Clearance
from etude_arm.clearance.distances import Gaps
from etude_arm.clearance.pairs import gaps_of
from etude_arm.clearance.surroundings import Surroundings
from etude_arm.loading.loaded_model import Loaded

REACH = 2.8
NAMES = ("j1", "j2", "j3")
PLANAR = """<mujoco model="planar"><compiler angle="radian"/>
<default><joint axis="0 1 0" range="-2.8 2.8"/></default><worldbody>
<geom name="base#0" type="box" size=".1 .1 .1" pos="0 0 .1"/>
<body name="upper" pos="0 0 .3"><joint name="j1"/>
<geom name="upper#0" type="capsule" size=".04" fromto="0 0 0 0 0 .3"/>
<body name="fore" pos="0 0 .3"><joint name="j2"/>
<geom name="fore#0" type="capsule" size=".03" fromto="0 0 .05 0 0 .3"/>
<body name="hand" pos="0 0 .3"><joint name="j3"/>
<geom name="hand#0" type="box" size=".05 .05 .1" pos="0 0 .12"/>
</body></body></body></worldbody></mujoco>"""


def planar(around: Surroundings | None = None) -> Gaps:
    """The planar arm among what stands around it."""
    limit = np.full(3, REACH)
    return gaps_of(Loaded(PLANAR, {}, NAMES), -limit, limit, around or Surroundings())


def clearance(gaps: Gaps, **changed: object) -> Clearance:
    """Of the planar arm; upright is home."""
    k = len(gaps.skeleton.joints)
    given = {"names": NAMES, "home": np.zeros(k), "margin": 0.01, "lower": -np.ones(k), "upper": np.ones(k)}
    return Clearance(gaps, **(given | changed))  # type: ignore[arg-type]


def planar_spec(folder: Path, around: Surroundings | None = None, xml: str = PLANAR) -> ArmSpec:
    """The planar arm as a robot file would have it."""
    path = folder / "planar.xml"
    path.write_text(xml)
    axes = tuple(Axis(name, -REACH, REACH, 2.0, 4.0, 10.0) for name in NAMES)
    return ArmSpec("planar", axes, "N m", 100.0, path, around=around or Surroundings())


def random_chain(rng: np.random.Generator, joints: int) -> Loaded:
    """Bodies one after the other at random places, hinges and slides, each with a box and a capsule."""
    text = '<geom name="b0#0" type="box" size=".1 .1 .1"/>'
    close = ""
    for i in range(1, joints + 1):
        at, axis, box, tip = rng.uniform(-0.3, 0.3, (4, 3))
        size = rng.uniform(0.02, 0.15, 3)
        kind = "slide" if rng.random() < 0.2 else "hinge"
        turn = rng.standard_normal(4)
        text += (
            f'<body name="b{i}" pos="{_text(at)}" quat="{_text(turn)}">'
            f'<joint name="j{i}" type="{kind}" axis="{_text(axis)}"/>'
            f'<geom name="b{i}#0" type="box" size="{_text(size)}" pos="{_text(box)}" quat="{_text(turn)}"/>'
            f'<geom name="b{i}#1" type="capsule" size="{size[0]:g}" fromto="0 0 0 {_text(tip)}"/>'
        )
        close += "</body>"
    xml = f"<mujoco><worldbody>{text}{close}</worldbody></mujoco>"
    return Loaded(xml, {}, tuple(f"j{i}" for i in range(1, joints + 1)))


def _text(values: np.ndarray) -> str:
    return " ".join(f"{x:.6f}" for x in values)
