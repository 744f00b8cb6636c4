"""`.plot()` of a campaign, a log and each form of trajectory: panels, the values they show, and the file."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from synthetic_campaign import error_after, write_campaign

from etude.campaign import Campaign, open_campaign, stored_trajectory
from etude.logs import read_log
from etude.protocols import Trajectory
from etude.trajectories import Chain, PointToPoint, Splined

ROUNDS = 3


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("lab")
    write_campaign(folder, ROUNDS)
    return open_campaign(folder)


def panels(svg: str) -> dict[str, list[np.ndarray]]:
    """By title, the values (T,) of each curve of a panel, on linear axes."""
    found = {}
    for panel in ElementTree.fromstring(svg).iter():
        if panel.get("data-scale") is None:
            continue
        low, high, start, end = (float(v) for v in panel.get("data-scale", "").split()[4:8])
        lines = [own.get("d", "") for own in panel.iter() if (own.get("class") or "").startswith("line ")]
        curves = [line for line in lines if line.count("L") > 1]  # a legend's have one
        pixels = [np.array(re.findall(r",([-\d.]+)", line), dtype=float) for line in curves]
        values = [low + (px - start) / (end - start) * (high - low) for px in pixels]
        found[panel.get("aria-label", "")] = values
    return found


def test_a_learning_curve_has_the_errors_of_the_journal(campaign: Campaign, tmp_path: Path) -> None:
    picture = campaign.plot(tmp_path / "learning.svg")
    assert (tmp_path / "learning.svg").read_text(encoding="utf-8") == picture.svg == picture._repr_svg_()
    assert len(panels(picture.svg)) == 2
    first = picture.svg.split("data-scale")[1]
    shown = [float(value) for value in re.findall(r"learned by Étude: ([\d.]+) at", first)]
    np.testing.assert_allclose(shown, [error_after(n) for n in range(1, ROUNDS + 1)], rtol=1e-2)


def test_a_real_campaign_has_the_scores_of_logs_before_they_were_learned(tmp_path: Path) -> None:
    write_campaign(tmp_path / "lab", 4, evaluated=False)
    shown = panels(open_campaign(tmp_path / "lab").plot().svg)
    assert [len(lines) for lines in shown.values()] == [4]
    assert list(shown) == ["Each log, predicted before training on it"]
    write_campaign(tmp_path / "new", 0, evaluated=False)
    assert list(panels(open_campaign(tmp_path / "new").plot().svg)) == ["No log has been predicted yet"]


def test_a_log_has_a_panel_for_each_state_and_command(campaign: Campaign, tmp_path: Path) -> None:
    log = read_log(campaign.run_file(1), campaign.channels, rate=campaign.spec.rate)
    shown = panels(log.plot(tmp_path / "log.svg").svg)
    assert list(shown) == [n for n, c in log.channels.items() if c.role in ("state", "command") and n in log]
    assert (tmp_path / "log.svg").exists()
    ends = [[line.min(), line.max()] for line in shown["q"]]
    np.testing.assert_allclose(ends, np.transpose([log["q"].min(0), log["q"].max(0)]), atol=0.01)


def form_of(name: str, series: Trajectory) -> Trajectory:
    moves = PointToPoint(np.array([[0.0, 0.0], [0.4, -0.2]]), 0.5, 0.3, 2.0, 40.0)
    t = np.linspace(0.0, 2.0, 9)
    splined = Splined(t, np.stack([np.sin(t), np.cos(t), -np.sin(t)])[:, :, None])
    chain = Chain((("segment", moves), ("segment", PointToPoint(moves.waypoints[::-1], 0.5, 0.3, 2.0, 40.0))))
    return {"series": series, "moves": moves, "splined": splined, "chain": chain}[name]


@pytest.mark.parametrize("name", ["series", "moves", "splined", "chain"])
def test_a_trajectory_has_position_velocity_and_acceleration(name: str, campaign: Campaign) -> None:
    trajectory = form_of(name, stored_trajectory(campaign, 1))
    shown = panels(trajectory.plot().svg)
    assert list(shown) == ["position", "velocity", "acceleration"]
    orders = trajectory.motion(np.linspace(0.0, trajectory.duration, 2001), 3).orders
    for lines, values in zip(shown.values(), orders, strict=True):
        size = 0.02 * np.ptp(values)  # an instant between two of the picture's may be the largest
        np.testing.assert_allclose([line.max() for line in lines], values.max(axis=0), atol=size)
        np.testing.assert_allclose([line.min() for line in lines], values.min(axis=0), atol=size)
