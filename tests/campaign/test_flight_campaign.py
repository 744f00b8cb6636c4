"""A flying campaign from the command line's functions: asked, flown, told, learned, tested, replayed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.campaign.ask import ask, stored_trajectory
from etude.campaign.create import create_campaign
from etude.campaign.flight import simulate as flight_simulate
from etude.campaign.flight.learner import load_chosen, told_flights
from etude.campaign.flight.simulate import position_error
from etude.campaign.folder import open_campaign
from etude.campaign.simulate import simulate
from etude.campaign.status import status
from etude.campaign.tell import tell
from etude.control.flight_feedforward import PID_ALONE, flight_plan
from etude.errors import DataError, UsageError
from etude.logs.flight.log import FlightLog
from etude.logs.flight.parquet import read_flight_parquet, write_flight
from etude.models.physics.flight_linear import identify_linear
from etude.plants.flight.disturbance import Disturbance
from etude.plants.flight.record import flight_log
from etude.plants.flight.registry import flight_plant
from etude.trajectories.flight.certificate import certify_flight
from etude.trajectories.flight.states import FlightStates

QUICK = {
    "duration = 30.0": "duration = 12.0",
    "candidates = 100": "candidates = 12",
    "starts = 8": "starts = 2",
    "steps = 60": "steps = 8",
    "starts = 3": "starts = 1",
    "points = 1200": "points = 120",
}


def made(path: Path, robot: str = "quadrotor", preset: str = "default"):
    _campaign, _ = create_campaign(path, robot, preset, seed=3)
    text = (path / "campaign.toml").read_text()
    for old, new in QUICK.items():
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text)
    return open_campaign(path)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    campaign = made(tmp_path_factory.mktemp("flown") / "lab")
    return campaign, list(simulate(campaign, 2))


def test_learning_beats_feedback_alone(flown):
    campaign, rounds = flown
    evaluated = campaign.state().evaluated
    by = {
        (e["baseline"] if "baseline" in e else e["number"], e["test"]): e["tracking_error_m"]
        for e in evaluated
    }
    assert set(by) == {
        (who, test) for who in ("pid", "analytic", "exact_drag", 1, 2) for test in ("uniform", "boundary")
    }
    for test in ("uniform", "boundary"):
        assert by[2, test][-1] < 0.5 * by["pid", test][-1]
        assert by[2, test][-1] < 1.3 * by["exact_drag", test][-1]
    assert rounds[-1].unit == "m"
    assert rounds[-1].robot_seconds == pytest.approx(24.0, abs=0.5)
    learned = campaign.state().trained[-1].trained
    np.testing.assert_allclose(learned["drag"], [0.573, 0.573, 0.0], atol=0.03)


def test_the_linear_baseline_has_not_seen_the_flight_that_it_is_scored_on(flown):
    campaign, _ = flown
    data, _ = told_flights(campaign, [1, 2])
    known, new = data.take(data.group == 0), data.take(data.group == 1)
    error = new.command - identify_linear(known.states, known.command).predict(new.states)
    scored = campaign.state().rounds[2].trained["models"]["linear"]
    expected = np.mean(error**2, axis=0) / np.var(new.command, axis=0)
    np.testing.assert_allclose(scored["nmse"], expected, rtol=1e-6)


def test_every_proposal_is_certified_from_its_bytes(flown):
    campaign, _ = flown
    for number in (1, 2):
        proof = json.loads((campaign.proposal(number) / "certificate.json").read_text())
        assert proof["ok"]
        found = certify_flight(stored_trajectory(campaign, number), campaign.spec.flight)
        assert found.ok
        assert {row["quantity"] for row in proof["rows"]} == {row.quantity for row in found.rows}


def test_replay_is_live_and_asking_is_pure(flown, tmp_path):
    campaign, _ = flown
    first = ask(campaign, go_on=True)
    assert not ask(campaign, go_on=True).new
    again = made(tmp_path / "lab")
    for number in (1, 2):
        ask(again, go_on=True)
        tell(again, campaign.path / "simulated" / f"{number:04d}.parquet", number=number)
    other = ask(again, go_on=True)
    assert (other.folder / "trajectory.json").read_bytes() == (first.folder / "trajectory.json").read_bytes()


def test_a_log_told_twice_changes_nothing(flown):
    campaign, _ = flown
    before = len(campaign.events())
    told = tell(campaign, campaign.path / "simulated" / "0001.parquet")
    assert told.repeated
    assert len(campaign.events()) == before


def test_another_flight_and_a_broken_one_are_refused(flown, tmp_path):
    campaign, _ = flown
    again = made(tmp_path / "lab")
    ask(again)
    log = read_flight_parquet(campaign.path / "simulated" / "0002.parquet")
    write_flight(log, tmp_path / "other.parquet")
    with pytest.raises(DataError, match="not the log of the proposed flight"):
        tell(again, tmp_path / "other.parquet")
    first = read_flight_parquet(campaign.path / "simulated" / "0001.parquet")
    first.states.rates[5] = np.nan
    write_flight(first, tmp_path / "nan.parquet")
    with pytest.raises(DataError, match="not a number"):
        tell(again, tmp_path / "nan.parquet")
    assert not again.state().told


def test_status_names_the_commands(flown):
    campaign, _ = flown
    found = status(campaign)
    assert found["outputs"] == list(campaign.spec.flight.command_names)
    assert all(len(score["nmse"]) == 4 for score in found["prequential"].values())
    assert {"linear", "identified", "nominal", "gp"} <= set(found["prequential"])


def test_stored_models_predict_as_told(flown):
    campaign, _ = flown
    model = load_chosen(campaign.model_folder(2))
    log = read_flight_parquet(campaign.run_file(2))
    mean, variance = model.predict(log.states)
    assert mean.shape == log.command.shape
    assert np.all(variance > 0.0)
    assert np.mean((mean - log.command) ** 2) < 0.1 * np.var(log.command, axis=0).mean()


def test_the_thesis_preset_runs(tmp_path):
    campaign = made(tmp_path / "lab", preset="thesis")
    numbers = [done.number for done in simulate(campaign, 2)]
    trained = campaign.state().trained[-1].trained
    assert trained["chosen"] == "gp"
    assert not trained["calibrated"]
    model = load_chosen(campaign.model_folder(numbers[-1]))
    assert model.features.width == 10


def test_kinds_must_agree(tmp_path):
    made(tmp_path / "lab")
    text = (tmp_path / "lab" / "campaign.toml").read_text().replace('kind = "vehicle"\n', "")
    (tmp_path / "lab" / "campaign.toml").write_text(text)
    with pytest.raises(UsageError, match=r"unknown key|different kinds"):
        open_campaign(tmp_path / "lab")


def test_a_vehicle_without_a_plant_cannot_be_simulated(tmp_path):
    campaign = made(tmp_path / "lab")
    with pytest.raises(UsageError, match="no simulated plant"):
        next(simulate(replace(campaign, spec=replace(campaign.spec, plant=None)), 1))


def test_a_flight_into_the_wall_is_refused_and_says_where(tmp_path):
    campaign = made(tmp_path / "lab")
    ask(campaign)
    plant = flight_plant("quadrotor")
    plan = flight_plan(stored_trajectory(campaign, 1), PID_ALONE, plant.vehicle, plant.rate)
    storm = Disturbance(wind=(14.0, 0.0, 0.0))
    flown = plant.fly(plan, None, start="moving", room=campaign.spec.flight, disturbance=storm)
    write_flight(flight_log(flown, plan, 10.0), tmp_path / "wall.parquet")
    with pytest.raises(DataError, match="left the room after"):
        tell(campaign, tmp_path / "wall.parquet", number=1)
    assert campaign.state().proposals[0].number == 1


def test_a_simulation_gives_up_a_flight_that_broke_off(tmp_path, monkeypatch):
    """The first answer is refused, as that of a flight into a wall; another flight takes its place."""
    refused = []

    def once(campaign, path, **options):
        if not refused:
            refused.append(options["number"])
            raise DataError("the vehicle left the room")
        return tell(campaign, path, **options)

    monkeypatch.setattr(flight_simulate, "tell", once)
    campaign = made(tmp_path / "lab")
    rounds = list(simulate(campaign, 1))
    assert refused == [1]
    assert [done.number for done in rounds] == [2]
    assert [r.number for r in campaign.state().rounds.values() if r.abandoned] == [1]
    assert [r.number for r in campaign.state().trained] == [2]


def test_a_simulation_ends_where_no_flight_stays_inside(tmp_path, monkeypatch):
    def never(campaign, path, **options):
        raise DataError("the vehicle left the room")

    monkeypatch.setattr(flight_simulate, "tell", never)
    with pytest.raises(DataError, match="only 0 of 1 flights kept inside"):
        list(simulate(made(tmp_path / "lab"), 1))


def test_an_error_that_broke_off_counts_to_the_end():
    t = np.arange(0.05, 10.0, 0.1)
    rows = np.zeros((len(t), 3))
    away = np.stack([np.where(t < 9.0, 0.0, 3.0), 0.0 * t, 0.0 * t], axis=1)
    states = FlightStates(None, rows, rows, rows)
    log = FlightLog(t, states, np.zeros((len(t), 4)), ("a", "b", "c", "d"), "V", away, rows)
    whole = position_error(log, 10.0)
    np.testing.assert_allclose(whole, [0.6, 0.0, 0.0, 0.6], atol=0.01)
    np.testing.assert_allclose(position_error(log, 15.0)[0], (1.0 + 5.0) * 3.0 / 10.0, atol=0.05)
