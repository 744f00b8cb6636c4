"""`etude predict`: commands along a motion, the same by command, by Python and by hand."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import etude
from etude import export
from etude._runtime.options import taken
from etude.campaign.deployment.model_export import given
from etude.campaign.record.stored_files import MARK
from etude.cli import main
from etude.errors import EtudeError, UsageError
from etude.trajectories import from_json
from etude.types import Delivered


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm after one simulated log, learned as cheaply as possible."""
    folder = tmp_path_factory.mktemp("predict") / "lab"
    assert main(["init", str(folder), "--robot", "arm4"]) == 0
    config = folder / "campaign.toml"
    text = config.read_text(encoding="utf-8")
    quick = {
        ', "standing", "slow", "ripple", "gip_lin", "all_lin"': "",
        "steps = 30": "steps = 2",
        "duration = 60.0": "duration = 20.0",
        "points = 600": "points = 40",
        "inducing = 1000": "inducing = 0",
    }
    for old, new in quick.items():
        assert old in text
        text = text.replace(old, new)
    config.write_text(text, encoding="utf-8")
    assert main(["simulate", str(folder), "--rounds", "1"]) == 0
    return folder


def table(path: Path, motion: Any, names: tuple[str, ...], orders: int) -> Path:
    columns = {"time": motion.t}
    for order, channel in zip(motion.orders[:orders], ("q", "qd", "qdd"), strict=False):
        columns |= {f"{channel}_{name}": order[:, j] for j, name in enumerate(names)}
    pl.DataFrame(columns).write_csv(path)
    return path


@pytest.mark.slow
def test_a_trajectory_and_its_table_say_the_same(lab: Path, tmp_path: Path) -> None:
    model, source = etude.load_model(lab), lab / "proposals" / "0001" / "trajectory.json"
    trajectory = from_json(source.read_bytes())
    found = etude.predict(lab, source)
    assert (found["command"].shape, found.channels["command"].units) == ((len(found), 4), ("pwm",) * 4)
    assert found.t[-1] == trajectory.duration
    np.testing.assert_array_equal(model.feedforward(trajectory, 100.0)["command"], found["command"])
    states = model.inputs.states(trajectory.motion(found.t, 3))
    mean, variance = model.predict(states)
    np.testing.assert_array_equal(found["command"], mean)
    np.testing.assert_array_equal(found["deviation"], np.sqrt(variance))
    motion = trajectory.motion(found.t, 3)
    again = etude.predict(lab, table(tmp_path / "motion.csv", motion, model.commands, 3))
    np.testing.assert_allclose(again["command"], found["command"], atol=1e-9)


@pytest.mark.slow
def test_positions_alone_are_differentiated_as_learning_does(lab: Path, tmp_path: Path) -> None:
    model = etude.load_model(lab)
    trajectory = from_json((lab / "proposals" / "0001" / "trajectory.json").read_bytes())
    t = np.arange(0.0, trajectory.duration, 0.01)
    path = table(tmp_path / "positions.csv", trajectory.motion(t, 1), model.commands, 1)
    assert main(["predict", str(lab), str(path), "--output", str(tmp_path / "c.parquet")]) == 0
    found = pl.read_parquet(tmp_path / "c.parquet")
    assert found.columns[:2] == ["time", "command_waist"]
    assert found.columns[-2:] == ["outside_elbow", "outside_wrist"]
    log = etude.predict(lab, path)
    assert any("qd and qdd computed from the positions" in sentence.lower() for sentence in log.repairs)
    assert 0.9 * len(t) < len(log) < len(t)
    exact = model.predict(model.inputs.states(trajectory.motion(log.t, 3)))[0]
    assert np.median(np.abs(log["command"] - exact)) < 2.0  # of 255: what the filter takes
    start = 1_700_000_000 * 10**9
    stamps = pl.Series("time_ns", start + np.round(t * 1e9).astype(np.int64))
    clocked = tmp_path / "clocked.csv"
    pl.read_csv(path).drop("time").insert_column(0, stamps).write_csv(clocked)
    again = etude.predict(lab, clocked)
    assert again.t[0] == pytest.approx(log.t[0], abs=1e-4)  # nanoseconds as doubles are 256 apart
    assert f"Time was counted from its first row, {start} ns." in again.repairs


@pytest.mark.slow
def test_the_command_writes_a_table_that_reads_back(
    lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = lab / "proposals" / "0001" / "trajectory.json"
    target = tmp_path / "commands.csv"
    assert main(["predict", str(lab), str(source), "--output", str(target), "--json"]) == 0
    printed = capsys.readouterr()
    said = json.loads(printed.out)
    found = pl.read_csv(target)
    assert len(found) == said["rows"]
    assert said["outside"]["elbow"] == pytest.approx(float(np.mean(found["outside_elbow"].to_numpy())))
    np.testing.assert_array_equal(found["command_elbow"], etude.predict(lab, source)["command"][:, 2])
    assert "The newest model is used, of log 1" in printed.err
    assert main(["predict", str(lab), str(source), "--output", str(tmp_path / "x.txt")]) == 2
    assert main(["predict", str(lab), str(tmp_path / "missing.csv")]) == 2


def test_an_untrained_model_neither_predicts_nor_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", str(tmp_path / "new"), "--robot", "arm4"]) == 0
    assert main(["export", str(tmp_path / "new"), "--to", "c"]) == 2
    assert "othing has been learned yet" in capsys.readouterr().err
    assert not (tmp_path / "new" / "exports").exists()


@pytest.mark.slow
def test_an_export_is_written_whole_and_replaces_only_its_own(lab: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    found = etude.export(lab, "c", folder, name="arm")
    assert set(found.files) == {"arm.h", "arm.c", "arm_test.c", "CMakeLists.txt"}
    mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    assert (mark["target"], set(mark["files"])) == ("c", set(found.files))
    assert mark["model_sha256"] in (folder / "arm.h").read_text(encoding="utf-8")
    etude.export(lab, "c", folder, name="other")
    assert not (folder / "arm.h").exists()
    own = tmp_path / "mine"
    own.mkdir()
    (own / "thesis.txt").write_text("years of work", encoding="utf-8")
    with pytest.raises(UsageError, match="not replaced"):
        etude.export(lab, "c", own)
    assert [p.name for p in own.iterdir()] == ["thesis.txt"]
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(EtudeError):
        etude.export(lab, "c", tmp_path / "file" / "deeper")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "mine", "out"]


@pytest.mark.slow
def test_another_package_s_target_is_a_function(lab: Path, tmp_path: Path) -> None:
    found = export(lab, "test_predict:listing", tmp_path / "list", prefix="- ")
    assert (tmp_path / "list" / "commands.txt").read_text() == "- waist\n- shoulder\n- elbow\n- wrist\n"
    assert found.notes[0].startswith("No model was promoted yet. The newest model is used, of log 1")
    assert found.notes[1:] == ("4 commands.",)
    with pytest.raises(UsageError, match="there is no target of models 'd'"):
        export(lab, "d")


def listing(model: Any, kind: Any, spec: Any, options: Any) -> Delivered:
    """A target: the names of the commands."""
    text = "".join(f"{options['prefix']}{name}\n" for name in model.commands)
    return Delivered({"commands.txt": text.encode()}, (f"{len(model.commands)} commands.",))


def test_only_what_was_given_is_passed_on() -> None:
    assert given(real=None, variance=False, rate=0.0, more=("a-b=c=d",)) == {"rate": 0.0, "a_b": "c=d"}
    with pytest.raises(UsageError, match="NAME=VALUE"):
        given(more=("x",))
    for twice in (("seed=1", "seed=1"), ("half-life=3", "half_life=4")):
        with pytest.raises(UsageError, match="is given twice"):
            given(more=twice)
    with pytest.raises(UsageError, match="--to t has no option --set a_b=VALUE"):
        taken({"a_b": 1}, Empty, "t")


@dataclass
class Empty:
    """No options."""
