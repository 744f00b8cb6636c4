"""A quadrotor's campaign from the command line's functions: asked, flown, told, learned, tested, replayed."""

from dataclasses import replace

import numpy as np
import pytest

from certificate_schema import valid
from etude import ask, export, load_model, predict, status, tell
from etude.campaign import create_campaign, ingested_samples, open_campaign, simulate, stored_trajectory
from etude.campaign import simulation as simulating
from etude.campaign.record.controls import asked_under
from etude.errors import DataError, UsageError
from etude.limits import certify
from etude.logs import read_log_file, write_log
from etude.models import LinearPhysics

QUICK = {
    "duration = 15.0": "duration = 12.0",
    "candidates = 100": "candidates = 12",
    "steps = 60": "steps = 8",
    "starts = 3": "starts = 1",
    "points = 1200": "points = 120",
}


def made(path, robot="quadrotor", preset="default"):
    create_campaign(path, robot, preset, seed=3)
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
    by = {(e.baseline or number, e.test): e.errors for number, e in campaign.state().evaluated}
    names = ("pid", "analytic", "exact_drag", "rigid_body", 1, 2)
    assert set(by) == {(who, test) for who in names for test in ("uniform", "boundary")}
    for test in ("uniform", "boundary"):
        assert by[2, test][-1] < 0.5 * by["pid", test][-1]
        assert by[2, test][-1] < 1.3 * by["exact_drag", test][-1]
    assert (rounds[-1].unit, rounds[-1].axes) == ("m", 3)
    assert rounds[-1].mean_errors()["uniform"] == by[2, "uniform"][-1]
    assert rounds[-1].robot_seconds == pytest.approx(24.0, abs=0.5)
    learned = campaign.state().trained[-1].trained
    np.testing.assert_allclose(learned.inputs["drag"], [0.573, 0.573, 0.0], atol=0.03)


def test_the_linear_baseline_has_not_seen_the_flight_that_it_is_scored_on(flown):
    campaign, _ = flown
    data = ingested_samples(campaign, [1, 2])
    known, new = data.take(data.group == 0), data.take(data.group == 1)
    inputs = campaign.kind.inputs(campaign.spec, campaign.config).fitted(data)
    error = new.command - LinearPhysics(inputs)(known).predict(new.log)
    scored = campaign.state().rounds[2].trained.models["linear"]
    expected = np.mean(error**2, axis=0) / np.var(new.command, axis=0)
    np.testing.assert_allclose(scored.nmse, expected, rtol=1e-6)


def test_every_proposal_is_certified_from_its_bytes(flown):
    campaign, _ = flown
    for number in (1, 2):
        proof = valid((campaign.proposal(number) / "certificate.json").read_text())
        assert proof["ok"]
        # what the robot's description says; the first flight was asked for before any had left its plan
        described = campaign.kind.limits(campaign.spec, campaign.config, None, {})
        found = certify(stored_trajectory(campaign, number), described)
        assert found.ok
        assert {row["quantity"] for row in proof["rows"]} == {row.quantity for row in found.rows}


@pytest.mark.slow
def test_replay_is_live_and_asking_is_pure(flown, tmp_path):
    campaign, _ = flown
    first = ask(campaign, go_on=True)
    assert not ask(campaign, go_on=True).new
    again = made(tmp_path / "lab")
    for number in (1, 2):
        (control,) = asked_under(campaign.round(number).asked)
        ask(again, go_on=True, control=control)
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
    with pytest.raises(DataError, match="not the log of the proposed"):
        tell(again, campaign.path / "simulated" / "0002.parquet")
    first = read_log_file(campaign.path / "simulated" / "0001.parquet")
    write_log(tmp_path / "unknown.parquet", first.without("command"))
    with pytest.raises(DataError, match="command"):
        tell(again, tmp_path / "unknown.parquet")
    assert not again.state().ingested


def test_status_names_the_commands(flown):
    campaign, _ = flown
    found = status(campaign)
    assert found["outputs"] == list(campaign.spec.command_names)
    assert all(len(score["nmse"]) == 4 for score in found["prequential"].values())
    assert {"linear", "identified", "nominal", "gp"} <= set(found["prequential"])
    assert len(found["rungs"]) == 4


def test_stored_models_predict_as_told(flown):
    campaign, _ = flown
    model = load_model(campaign.path)
    data = ingested_samples(campaign, [2])
    mean, variance = model.posterior(data.log)
    assert mean.shape == data.command.shape
    assert np.all(variance > 0.0)
    assert np.mean((mean - data.command) ** 2) < 0.1 * np.var(data.command, axis=0).mean()


def path_file(path, t, places, header="t,x,y,z,yaw", yaw=0.0):
    rows = np.column_stack([t, places, np.full(len(t), yaw)])
    path.write_text("\n".join([header, *(",".join(f"{v:.6f}" for v in row) for row in rows)]) + "\n")
    return path


def circle(t):
    """(T, 3) from rest to rest in 10 s, about 2 m above the ground."""
    part = t / 10.0
    angle = 2.0 * np.pi * part**4 * (35.0 - 84.0 * part + 70.0 * part**2 - 20.0 * part**3)
    return np.column_stack([np.cos(angle) - 1.0, np.sin(angle), 2.0 + 0.0 * t])


@pytest.mark.parametrize(("rate", "header"), [(20.0, "t,x,y,z,yaw"), (2.0, "time,pos_x,pos_y,pos_z,heading")])
def test_commands_along_a_path_of_ones_own_are_those_of_the_motion(flown, tmp_path, rate, header):
    campaign, _ = flown
    motion = stored_trajectory(campaign, 1)
    t = np.arange(0.0, motion.duration + 1e-9, 1.0 / rate)
    own = path_file(tmp_path / "own.csv", t, motion.motion(t, 1).orders[0], header)
    (tmp_path / "plan.json").write_text(motion.to_json())
    said = []
    found = predict(campaign, own, say=said.append)
    planned = predict(campaign, tmp_path / "plan.json")
    assert any("holds only a path" in sentence for sentence in said)
    inside = slice(5, -5)  # at the ends a fit to rows of a moving motion is less sure
    off = np.abs(found["command"] - planned["command"])[inside]
    assert np.median(off) < 0.01 * np.ptp(planned["command"])


def test_a_path_of_ones_own_leaves_with_a_proof(flown, tmp_path):
    campaign, _ = flown
    t = np.arange(0.0, 10.01, 0.05)
    own = path_file(tmp_path / "own.csv", t, circle(t))
    folder = export(campaign, "trajectory", tmp_path / "out", motion=str(own), format="px4").folder
    proof = valid((folder / "px4" / "certificate.json").read_text())
    assert proof["ok"]
    rows = np.genfromtxt(folder / "px4" / "setpoints.csv", delimiter=",", names=True)
    assert np.abs(np.interp(t, rows["time"], rows["east"]) - circle(t)[:, 0]).max() < 0.01
    assert np.abs([rows[f"v{axis}"][[0, -1]] for axis in ("north", "east", "down")]).max() == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"yaw": 0.5}, "yaw is up to 0.5, but planned flights have the heading 0"),
        ({"count": 5}, "the table has 5 rows; a smooth motion needs 8 or more"),
        ({"leap": 0.5}, "no smooth motion follows these rows"),
    ],
)
def test_a_path_that_cannot_be_flown_so_is_refused(flown, tmp_path, change, message):
    campaign, _ = flown
    t = 0.05 * np.arange(change.get("count", 201))
    places = circle(t) + change.get("leap", 0.0) * (t > 5.0)[:, None]
    own = path_file(tmp_path / "own.csv", t, places, yaw=change.get("yaw", 0.0))
    with pytest.raises(UsageError, match=message):
        predict(campaign, own)
    with pytest.raises(UsageError, match=message):
        export(campaign, "trajectory", tmp_path / "out", motion=str(own))


@pytest.mark.slow
def test_the_thesis_preset_runs(tmp_path):
    campaign = made(tmp_path / "lab", preset="thesis")
    list(simulate(campaign, 2))
    trained = campaign.state().trained[-1].trained
    assert trained.chosen == "gp"
    assert not trained.calibrated
    assert len(load_model(campaign.path).inputs.columns) == 10


def test_kinds_must_agree(tmp_path):
    made(tmp_path / "lab")
    path = tmp_path / "lab" / "campaign.toml"
    path.write_text('kind = "arm"\n')
    with pytest.raises(UsageError, match=r"has the kind 'quadrotor', but campaign.toml states 'arm'"):
        open_campaign(tmp_path / "lab")


def test_a_robot_file_that_is_no_toml_is_told_so_with_the_line(tmp_path):
    made(tmp_path / "lab")
    path = tmp_path / "lab" / "robot.toml"
    path.write_text(path.read_text() + "\n[twice]\n[twice]\n")
    with pytest.raises(UsageError, match=r"not valid TOML: .*line \d+"):
        open_campaign(tmp_path / "lab")


def test_a_vehicle_without_a_plant_cannot_be_simulated(tmp_path):
    campaign = made(tmp_path / "lab")
    with pytest.raises(UsageError, match="no simulated plant"):
        next(simulate(replace(campaign, spec=replace(campaign.spec, plant=None)), 1))


def test_a_vehicle_has_one_engine(tmp_path):
    with pytest.raises(UsageError, match="one engine only"):
        next(simulate(made(tmp_path / "lab"), 1, "mujoco"))


def test_a_flight_into_the_wall_is_refused_and_says_where(tmp_path):
    campaign = made(tmp_path / "lab")
    ask(campaign)
    robot = campaign.kind.robot(campaign.spec, campaign.config).changed(wind=18.0)
    flown = robot.run(stored_trajectory(campaign, 1), None, np.random.default_rng(0))
    write_log(tmp_path / "wall.parquet", flown)
    with pytest.raises(DataError, match="left the room after"):
        tell(campaign, tmp_path / "wall.parquet", number=1)
    assert campaign.state().proposals[0].number == 1


@pytest.mark.slow
def test_a_simulation_gives_up_a_flight_that_broke_off(tmp_path, monkeypatch):
    """The first answer is refused, as that of a flight into a wall; another flight takes its place."""
    refused = []

    def once(campaign, path, **options):
        if not refused:
            refused.append(options["number"])
            raise DataError("the vehicle left the room")
        return tell(campaign, path, **options)

    monkeypatch.setattr(simulating, "tell", once)
    campaign = made(tmp_path / "lab")
    rounds = list(simulate(campaign, 1))
    assert refused == [1]
    assert [done.number for done in rounds] == [2]
    assert [r.number for r in campaign.state().rounds.values() if r.abandoned] == [1]
    assert [r.number for r in campaign.state().trained] == [2]


def test_a_simulation_ends_where_no_flight_stays_inside(tmp_path, monkeypatch):
    def never(campaign, path, **options):
        raise DataError("the vehicle left the room")

    monkeypatch.setattr(simulating, "tell", never)
    with pytest.raises(DataError, match="only 0 of 1 runs gave a usable log"):
        list(simulate(made(tmp_path / "lab"), 1))
