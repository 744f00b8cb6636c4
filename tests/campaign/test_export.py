"""A proposal in other formats: written once, committed, checked afterwards, refused where it does not fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign, stub_learner

from etude import ask, plugins
from etude.campaign import Campaign, Exported, open_campaign
from etude.errors import UsageError


@pytest.fixture
def lab(tmp_path: Path) -> Campaign:
    return make_campaign(tmp_path / "lab")


def exported(lab: Campaign) -> list[Exported]:
    return [e.fact for e in lab.events() if isinstance(e.fact, Exported)]


def test_a_format_is_written_certified_and_committed_once(lab: Campaign) -> None:
    found = ask(lab, formats=("ros2_yaml", "lerobot"), learner=stub_learner)
    again = ask(lab, formats=("ros2_yaml", "lerobot"), learner=stub_learner)
    assert [(e.format, e.effort) for e in exported(lab)] == [("ros2_yaml", False), ("lerobot", False)]
    assert [one.files for one in again.exported] == [one.files for one in found.exported]
    one = found.exported[0]
    assert one.certificate.ok
    assert json.loads(one.files[-1].read_text())["ok"]
    assert all(path.is_file() and path.is_relative_to(found.folder / "ros2_yaml") for path in one.files)


def test_slowed_down_the_receiver_plays_the_slowed_motion(lab: Campaign) -> None:
    full, slow = (ask(lab, formats=("ros2_csv",), speed=speed, learner=stub_learner) for speed in (100, 50))
    own = plugins.load("etude.exporters", "ros2_csv")
    played = [
        own.back({path.name: path.read_bytes() for path in found.exported[0].files}) for found in (full, slow)
    ]
    t = np.linspace(0.0, full.duration, 50)
    np.testing.assert_allclose(
        played[1].motion(2.0 * t, 1).orders[0], played[0].motion(t, 1).orders[0], atol=1e-6
    )


def test_a_file_that_was_changed_is_not_presented(lab: Campaign) -> None:
    found = ask(lab, formats=("ros2_csv",), learner=stub_learner)
    path = found.exported[0].files[0]
    path.write_text(path.read_text().replace("0.1", "0.2"))
    with pytest.raises(UsageError, match=r"points.csv was changed") as problem:
        ask(lab, formats=("ros2_csv",), learner=stub_learner)
    assert "Do not run it" in problem.value.next_step


def test_files_that_were_deleted_are_written_again(lab: Campaign) -> None:
    found = ask(lab, formats=("ros2_csv",), learner=stub_learner)
    before = [path.read_bytes() for path in found.exported[0].files]
    for path in found.exported[0].files:
        path.unlink()
    again = ask(lab, formats=("ros2_csv",), learner=stub_learner)
    assert [path.read_bytes() for path in again.exported[0].files] == before
    assert len(exported(lab)) == 2


@pytest.mark.parametrize("name", ["ros", "px4", "crazyflie", "urscript", "urscript_cb"])
def test_a_format_that_does_not_fit_is_refused_before_any_design(lab: Campaign, name: str) -> None:
    with pytest.raises(UsageError):
        ask(lab, formats=("ros2_yaml", name), learner=stub_learner)
    assert not exported(lab)
    assert not lab.state().proposals


def test_an_effort_that_is_no_force_is_refused_before_any_design(lab: Campaign) -> None:
    robot = lab.path / "robot.toml"
    robot.write_text(robot.read_text().replace('"N m"', '"A"'))
    with pytest.raises(UsageError, match=r"commands of 'pair' are in A"):
        ask(open_campaign(lab.path), formats=("ros2_yaml",), effort=True, learner=stub_learner)


def test_an_effort_needs_a_model(lab: Campaign) -> None:
    with pytest.raises(UsageError, match="there is no model yet"):
        ask(lab, formats=("ros2_yaml",), effort=True, learner=stub_learner)
    assert not exported(lab)
