"""Both quick starts of vehicles, typed as they stand there, and flown from arming to landing."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from flights import AFTER, BEFORE, RATE, rows_of
from px4_cascade import fly, padded

from etude.campaign import open_campaign
from etude.cli import main
from etude.trajectories import from_json
from etude_quadrotor import NED, POLY4D

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize(("page", "library"), [("px4", "pyulog"), ("crazyflie", "numpy")])
def test_it_is_flown_from_the_ground_to_the_ground(
    page: str, library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(library, reason="its log is read by the extra 'px4'")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "start" / f"{page}.md").read_text(encoding="utf-8")
    for line in re.findall(r"^etude .*$", text, re.MULTILINE):
        assert main(shlex.split(line)[1:]) == 0, line
    (place,) = tmp_path.glob(f"*/proposals/*/from_ground/{page}")
    whole = from_json((place.parent / "trajectory.json").read_bytes())
    labels = [label for _, label, _ in whole.pieces()]
    assert labels == ["take-off", "approach", "lead-in", "segment", "lead-out", "return", "landing"]
    if page == "px4":
        rows = rows_of((place / "setpoints.csv").read_bytes())
    else:  # the high-level commander: polynomials, then the last point at rest
        played = POLY4D.back({"poly4d.csv": (place / "poly4d.csv").read_bytes()})
        t = np.arange(int(played.duration * RATE) + 1) / RATE
        rows = np.concatenate(list(played.motion(t, 3).orders @ NED.T), axis=1)
        last = played.motion(np.array([played.duration]), 3).orders[:, 0] @ NED.T
        assert np.abs(last[1:]).max() < 1e-3
        rows = np.concatenate([rows, [[*last[0], *np.zeros(6)]]])
    spec = open_campaign(place.parents[3]).spec
    flown = fly(padded([rows], RATE, BEFORE, AFTER), RATE, ground=np.array([-spec.floor]))
    path = flown.position[:, 0] @ NED.T
    low, high = np.array(spec.lower), np.array(spec.upper)
    low[2] = spec.floor
    assert (path >= low - 1e-3).all()
    assert (path <= high).all()
    assert np.linalg.norm(flown.velocity[:, 0], axis=1).max() <= spec.speed
    assert np.ptp(path[:, 2]) > 0.3, "it left the ground"
    assert np.abs(path[-1, 2] - spec.floor) < 0.02, "and stands on it"
    assert np.abs(flown.velocity[-1]).max() < 0.01
