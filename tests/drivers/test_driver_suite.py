"""The laws of drivers hold for robots that are there, and a driver that breaks one is noticed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mutants import laws

from etude.drivers import Player, Sample, Stream, find_driver
from etude.testing import FAULTS, DriverSuite, FakeRobot
from etude.types import Array

UR10 = Path(__file__).parents[2] / "examples" / "ur10" / "ur10.urdf"


class TestFakeRobot(DriverSuite):
    joints = ("base", "elbow")

    def driver(self) -> FakeRobot:
        return FakeRobot(self.joints, rate=125.0, start=np.array([0.4, -0.7]))


class TestMujoco(DriverSuite):
    joints = ("elbow_joint", "wrist_1_joint")

    def driver(self) -> Stream | Player:
        return find_driver(f"mujoco:{UR10},virtual", self.joints, {"start": {"elbow_joint": 0.4}})


class Wrong(DriverSuite):
    """The suite over a robot with one thing changed."""

    joints = ("base", "elbow")

    def __init__(self, **changes: object) -> None:
        self.changes = changes

    def driver(self) -> FakeRobot:
        robot = FakeRobot(self.joints, rate=100.0, start=np.array([0.4, -0.7]))
        for name, change in self.changes.items():
            setattr(robot, name, change.__get__(robot))  # type: ignore[attr-defined]
        return robot


def says(**values: object) -> object:
    return lambda self: replace(FakeRobot.about(self), **values)  # type: ignore[arg-type]


def drifts_when_asked(self: FakeRobot) -> Sample:
    self.q += 4e-3
    self._measured = self.q.copy()
    return FakeRobot.state(self)


def turned(self: FakeRobot) -> Sample:
    return replace(FakeRobot.state(self), q=self.q[::-1].copy())


def old(self: FakeRobot) -> Sample:
    sample = FakeRobot.state(self)
    return replace(sample, t=round(sample.t, 1))


def does_not_follow(self: FakeRobot, q: object, qd: object, qdd: object, effort: object) -> None:
    FakeRobot.send(self, np.array([0.4, -0.7]), np.zeros(2), np.zeros(2), None)


def stop_does_nothing(self: FakeRobot, kill: bool = False) -> None:
    pass


def stop_raises(self: FakeRobot, kill: bool = False) -> None:
    raise ConnectionError


def runs_on(self: FakeRobot, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
    FakeRobot.send(self, q, qd, qdd, effort)
    self.qd += 0.1


@pytest.mark.parametrize(
    "changes",
    [
        {"about": says(joints=("elbow", "base"))},
        {"about": says(command_of=None)},
        {"about": says(gravity_in_command=None)},
        {"about": says(identity="")},
        {"about": says(controls=())},
        {"about": says(lower=np.zeros(3))},
        {"state": drifts_when_asked},
        {"state": turned},
        {"state": old},
        {"send": does_not_follow},
        {"send": runs_on},
        {"stop": stop_raises},
        {"stop": stop_does_nothing},
    ],
)
def test_a_driver_that_breaks_a_law_is_noticed(changes: dict[str, object]) -> None:
    cheap = tuple(name for name in dir(DriverSuite) if "faults" in name)
    found = [name for name, error in laws(Wrong(**changes), cheap).items() if error is not None]
    assert found


def test_the_robot_that_they_are_made_from_breaks_none() -> None:
    cheap = tuple(name for name in dir(DriverSuite) if "faults" in name)
    assert [error for error in laws(Wrong(), cheap).values() if error] == []


def test_every_fault_has_words_and_an_end() -> None:
    for fault in FAULTS.values():
        assert fault.words
        assert fault.ends


@pytest.mark.slow  # it plays in real time
def test_the_driver_of_the_page_keeps_the_laws() -> None:
    """What somebody new writes from docs/drivers.md alone."""
    page = (Path(__file__).parents[2] / "docs" / "drivers.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec("\n".join(re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)), names)
    found = laws(names["TestMyArm"](), ("test_faults_end_as_they_have_to",))
    assert len(found) > 10
    assert {name: error for name, error in found.items() if error} == {}
