"""A motion with the model's commands: numbers of the model, formats with effort, each proved."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from c_models import arm_model

from certificate_schema import valid
from etude import plugins
from etude.deploy import read_table
from etude.deploy.exporters.knots import EFFORT_RATE
from etude.deploy.targets.trajectory import ALONG, MotionWithLimits
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.testing import World, world

MODEL = arm_model("exact", "ard_se", points=16)


@pytest.fixture(scope="module")
def here() -> World:
    found = world(plugins.load("etude.robots", "arm"), "arm4")
    return replace(found, spec=replace(found.spec, command_unit="N m"))


def along(here: World, **options: Any) -> Any:
    own = {"motion": MotionWithLimits(here.trajectory(0), here.limits), **options}
    return ALONG(MODEL, here.kind, here.spec, own)


def test_commands_and_deviations_stand_beside_the_motion(here: World) -> None:
    found = along(here, rate=25.0)
    names, rows = read_table(found.files["commands.csv"])
    motion, joints = here.trajectory(0), here.spec.names
    t = np.minimum(np.arange(len(rows)) / 25.0, motion.duration)
    np.testing.assert_array_equal(rows[:, 0], t)
    mean, variance = MODEL.predict(MODEL.inputs.states(motion.motion(t, 3)))
    place = dict(zip(names, rows.T, strict=True))
    for j, joint in enumerate(joints):
        np.testing.assert_array_equal(place[f"command_{joint}"], mean[:, j])
        np.testing.assert_array_equal(place[f"deviation_{joint}"], np.sqrt(variance[:, j]))
        np.testing.assert_array_equal(place[f"q_{joint}"], motion.motion(t, 3).orders[0][:, j])
    assert valid(found.files["certificate.json"])["ok"]


def test_the_joint_trajectory_has_the_same_efforts(here: World) -> None:
    files = along(here).files
    text = [line for line in files["ros2_yaml/joint_trajectory.yaml"].decode().splitlines() if line[0] != "#"]
    points = json.loads("\n".join(text))["points"]
    t = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points])
    assert np.max(np.diff(t)) <= 1.0 / EFFORT_RATE + 1e-9
    states = MODEL.inputs.states(here.trajectory(0).motion(t, 3))
    np.testing.assert_allclose([p["effort"] for p in points], MODEL.predict(states)[0], rtol=1e-9, atol=1e-9)
    assert valid(files["ros2_yaml/certificate.json"])["ok"]


def test_commands_that_are_no_forces_go_into_the_table_alone(here: World) -> None:
    pwm = replace(here, spec=replace(here.spec, command_unit="pwm"))
    found = along(pwm)
    assert set(found.files) == {"trajectory.json", "commands.csv", "certificate.json"}
    assert "commands of 'arm4' are in pwm" in found.notes[1]
    with pytest.raises(UsageError, match="are in pwm"):
        along(pwm, format="ros2_csv")


def test_a_motion_outside_the_limits_is_not_written(here: World) -> None:
    fast = MotionWithLimits(here.trajectory(0).slowed(0.25), here.limits)
    with pytest.raises(UnsafeTrajectoryError):
        along(here, motion=fast)
    with pytest.raises(UsageError, match="no motion to follow"):
        ALONG(MODEL, here.kind, here.spec, {})
