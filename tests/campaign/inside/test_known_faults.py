"""What an earlier version left on a user's disk: `status` and `promote` name it where it applies, and no more
once the command that they print was run.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from etude import ask, cli, status, tell
from etude.campaign import Campaign, chained, create_campaign, open_campaign
from etude.campaign.record.known_faults import FAULTS
from etude.storage import GENERATION
from etude.trajectories import from_json

URDF = """<robot name="two">
<link name="ROOT"/>
<link name="upper"><inertial><mass value="1"/><origin xyz="0 0 .1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><mass value="1.5"/><origin xyz="0.2 0 0"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="ROOT"/><child link="upper"/><origin xyz="0 0 .3"/>
<axis xyz="0 0 1"/><limit lower="-1.2" upper="1.1" velocity="1.5" effort="50"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 .3"/>
<axis xyz="0 1 0"/><limit lower="-0.8" upper="0.9" velocity="1.2" effort="60"/></joint>
</robot>
"""
SHORT = {
    "candidates = 24": "candidates = 1",
    "refine = 2": "refine = 0",
    "duration = 60.0": "duration = 8.0",
    ', "standing", "slow", "ripple", "gip_lin", "all_lin"': "",
}
MJCF = """<mujoco><worldbody><body name="arm"><joint name="one" axis="0 1 0" range="-60 60"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".03" mass=".5"/></body></worldbody>ACTUATORS</mujoco>"""
Made = Callable[..., Path]


def shortened(path: Path) -> None:
    text = (path / "campaign.toml").read_text()
    for old, new in SHORT.items():
        text = text.replace(old, new)
    (path / "campaign.toml").write_text(text)


@pytest.fixture
def made(tmp_path: Path) -> Made:
    def make(root: str = "world", mounting: str = "rotation = [0.0, 0.3, 0.0]") -> Path:
        (tmp_path / "two.urdf").write_text(URDF.replace("ROOT", root))
        path = create_campaign(tmp_path / "lab", str(tmp_path / "two.urdf"))[0].path
        shortened(path)
        if mounting:
            robot = path / "robot.toml"
            robot.write_text(f"{robot.read_text()}\n[mounting]\n{mounting}\n")
        return path

    return make


def aged(path: Path, generation: int = 1) -> Path:
    """The folder as an earlier generation would have left it; the first one does not state any."""
    stated = {} if generation == 1 else {"generation": generation}
    journal, lines = path / "journal.jsonl", list[str]()
    for line in journal.read_text().splitlines():
        facts = {k: v for k, v in json.loads(line).items() if k not in ("generation", "previous", "seal")}
        lines.append(chained(json.dumps(facts | stated), lines))
    journal.write_text("".join(f"{line}\n" for line in lines))
    for mark in path.glob("exports/*/etude-export.json"):
        words = json.loads(mark.read_text())
        del words["generation"]
        mark.write_text(json.dumps(words))
    return path


def codes(path: Path) -> list[tuple[str, str]]:
    return [(one["code"], one["path"]) for one in status(open_campaign(path))["known_faults"]]


def log_of(campaign: Campaign, number: int) -> Path:
    motion = from_json((campaign.proposal(number) / "trajectory.json").read_bytes())
    t = np.arange(0.0, motion.duration, 1.0 / campaign.spec.rate)
    q, qd, qdd = motion.motion(t, 3).orders[:3]
    noise = 0.05 * np.random.default_rng(number).standard_normal(q.shape)
    columns = np.column_stack([t, q, qd, 2.0 * qdd + 1.5 * qd + 3.0 * np.sin(q) + noise])
    names = [f"{what}_{axis}" for what in ("q", "qd", "tau") for axis in campaign.axes]
    path = campaign.path.parent / "log.csv"
    pl.DataFrame(dict(zip(["time", *names], columns.T, strict=True))).write_csv(path)
    return path


@pytest.mark.parametrize(
    ("root", "mounting", "named"),
    [
        ("world", "rotation = [0.0, 0.3, 0.0]", True),
        pytest.param("world", "position = [0.0, 0.0, 0.5]", True, marks=pytest.mark.slow),
        ("world", "rotation = [0.0, 0.0, 0.0]", False),
        ("world", "", False),
        ("base", "rotation = [0.0, 0.3, 0.0]", False),
    ],
)
def test_a_lost_mounting_is_named_where_there_was_one(
    made: Made, root: str, mounting: str, named: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(root, mounting)
    ask(open_campaign(path), go_on=True, start="home", formats=("ros2_csv",))
    assert codes(path) == []  # what this version wrote
    aged(path)
    folders = [f"proposals/0001{own}" for own in ("", "/from_home", "/from_home/ros2_csv")]
    assert sorted(codes(path)) == ([("mounting", own) for own in folders] if named else [])
    assert cli.main(["status", str(path)]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("UNSAFE")]
    assert len(lines) == 3 * named
    if named:
        again = re.search(r"Write it again: etude (.*)$", lines[0])
        assert again is not None
        assert cli.main(shlex.split(again[1])) == 0
        assert ("mounting", folders[0]) not in codes(path)
        ask(open_campaign(path), go_on=True, start="home", formats=("ros2_csv",))
        assert codes(path) == []


def test_torques_divided_by_a_gear_are_named(tmp_path: Path) -> None:
    """Only of an MJCF whose joints have actuators with a gear."""
    actuators = '<actuator><motor joint="one" gear="{}" ctrlrange="-9 9"/></actuator>'
    for gear, named in (("1", False), ("50 0 0 0 0 0", True)):
        (tmp_path / f"{named}.xml").write_text(MJCF.replace("ACTUATORS", actuators.format(gear)))
        words = ["--robot", str(tmp_path / f"{named}.xml"), "--velocity", "one=1", "--acceleration", "one=2"]
        path = tmp_path / f"lab{named}"
        assert cli.main(["init", str(path), *words]) == 0
        shortened(path)
        ask(open_campaign(path), go_on=True)
        assert codes(path) == []
        assert codes(aged(path, generation=2)) == [("gear", "proposals/0001")] * named


def test_a_motion_that_does_not_end_at_rest(made: Made) -> None:
    path = made("base", "")
    ask(open_campaign(path), go_on=True, formats=("ros2_csv",))
    certificate = path / "proposals/0001/ros2_csv/certificate.json"
    certificate.write_text(certificate.read_text().replace('"at_rest": true', '"at_rest": false'))
    assert codes(path) == []
    assert codes(aged(path)) == [("moving_end", "proposals/0001/ros2_csv")]
    assert cli.main(["abandon", str(path), "1"]) == 0
    assert codes(path) == []


def test_an_exported_model_and_what_was_learned(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")  # no compiler: what is written is not what is looked at
    path = made()
    config = path / "campaign.toml"
    config.write_text(config.read_text().replace('rung = "auto"', 'rung = "identified"'))
    campaign = open_campaign(path)
    assert campaign.config.model.rung == "identified"
    ask(campaign, go_on=True)
    tell(campaign, log_of(campaign, 1), accept=("sign", "scale", "gravity"))
    for to, output in (("c", None), ("c", tmp_path / "robot"), ("urdf", None)):
        more = [] if output is None else ["--output", str(output)]
        assert cli.main(["export", str(path), "--to", to, *more]) == 0
    assert codes(path) == []
    mark = tmp_path / "robot" / "etude-export.json"
    assert json.loads(mark.read_text())["generation"] == GENERATION
    aged(path)
    mark.write_text(mark.read_text().replace(f'"generation": {GENERATION},', ""))
    found = codes(path)
    assert ("mounting", "models/0001") in found
    for place in ("exports/c", str(tmp_path / "robot")):  # the journal knows where it went
        assert {code for code, own in found if own == place} == {"mounting", "clamped_physics"}
    assert [code for code, own in found if own == "exports/urdf"] == ["mounting"]
    for command in {one["command"] for one in status(open_campaign(path))["known_faults"]}:
        if "etude export" in command:
            assert cli.main(shlex.split(command)[1:]) == 0
    assert {own for _, own in codes(path)} == {"proposals/0001", "models/0001"}


def test_a_model_of_a_joint_that_no_log_moved(made: Made) -> None:
    path = made("base", "")
    config = path / "campaign.toml"
    config.write_text(config.read_text().replace('rung = "auto"', 'rung = "identified"'))
    campaign = open_campaign(path)
    log = log_of(campaign, ask(campaign, go_on=True).number)
    sag = 0.01 * pl.col("time").sin()
    held = {"q_lift": 0.3 + sag, "qd_lift": 0.01 * pl.col("time").cos(), "tau_lift": -800.0 * sag}
    pl.read_csv(log).with_columns(**held).write_csv(log)
    tell(campaign, log, accept=("sign", "scale", "gravity"), foreign=True)
    assert codes(path) == []
    assert codes(aged(path)) == [("held_joint", "models/0002")]


def test_every_fault_is_told_of_in_the_documentation() -> None:
    page = (Path(__file__).parents[3] / "docs" / "known_faults.md").read_text()
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)) == set(FAULTS)
