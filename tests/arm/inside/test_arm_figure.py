"""The figure of sticks stands where MuJoCo has the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rehearsal_examples import ARM, spec_of
from robots_of_others import robot_of

from etude.types import Figure, Thing
from etude_arm import KIND
from etude_arm.clearance.surroundings import Box, Column, Floor, Room, Surroundings, Wall
from etude_arm.loading.attachments import Attached, Mounting
from etude_arm.loading.load import load_arm


def test_joints_and_tips_are_where_mujoco_has_them() -> None:
    spec = robot_of("tiago")
    q = np.random.default_rng(0).uniform(spec.lower, spec.upper, (5, spec.dof))
    drawn = KIND.figure(spec, q)
    body = load_arm(spec, shapes=False).spec()
    body.compiler.fusestatic = 0
    model = body.compile()
    data = mujoco.MjData(model)
    for k in range(5):
        data.qpos[:] = q[k]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(drawn.points[k, 0], 0.0)
        np.testing.assert_allclose(drawn.points[k, 1 : 1 + spec.dof], data.xanchor, atol=1e-9)
        frames = np.array(data.xpos)
        assert np.linalg.norm(frames - drawn.points[k, drawn.tips[0]], axis=1).min() < 1e-9
    assert drawn.sticks.tolist() == [[i, i + 1] for i in range(8)]


def test_a_stretched_arm_is_as_long_as_its_links(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, ARM, rate=100.0, unit="N m", command=60.0)
    drawn = KIND.figure(spec, np.array([[0.0, 0.0, 0.2], [np.pi / 2, 0.0, 0.2]]))
    np.testing.assert_allclose(drawn.points[0, drawn.tips[0]], [0.1 + 0.4 + 0.2, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(drawn.points[1, drawn.tips[0]], [0.0, 0.7, 0.0], atol=1e-12)


def test_two_arms_have_two_tips() -> None:
    spec = robot_of("talos")
    drawn = KIND.figure(spec, np.zeros((1, spec.dof)))
    assert len(drawn.tips) == 2
    left, right = (drawn.points[0, tip] for tip in drawn.tips)
    np.testing.assert_allclose(left * [1, -1, 1], right, atol=0.1)
    assert left[1] > 0.1
    # both arms begin at the torso
    assert [a for a, _ in drawn.sticks.tolist()].count(2) == 2


def test_without_a_model_file_there_is_nothing_to_draw() -> None:
    spec = KIND.spec(KIND.built_in()["arm4"])
    assert KIND.figure(spec, np.zeros((1, 4))).points.shape == (1, 6, 3)
    assert KIND.figure(replace(spec, model_file=None), np.zeros((1, 4))) is None


@pytest.mark.parametrize("name", ["arm4_rough", "mobile_arm"])
def test_built_in_robots_are_drawn(name: str) -> None:
    spec = KIND.spec(KIND.built_in()[name])
    drawn = KIND.figure(spec, KIND.home(spec)[None])
    assert np.ptp(drawn.points[0], axis=0).max() > 0.5


def thing(figure: Figure, name: str) -> Thing:
    return next(one for one in figure.things if one.name == name)


def test_what_the_robot_file_names_is_drawn_where_it_stands(tmp_path: Path) -> None:
    around = Surroundings(
        floor=Floor(-0.1),
        box=(Box("table", (0.6, 0.2, 0.3), (0.4, 0.8, 0.2), np.pi / 2),),
        wall=(Wall("fence", (1.5, 7.0, 3.0), (-2.0, 0.0, 0.0)),),
        room=Room((-1.0, -2.0, -3.0), (1.0, 2.0, 3.0)),
        column=Column(1.2, (0.1, 0.2)),
    )
    spec = replace(spec_of(tmp_path, ARM, rate=100.0, unit="N m", command=60.0), around=around)
    drawn = KIND.figure(spec, np.zeros((2, 3)))
    assert [(one.name, one.kind) for one in drawn.things] == [
        ("floor", "plane"),
        ("fence", "plane"),
        ("table", "solid"),
        ("room", "inside"),
        ("column", "inside"),
        ("base, 0.1 m up", "stand"),
    ]
    low, high = (getattr(thing(drawn, "table").points[0], end)(axis=0) for end in ("min", "max"))
    np.testing.assert_allclose([low, high], [[0.2, 0.0, 0.2], [1.0, 0.4, 0.4]], atol=1e-12)
    np.testing.assert_allclose(thing(drawn, "floor").points[0, :, 2], -0.1, atol=1e-12)
    np.testing.assert_allclose(thing(drawn, "fence").points[0, :, 0], 1.5, atol=1e-12)
    np.testing.assert_allclose(thing(drawn, "room").points[0].max(axis=0), [1.0, 2.0, 3.0])
    away = thing(drawn, "column").points[0, :, :2] - [0.1, 0.2]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.2)
    assert KIND.figure(replace(spec, around=Surroundings()), np.zeros((1, 3))).things == ()


@pytest.mark.parametrize("taken", ["tool", "powertool"])
def test_what_it_carries_goes_along_also_where_a_link_has_its_name(tmp_path: Path, taken: str) -> None:
    stick = '<collision><geometry><box size="9 9 9"/></geometry></collision></link>'
    text = ARM.replace('"table"', f'"{taken}"').replace("</link>", stick, 2)
    tool = Attached(mass=0.1, centre=(0.2, 0.0, 0.0), shape="box", size=(0.2, 0.04, 0.06))
    spec = replace(spec_of(tmp_path, text, rate=100.0, unit="N m", command=60.0), tool=tool)
    drawn = KIND.figure(spec, np.array([[0.0, 0.0, 0.2], [np.pi / 2, 0.0, 0.2]]))
    carried = thing(drawn, "tool")
    assert carried.kind == "carried"
    corners = np.stack([carried.points.min(axis=1), carried.points.max(axis=1)], axis=1)
    np.testing.assert_allclose(corners[0], [[0.8, -0.02, -0.03], [1.0, 0.02, 0.03]], atol=1e-12)
    np.testing.assert_allclose(corners[1], [[-0.02, 0.8, -0.03], [0.02, 1.0, 0.03]], atol=1e-12)


def test_a_tool_in_an_mjcf_with_a_body_of_that_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="tool"><joint name="turn" axis="0 0 1"/><geom size=".1" mass="1"/>'
        '<body name="fore" pos="1 0 0"><joint name="lift" axis="0 1 0"/><geom size=".1" mass="1"/></body>'
        "</body></worldbody></mujoco>"
    )
    spec = spec_of(tmp_path, ARM, rate=100.0, unit="N m", command=60.0)
    tool = Attached(mass=0.1, centre=(0.5, 0.0, 0.0), shape="sphere", size=(0.05,))
    drawn = KIND.figure(replace(spec, axes=spec.axes[:2], model_file=path, tool=tool), np.zeros((1, 2)))
    centre = thing(drawn, "tool").points[0].mean(axis=0)
    np.testing.assert_allclose(centre, [1.5, 0.0, 0.0], atol=1e-12)


def test_a_mounted_base_stands_above_the_floor(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, ARM, rate=100.0, unit="N m", command=60.0)
    mounted = replace(spec, mounting=Mounting((0.3, 0.1, 0.8)), around=Surroundings(floor=Floor(0.2)))
    drawn = KIND.figure(mounted, np.zeros((1, 3)))
    np.testing.assert_allclose(thing(drawn, "base, 0.6 m up").points[0], [[0.3, 0.1, 0.8], [0.3, 0.1, 0.2]])
    np.testing.assert_allclose(drawn.points[0, 0], [0.3, 0.1, 0.8])
