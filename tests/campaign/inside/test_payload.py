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

from etude import tell
from etude.campaign import Campaign, open_campaign
from etude.campaign.deployment.payload import payload
from etude.campaign.ingest.questions import body_of
from etude.cli import main
from etude.errors import UsageError
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
) -> Path:
    """A log of 30 s."""
    t = np.arange(0.0, 30.0, 0.02)
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
    assert f"{found.load.mass:.3g} kg +- " in found.said[0]
    assert "y cannot be told" in found.said[1], "no axis of the arm turns the load's y up"
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
    with pytest.raises(UsageError, match="another payload"):
        payload(open_campaign(tmp_path / "lab"), log, write=True)
    assert tomllib.loads((tmp_path / "lab" / "robot.toml").read_text())["payload"] == stated
