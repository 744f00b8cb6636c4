"""A model that is physics alone is held against what there was before it, and can be promoted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_robot import make_campaign, random_motion, write_log
from test_foreign_flights import EXAMPLE, QUICK
from test_learning import CONFIG

from etude import promote, tell
from etude.campaign import Campaign, create_campaign, open_campaign, simulate
from etude.campaign.record.stored_models import LEFT_OUT
from etude.models import read_residuals

pytestmark = pytest.mark.as_logged


def configured(path: Path, changes: dict[str, str]) -> Campaign:
    text = (path / "campaign.toml").read_text()
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text)
    return open_campaign(path)


def test_regression_alone_is_held_against_a_constant(tmp_path: Path) -> None:
    campaign = make_campaign(tmp_path, config=CONFIG.replace('rung = "gp"', 'rung = "linear"'))
    logs = [write_log(tmp_path / f"{n}.csv", random_motion(campaign, n), n) for n in range(1, 6)]
    tell(campaign, logs, foreign=True)
    left = read_residuals(campaign.model_folder(5) / LEFT_OUT)
    told = np.isfinite(left.error)
    assert (np.isfinite(left.physics) == told).all()
    assert left.physics[told].std() > 1.5 * left.error[told].std(), "a constant knows no motion"
    found = promote(campaign)
    assert (found.promoted, found.forced) == (True, False)
    assert [one.against for one in found.compared] == ["a constant command"]


def test_the_rigid_body_of_a_vehicle(tmp_path: Path) -> None:
    path = create_campaign(tmp_path / "cf", str(EXAMPLE / "crazyflie.toml"))[0].path
    campaign = configured(path, {**QUICK, 'rung = "auto"': 'rung = "identified"'})
    tell(campaign, sorted(EXAMPLE.glob("log*.csv")), foreign=True)
    assert set(campaign.state().trained[-1].trained.chosen.split(", ")) == {"identified"}
    found = promote(campaign)
    assert found.promoted, found.refused
    assert [one.against for one in found.compared] == ["a constant command"]


@pytest.mark.slow
def test_the_rigid_body_of_an_arm(tmp_path: Path) -> None:
    path = create_campaign(tmp_path / "arm", "arm4", seed=3)[0].path
    campaign = configured(
        path, {'rung = "auto"': 'rung = "identified"', "duration = 60.0": "duration = 20.0"}
    )
    list(simulate(campaign, 4))
    found = promote(campaign)
    assert found.promoted, found.refused
