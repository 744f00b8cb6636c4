"""What hangs at the hand, by one log: mass and centre with intervals, or that it cannot be told."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from small_robot import random_motion
from test_changed_load import arm, saved, written

from etude import ask, tell
from etude.campaign import Campaign, ask_to_weigh, open_campaign, stored_trajectory
from etude.campaign.deployment.payload import payload
from etude.campaign.ingest.questions import body_of
from etude.cli import main
from etude.errors import DataError, UsageError
from etude.models import about_origin
from etude.protocols import Trajectory
from etude.types import Log

KG, CENTRE = 1.5, np.array([0.12, 0.03, 0.05])


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("payload")
    campaign = arm(folder)
    for seed in (1, 2):
        log = written(folder / f"{seed}.csv", campaign, random_motion(campaign, seed), seed=seed)
        tell(campaign, log, foreign=True)
    return campaign


def carrying(
    path: Path,
    campaign: Campaign,
    motion: Trajectory,
    kg: float,
    lasting: float = 30.0,
) -> Path:
    """A log of so many seconds."""
    t = np.arange(0.0, lasting, 0.02)
    orders = motion.motion(t % motion.duration, 3).orders
    states = Log(t, {}, {}, "states")
    for channel, values in zip(campaign.channels, orders, strict=False):
        states = states.put(channel, values)
    body = body_of(campaign.kind, campaign.spec)
    assert body is not None
    ten = np.concatenate([[kg], kg * CENTRE, about_origin(kg, kg * CENTRE)])
    load = body.links(states)[:, :, -1] @ ten  # type: ignore[attr-defined]
    friction = np.array([3.0, 4.0, 2.0]) * np.tanh(orders[1] / 0.05)
    return saved(path, t, orders[0], body.predict(states) + load + friction, seed=9)


@pytest.mark.slow
def test_it_is_written_once_and_added_to_what_was_there(
    lab: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(lab.path, tmp_path / "lab")
    log = carrying(tmp_path / "run.csv", lab, random_motion(lab, 5), KG)
    found = payload(lab, log)
    assert f"{found.load.mass:.3g} kg +- " in found.notes[0]
    assert "y cannot be determined" in found.notes[1], "no axis of the arm turns the load's y up"
    assert found.written is None
    words = ["payload", str(tmp_path / "lab"), "--log", str(log)]
    assert main([*words, "--write", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "load"
    assert data["mass_lower"] < KG < data["mass_upper"]
    stated = tomllib.loads((tmp_path / "lab" / "robot.toml").read_text())["payload"]
    assert stated["mass"] == pytest.approx(data["mass"])
    np.testing.assert_allclose(stated["centre"], data["centre"])
    spec = open_campaign(tmp_path / "lab").spec
    assert spec.payload.mass == pytest.approx(KG, rel=0.1)
    with pytest.raises(UsageError, match=r"the payload in robot\.toml differs"):
        payload(open_campaign(tmp_path / "lab"), log, write=True)
    assert tomllib.loads((tmp_path / "lab" / "robot.toml").read_text())["payload"] == stated


@pytest.mark.slow
def test_the_motion_that_is_asked_for_shows_most(
    lab: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is proved, told to nobody, open until another is asked for, and better than random ones."""
    shutil.copytree(lab.path, tmp_path / "lab")
    own = open_campaign(tmp_path / "lab")
    before = len(own.state().proposals)
    asked = ask_to_weigh(own)
    assert asked.certificate.ok
    assert asked.certificate.at_rest
    assert asked.duration == pytest.approx(10.0, abs=0.5)
    assert len(own.state().proposals) == before, "a plain ask must not take it for its own"
    again = ask_to_weigh(open_campaign(own.path))
    assert (again.number, again.new) == (asked.number, False)
    motion = stored_trajectory(own, asked.number)
    log = carrying(tmp_path / "run.csv", own, motion, KG, motion.duration)
    found = payload(own, log)
    designed = found.load
    assert not any("etude ask" in sentence for sentence in found.notes), "it was just recorded"
    assert "This log is of the motion that identifies the payload best." in found.notes, "y cannot be told"
    assert abs(designed.mass - KG) < 2.5 * designed.deviation
    random = [
        payload(own, carrying(tmp_path / "random.csv", own, random_motion(own, seed), KG, 10.0)).load
        for seed in range(11, 16)
    ]
    assert designed.deviation < np.median([one.deviation for one in random])
    size = [np.linalg.norm(one.centre_deviation[[0, 2]]) for one in (designed, *random)]
    assert size[0] < np.median(size[1:])
    assert main(["ask", str(own.path), "--payload", "--speed", "50"]) == 0
    said = capsys.readouterr().out
    assert f"etude payload {own.path} --log LOG" in said
    assert "mass +- " in said or "still open" in said
    with pytest.raises(DataError, match="a payload motion that is never used for training"):
        tell(own, log)
    with pytest.raises(UsageError, match="a payload motion, which is never used"):
        tell(own, log, number=asked.number)
    assert ask(own).number == asked.number + 1


@pytest.mark.slow
def test_a_log_of_another_robot_is_no_load(lab: Campaign, tmp_path: Path) -> None:
    """Links and friction differ by more than a load and warm drives explain."""
    motion = random_motion(lab, 5)
    log = carrying(tmp_path / "own.csv", lab, motion, 0.0)
    assert not any("more than a load has changed" in sentence for sentence in payload(lab, log).notes)
    rows = np.genfromtxt(log, delimiter=",", names=True)
    names = list(rows.dtype.names)
    commands = [name for name in names if name.startswith(("tau", "command"))]
    assert len(commands) == 3
    for name, factor in zip(commands, (2.5, 0.4, 2.5), strict=True):
        rows[name] *= factor
    table = np.array([rows[name] for name in names]).T
    other = tmp_path / "other.csv"
    np.savetxt(other, table, "%.8g", ",", header=log.read_text().splitlines()[0], comments="")
    assert "more than a load has changed" in payload(lab, other).notes[-1]


def test_a_motion_that_weighs_is_for_no_task_and_has_no_effort(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ask", str(arm(tmp_path).path), "--payload", "--effort"]) == 2
    assert "takes no --tasks, --control or --effort" in capsys.readouterr().err
