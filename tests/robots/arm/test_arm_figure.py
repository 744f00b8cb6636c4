"""The figure of sticks stands where MuJoCo has the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rehearsal_examples import ARM, spec_of
from robots_of_others import robot_of

from etude.robots.arm.kind import KIND
from etude.robots.arm.loading.load import load_arm


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
