"""Flights of a real vehicle told from the command line, as the examples' README says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from certificate_schema import valid
from etude import load_model
from etude.campaign import Campaign, ingested_samples, open_campaign
from etude.campaign.ingest.ingest_result import read
from etude.cli import main
from etude.codes import Warn
from etude.logs import write_log

EXAMPLE = Path(__file__).parents[3] / "examples" / "crazyflie"
QUICK = {
    "duration = 15.0": "duration = 10.0",
    "candidates = 100": "candidates = 10",
    "refine = 2": "refine = 1",
    "steps = 60": "steps = 8",
    "starts = 3": "starts = 1",
    "points = 1200": "points = 150",
}


def made(folder: Path) -> Path:
    """A campaign with little training."""
    assert main(["init", str(folder), "--robot", str(EXAMPLE / "crazyflie.toml")]) == 0
    text = (folder / "campaign.toml").read_text()
    for old, new in QUICK.items():
        assert old in text
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
    assert facts.logs == (1, 2)
    missing = next(one for one in facts.warnings if one.code == Warn.INPUTS_MISSING)
    assert (
        missing.sentence
        == "Inputs excluded from the model, because some logs lack them: altitude and body velocity"
    )
    assert main(["tell", str(told.path), str(EXAMPLE / "log10_thrust.csv"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["repeated"]
    assert again["warnings"] == json.loads(json.dumps([one.facts() for one in facts.warnings]))
    assert {"identified", "gp", "identified+gp", "linear"} <= set(facts.models)
    assert facts.models["gp"].nmse != facts.models["identified"].nmse


def test_what_the_recipe_found_is_on_record(told) -> None:
    """The lag of the motors, measured in all flights together."""
    first, second = (round_.trained.recipe for round_ in told.state().trained)
    lags = [float(said.split("lags ")[1].split(" s")[0]) for (said,) in (first, second)]
    assert 0.02 < lags[1] < lags[0] < 0.08


def test_a_flight_can_be_asked_for(told) -> None:
    assert main(["ask", str(told.path), "--continue"]) == 0
    (asked,) = told.state().proposals
    assert valid((told.proposal(asked.number) / "certificate.json").read_text())["ok"]


def test_a_damaged_flight_is_refused_and_nothing_is_stored(told, tmp_path, capsys) -> None:
    text = (EXAMPLE / "log16_yaw_first.csv").read_text()
    (tmp_path / "bad.csv").write_text(text.replace("motor_2", "temperature", 1))
    before = sorted((told.path / "runs").iterdir())
    assert main(["tell", str(told.path), str(tmp_path / "bad.csv"), "--foreign"]) == 3
    assert "m2" in " ".join(capsys.readouterr().err.split())
    assert sorted((told.path / "runs").iterdir()) == before


def test_a_flight_that_tells_less_than_those_before_is_learned_too(tmp_path, capsys) -> None:
    """Altitude and velocity, which only the first flight tells, are inputs of the first model alone."""
    folder = made(tmp_path / "cf")
    campaign = open_campaign(folder)
    rich = read(campaign, EXAMPLE / "log16_yaw_first.csv")
    wave = np.sin(rich.t)[:, None] * [0.1, 0.2, 0.3]
    rich = rich.put(campaign.channel("altitude"), 1.0 + wave[:, :1])
    write_log(tmp_path / "rich.parquet", rich.put(campaign.channel("body_velocity"), wave))
    widths = []
    for path in (tmp_path / "rich.parquet", EXAMPLE / "log16_yaw_second.csv"):
        assert main(["tell", str(folder), str(path), "--foreign"]) == 0
        capsys.readouterr()
        assert main(["status", str(folder)]) == 0
        assert ("(selected now: ", "each of 2 motions predicted from the others")[
            len(widths)
        ] in capsys.readouterr().out
        widths.append(len(load_model(folder).inputs.columns))
    assert widths == [13, 9]
    first, second = (round_.trained for round_ in campaign.state().trained)
    assert not any(one.code == Warn.INPUTS_MISSING for one in first.warnings)
    assert sum(one.code == Warn.INPUTS_MISSING for one in second.warnings) == 1
    assert set(second.models) == {"linear"}  # no earlier model can say anything of it
    assert len(ingested_samples(campaign, [1, 2])) > 0


def test_a_plan_given_as_its_table_is_the_motion_beside_it(told, tmp_path, capsys) -> None:
    """A table of positions and attitudes does not say what an accelerometer would measure."""
    assert main(["ask", str(told.path), "--continue"]) == 0
    (asked,) = told.state().proposals
    plan, commands = told.proposal(asked.number) / "trajectory.csv", tmp_path / "commands.csv"
    assert main(["predict", str(told.path), str(plan), "--output", str(commands)]) == 0
    of_table = commands.read_bytes()
    motion = plan.with_suffix(".json")
    assert main(["predict", str(told.path), str(motion), "--output", str(commands)]) == 0
    assert of_table == commands.read_bytes()
    alone = tmp_path / "trajectory.csv"
    alone.write_text(plan.read_text().replace(",thrust", ",lift", 1).replace("ax,ay,az", "bx,by,bz", 1))
    capsys.readouterr()
    assert main(["predict", str(told.path), str(alone), "--output", str(commands)]) == 3
    assert "specific_force" in " ".join(capsys.readouterr().err.split())


def test_a_vehicle_whose_motors_nobody_described_learns_nothing_on_line_and_says_why(told, capsys) -> None:
    assert main(["export", str(told.path), "--to", "online"]) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "[vehicle]" in said
    assert "--to c" in said
