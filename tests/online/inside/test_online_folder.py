"""A deployed folder: opened warm, refused where it was changed, saved and opened as if never stopped."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude import plugins
from etude.campaign import preset_config
from etude.errors import DataError, UsageError
from etude.models import ModelConfig, select_structures
from etude.progress import watched
from etude_online import OnlineConfig, online_folder, open_online
from etude_online.online_folder import HASHES, ONLINE, OnlineOptions, write
from etude_online.runtime import Deployed

KIND = plugins.load("etude.robots", "arm")
PATH = KIND.built_in()["arm4"]
SPEC, CONFIG = KIND.spec(PATH), preset_config(KIND, "default")
SMALL = ModelConfig(rung="gp", kernel="ard_se", points=40, fit_points=40, steps=3, calibrate=False)


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    robot = KIND.robot(SPEC, CONFIG)
    rng = np.random.default_rng(0)
    motion = KIND.tests(SPEC, CONFIG, rng)["moves"]
    log = robot.run(motion, None, rng)
    samples = KIND.samples(SPEC, CONFIG, [log], [np.zeros(len(log), dtype=np.int64)])
    model = select_structures(samples, KIND.inputs(SPEC, CONFIG), {}, KIND.limit(SPEC), SMALL, rng).model
    options = OnlineOptions(KIND.described(PATH).files, [log], OnlineConfig(size=60), model_hash="abc")
    done: list[float] = []
    with watched(done.append):
        found = dict(write(model, KIND, SPEC, CONFIG, options))
    assert sorted({round(4.0 * part) for part in done}) == [0, 1, 2, 3, 4]  # says how far it is
    return found


def put(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def plan(t: float) -> list[np.ndarray]:
    swing = 0.3 * np.ones(4)
    return [swing * np.sin(t), swing * np.cos(t), -swing * np.sin(t)]


def driven(robot: Deployed, ticks: range) -> np.ndarray:
    """Commands on a robot that needs 3 units more than the model says, under its own feedback."""
    kp = np.array([700.0, 1200.0, 900.0, 600.0])
    out = []
    for k in ticks:
        t, orders = k / 100, plan(k / 100)
        command, _ = robot.command(t, robot.planned_row(orders))
        q = orders[0] - 3.0 / kp
        robot.observe(t, {"q": q, "q_des": orders[0], "command": command + 3.0})
        out.append(command)
    return np.array(out)


def test_it_opens_without_a_campaign_and_learns(files, tmp_path) -> None:
    robot = open_online(put(tmp_path, files))
    assert robot.warm_s > 0.0
    assert robot.names == ("waist", "shoulder", "elbow", "wrist")
    assert robot.counts.learned.sum() == 0  # what warmed it up is forgotten
    commands = driven(robot, range(400))
    assert np.isfinite(commands).all()
    assert robot.counts.learned.min() > 0
    assert robot.counts.suspected == 0
    assert not any("is used alone" in sentence for _, sentence in robot.reports())
    assert set(robot.weights()) == set(robot.names)


COMPILED = """
import sys
import numpy as np
from etude_online.runtime import open_online

def known():
    found = [v for n, m in list(sys.modules.items()) if n.startswith("etude.") for v in vars(m).values()]
    return {id(d): len(d.signatures) for d in found if hasattr(d, "py_func") and hasattr(d, "signatures")}

robot = open_online(sys.argv[1])
before = known()
for k in range(300):
    q = 0.3 * np.sin(k / 100) * np.ones(4)
    plan = [q, 0.3 * np.cos(k / 100) * np.ones(4), -q]
    command, _ = robot.command(k / 100, robot.planned_row(plan))
    robot.observe(k / 100, {"q": q, "q_des": q, "command": command})
assert robot.counts.learned.min() > 0
assert len(before) > 3 and known() == before, (before, known())
"""


@pytest.mark.slow
def test_nothing_is_compiled_in_the_loop(files, tmp_path) -> None:
    folder = put(tmp_path, files)
    subprocess.run([sys.executable, "-c", COMPILED, str(folder)], check=True)


def test_saved_and_opened_again_is_never_stopped(files, tmp_path) -> None:
    folder = put(tmp_path / "folder", files)
    whole, first = driven(open_online(folder), range(260)), open_online(folder)
    driven(first, range(215))
    first.save(tmp_path / "state.npz")
    np.testing.assert_array_equal(
        driven(open_online(folder, tmp_path / "state.npz"), range(215, 260)), whole[215:]
    )


def test_a_changed_folder_is_refused(files, tmp_path) -> None:
    for number, name in enumerate(files):
        folder = put(tmp_path / str(number), files)
        data = bytearray(files[name])
        data[len(data) // 2] ^= 1
        (folder / name).write_bytes(bytes(data))
        with pytest.raises(DataError):
            open_online(folder)
    (folder / "model.npz").unlink()
    with pytest.raises(DataError, match=r"model\.npz|hashes"):
        open_online(folder)
    with pytest.raises(UsageError, match="not a folder"):
        open_online(tmp_path / "nowhere")


def test_a_state_of_another_folder_or_a_damaged_one_is_refused(files, tmp_path) -> None:
    folder = put(tmp_path / "a", files)
    robot = open_online(folder)
    robot.save(tmp_path / "state.npz")
    other = dict(files)
    words = json.loads(files[HASHES])
    words["etude"] = "another"
    other[HASHES] = json.dumps(words).encode()
    with pytest.raises(DataError, match="another folder"):
        open_online(put(tmp_path / "b", other), tmp_path / "state.npz")
    (tmp_path / "state.npz").write_bytes(b"nothing")
    with pytest.raises(DataError, match="no saved state"):
        open_online(folder, tmp_path / "state.npz")


def test_the_folder_says_what_is_proved_and_how_it_is_used(files) -> None:
    proof = json.loads(files["certificate.json"])
    assert proof["model_sha256"] == "abc"
    assert any("8 + 0.018 N" in sentence for sentence in proof["proved"])
    assert [row["name"] for row in proof["commands"]] == ["waist", "shoulder", "elbow", "wrist"]
    assert proof["feedback"]["law"]["kp"][0] == pytest.approx(700.0, rel=0.01)
    readme = files["README.md"].decode()
    assert "open_online" in readme
    assert "`q_des`" in readme


def test_what_cannot_be_judged_is_not_exported(files, tmp_path) -> None:
    robot = open_online(put(tmp_path, files))
    model = robot._online.model
    with pytest.raises(DataError, match="desired positions"):
        write(model, KIND, SPEC, CONFIG, OnlineOptions({"robot.toml": b""}, []))
    with pytest.raises(UsageError, match=r"no robot\.toml"):
        write(model, KIND, SPEC, CONFIG, OnlineOptions({}, []))
    with pytest.raises(UsageError, match="shape"):
        robot.planned_row([np.zeros(3)] * 3)


WRONG = [np.zeros(3), np.zeros(5), np.zeros(1), 0.1, np.zeros((1, 4)), ["a"] * 4]


def test_a_row_that_is_not_the_robots_is_refused_by_channel_and_parts(files, tmp_path) -> None:
    """Of q in a planned row, a wrong length held the last command for ever, and said so in a report alone."""
    robot = open_online(put(tmp_path, files))
    parts = r"4 numbers in .*\(waist, shoulder, elbow, wrist\)"
    row = robot.planned_row(plan(0.1))
    for name in ("q", "qd", "qdd"):
        with pytest.raises(UsageError, match=rf"planned row lacks {name}\. .*{name}: {parts}"):
            robot.command(0.1, {n: v for n, v in row.items() if n != name})
    for values in WRONG:
        for name in row:
            with pytest.raises(UsageError, match=rf"^{name} of the planned row .*{parts}"):
                robot.command(0.1, {**row, name: values})
    with pytest.raises(UsageError, match="different shapes"):
        robot.planned_row([np.zeros(4), np.zeros(3), np.zeros(4)])
    told, _ = robot.command(0.1, {n: v.tolist() for n, v in row.items()})
    np.testing.assert_array_equal(told, robot.command(0.1, row)[0])


@pytest.mark.parametrize("first", [True, False])
def test_a_measured_row_that_is_not_the_robots_is_refused_at_any_time(files, tmp_path, first) -> None:
    robot = open_online(put(tmp_path, files))
    row = {"q": plan(0.0)[0], "q_des": plan(0.0)[0], "command": np.zeros(4)}
    if first:
        with pytest.raises(UsageError, match=r"measured row lacks q_des\. .*waist, shoulder, elbow, wrist"):
            robot.observe(0.0, {n: v for n, v in row.items() if n != "q_des"})
    else:
        driven(robot, range(30))
    for values in WRONG:
        for name in row:
            with pytest.raises(UsageError, match=rf"^{name} of the measured row .*4 numbers"):
                robot.observe(0.3, {**row, name: values})
    assert robot.reports() == []  # nothing of a refused row was taken in
    driven(robot, range(30, 300))
    assert robot.counts.learned.min() > 0


def test_a_wrong_sign_is_told_in_one_sentence(files, tmp_path) -> None:
    robot = open_online(put(tmp_path, files))
    driven(robot, range(50))
    for k in range(50, 120):
        t, orders = k / 100, plan(k / 100)
        command, _ = robot.command(t, robot.planned_row(orders))
        robot.observe(t, {"q": orders[0], "q_des": orders[0], "command": -command - 9.0})
    (_, sentence), *more = robot.reports()
    assert "is used alone" in sentence
    assert more == []


@pytest.mark.slow
def test_a_vehicle_is_judged_by_what_its_controller_says(tmp_path) -> None:
    """Replayed flights: four voltages that act on no coordinate, so that every row holds `command_fb`."""
    kind = plugins.load("etude.robots", "quadrotor")
    path, rng = kind.built_in()["quadrotor"], np.random.default_rng(0)
    spec, config = kind.spec(path), preset_config(kind, "default")
    robot, flights = kind.robot(spec, config), list(kind.tests(spec, config, rng).values())
    logs = [robot.run(flight, None, rng) for flight in flights[:2]]
    groups = [np.full(len(log), place, dtype=np.int64) for place, log in enumerate(logs)]
    samples = kind.samples(spec, config, logs, groups)
    small = replace(config.model, rung="gp", starts=1, points=150, steps=10)
    model = select_structures(
        samples.take(samples.group == 0), kind.inputs(spec, config), {}, kind.limit(spec), small, rng
    ).model
    options = OnlineOptions(kind.described(path).files, logs, OnlineConfig(size=100))
    opened = open_online(put(tmp_path, dict(write(model, kind, spec, config, options))))
    flight = samples.take(samples.group == 1).log
    for k, t in enumerate(flight.t.tolist()):
        row = {name: values[k] for name, values in flight.values.items()}
        sent, _ = opened.command(t, row)
        assert np.isfinite(sent).all()
        sign = -1.0 if t > 15.0 else 1.0
        opened.observe(t, {**row, "command": sign * row["command"], "command_fb": row["command"] - sent})
    assert opened.counts.learned.min() > 10
    assert opened.counts.suspected > 5
    assert set(opened.weights().values()) == {0.0}
    assert "front_right" in opened.reports()[0][1]


def test_the_target_takes_a_half_life(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[OnlineConfig] = []
    monkeypatch.setattr(online_folder, "write", lambda *given: seen.append(given[-1].learning) or {})
    supplied = {"description": {}, "logs": [], "config": CONFIG}
    for more in ({}, {"half_life": "30"}, {"half_life": 20.0, "method": "ssgp"}):
        ONLINE(None, KIND, SPEC, supplied | more)
    assert [(own.method, own.half_life) for own in seen] == [
        ("variance", None),
        ("variance", 30.0),
        ("ssgp", 20.0),
    ]
    with pytest.raises(UsageError, match="half_life = 'long' is not a number"):
        ONLINE(None, KIND, SPEC, supplied | {"half_life": "long"})
