"""Flights of a real vehicle told from the command line, as the examples' README says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.campaign.flight.learner import load_chosen, told_flights
from etude.campaign.folder import Campaign, open_campaign
from etude.cli import main
from etude.logs.flight.lag import command_lag
from etude.logs.flight.parquet import write_flight
from etude.logs.flight.table import read_flight
from etude.models.flight.preprocess import FlightDataConfig, build_flight_dataset

EXAMPLE = Path(__file__).parents[2] / "examples" / "crazyflie"
QUICK = {
    "duration = 30.0": "duration = 10.0",
    "candidates = 100": "candidates = 10",
    "starts = 8": "starts = 1",
    "steps = 60": "steps = 8",
    "starts = 3": "starts = 1",
    "points = 1200": "points = 150",
}


def made(folder: Path) -> Path:
    """A campaign with little training."""
    assert main(["init", str(folder), "--robot", str(EXAMPLE / "crazyflie.toml")]) == 0
    text = (folder / "campaign.toml").read_text()
    for old, new in QUICK.items():
        text = text.replace(old, new)
    (folder / "campaign.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> Campaign:
    folder = made(tmp_path_factory.mktemp("real") / "cf")
    for name in ("log10_thrust.csv", "log15_roll_pitch.csv"):
        assert main(["tell", str(folder), str(EXAMPLE / name), "--foreign"]) == 0
    return open_campaign(folder)


def test_flights_without_position_are_learned_and_what_is_missing_is_said(told, capsys) -> None:
    facts = told.state().trained[-1].trained
    assert facts["logs"] == [1, 2]
    assert facts["warnings"] == ["Not every flight tells its altitude and velocity; the model does without."]
    assert main(["tell", str(told.path), str(EXAMPLE / "log10_thrust.csv"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["repeated"]
    assert again["warnings"] == facts["warnings"]
    assert set(facts["models"]) == {"identified", "gp", "identified+gp", "linear"}
    assert facts["models"]["gp"]["nmse"] != facts["models"]["identified"]["nmse"]


def test_the_lag_is_that_of_all_flights_together(told) -> None:
    logs = [read_flight(EXAMPLE / n, told.spec.flight) for n in ("log10_thrust.csv", "log15_roll_pitch.csv")]
    first, second = (round_.trained["lag_s"] for round_ in told.state().trained)
    assert first == pytest.approx(command_lag(logs[0]), abs=1e-6)
    assert second == pytest.approx(command_lag(*logs), abs=1e-6)
    assert 0.02 < second < first < 0.08
    data, lag = told_flights(told, [1, 2])
    for number, log in enumerate(logs):
        alone = build_flight_dataset(log, told.spec.flight, FlightDataConfig(lag_s=lag))
        np.testing.assert_allclose(data.command[data.group == number], alone.command, atol=1e-9)


def test_a_flight_can_be_asked_for(told) -> None:
    assert main(["ask", str(told.path), "--continue"]) == 0
    (asked,) = told.state().proposals
    assert json.loads((told.proposal(asked.number) / "certificate.json").read_text())["ok"]


def test_a_damaged_flight_is_refused_and_nothing_is_stored(told, tmp_path, capsys) -> None:
    text = (EXAMPLE / "log16_yaw_first.csv").read_text()
    (tmp_path / "bad.csv").write_text(text.replace("motor_2", "temperature", 1))
    before = sorted((told.path / "runs").iterdir())
    assert main(["tell", str(told.path), str(tmp_path / "bad.csv"), "--foreign"]) == 3
    assert "There is no command 'm2'" in " ".join(capsys.readouterr().err.split())
    assert sorted((told.path / "runs").iterdir()) == before


def test_a_flight_that_tells_less_than_those_before_is_learned_too(tmp_path) -> None:
    """Altitude and velocity, which only the first flight tells, are inputs of the first model alone."""
    folder = made(tmp_path / "cf")
    rich = read_flight(EXAMPLE / "log16_yaw_first.csv", open_campaign(folder).spec.flight)
    wave = np.sin(rich.t)[:, None] * [0.1, 0.2, 0.3]
    states = replace(rich.states, altitude=1.0 + wave[:, 0], velocity=wave)
    write_flight(replace(rich, states=states), tmp_path / "rich.parquet")
    for path in (tmp_path / "rich.parquet", EXAMPLE / "log16_yaw_second.csv"):
        assert main(["tell", str(folder), str(path), "--foreign"]) == 0
    campaign = open_campaign(folder)
    widths = [newest.features.width for n in (1, 2) for newest in [load_chosen(campaign.model_folder(n))]]
    assert widths == [13, 9]
    first, second = (round_.trained for round_ in campaign.state().trained)
    assert first["warnings"] == []
    assert len(second["warnings"]) == 1
    assert set(second["models"]) == {"linear"}  # no earlier model can say anything of it
