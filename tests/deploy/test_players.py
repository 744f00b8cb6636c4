"""The programs that play exported files, run against stand-ins of the ROS packages that they import."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from ros_stubs import Record, Ros, installed, loaded

START = {"a": 0.1, "b": -0.2}
ROW = "nanoseconds,position/a,position/b,velocity/a,velocity/b,acceleration/a,acceleration/b\n"
POINTS = ROW + "0,0.1,-0.2,0.0,0.0,0.0,0.0\n1500000000,0.5,0.5,0.0,0.0,0.0,0.0\n"
SETPOINTS = (
    "time,north,east,down,vnorth,veast,vdown,anorth,aeast,adown,yaw\n"
    "0.0,1.0,2.0,-3.0,0,0,0,0,0,0,1.5\n0.02,1.1,2.0,-3.0,5.0,0,0,0,0,0,1.5\n0.04,1.2,2.0,-3.0,0,0,0,0,0,0,1.5\n"
)


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Ros:
    own = installed(monkeypatch)
    own.state = dict(START)
    return own


def player(name: str, folder: Path, table: str, text: str) -> Any:
    """The program beside its table, as a module."""
    path = folder / "play.py"
    package = "etude_quadrotor.export" if name == "play_setpoints.py" else "etude.deploy.exporters"
    shutil.copy(str(files(package) / "players" / name), path)
    (folder / table).write_text(text)
    return loaded(path)


@pytest.fixture
def points(ros: Ros, tmp_path: Path) -> Any:
    return player("play_points.py", tmp_path, "points.csv", POINTS)


def test_points_are_sent_where_the_motion_begins(ros: Ros, points: Any) -> None:
    assert points.main([]) == 0
    sent = ros.goal.trajectory
    assert sent.joint_names == ["a", "b"]
    assert [p.positions for p in sent.points] == [[0.1, -0.2], [0.5, 0.5]]
    assert [p.effort for p in sent.points] == [[], []]
    assert [(p.time_from_start.sec, p.time_from_start.nanosec) for p in sent.points] == [
        (0, 0),
        (1, 500000000),
    ]


@pytest.mark.parametrize(
    "wrong", [{"a": 0.15}, {"b": float("nan")}, {"b": None}], ids=["away", "nan", "missing"]
)
def test_nothing_is_sent_elsewhere(
    ros: Ros, points: Any, wrong: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.state = {name: value for name, value in {**START, **wrong}.items() if value is not None}
    assert points.main([]) == 1
    assert ros.goal is None
    assert next(iter(wrong)) in capsys.readouterr().err


def test_nothing_is_sent_to_a_robot_that_moves(
    ros: Ros, points: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.speeds = {"b": -1.5}
    assert points.main([]) == 1
    assert ros.goal is None
    assert "b moves at -1.500" in capsys.readouterr().err


def test_the_start_is_as_near_as_the_certificate_keeps(ros: Ros, points: Any, tmp_path: Path) -> None:
    rows = [{"axis": "b", "quantity": "position", "tracking_margin": m} for m in (0.004, 0.01, 0.0)]
    (tmp_path / "certificate.json").write_text(json.dumps({"rows": rows}))
    ros.state = {"a": 0.119, "b": -0.205}
    assert points.main([]) == 1
    assert points.main(["--tolerance", "0.02"]) == 0
    ros.state = {"a": 0.119, "b": -0.203}
    assert points.main([]) == 0


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_cancels_the_motion(
    ros: Ros, points: Any, sign: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else the controller plays on to the end."""

    def interrupted(_: Ros) -> bool:
        os.kill(os.getpid(), sign)
        return False

    ros.script = interrupted
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert points.main([]) == 130
    finally:
        signal.signal(signal.SIGTERM, before)
    assert ros.cancelled == 1
    assert "cancelled" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("facts", "named"),
    [
        ({"answers": False}, "does not answer"),
        ({"accepted": False}, "refused"),
        ({"code": -4}, "not finished: -4"),
    ],
)
def test_a_controller_that_does_not_play_is_said(
    ros: Ros, points: Any, facts: Any, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.__dict__.update(facts)
    assert points.main([]) == 1
    assert named in capsys.readouterr().err


@pytest.fixture
def setpoints(ros: Ros, tmp_path: Path) -> Any:
    return player("play_setpoints.py", tmp_path, "setpoints.csv", SETPOINTS)


STATUS = "/fmu/out/vehicle_status"


def flight(
    place: tuple[float, float, float],
    *modes: int | None,
    speed: float = 0.0,
    armed: int = 2,
    status: str = STATUS,
    position: str = "/fmu/out/vehicle_local_position",
) -> Callable[[Ros], bool]:
    """The vehicle there, and its mode at each tick; the node is stopped after the last."""
    ticks = iter(modes)

    def script(ros: Ros) -> bool:
        mode = next(ticks, None)
        if mode is not None and position in ros.callbacks:
            here = dict(zip("xyz", place, strict=True))
            ros.callbacks[position](Record(**here, vx=0.0, vy=speed, vz=0.0, xy_valid=True, z_valid=True))
        if mode is not None and status in ros.callbacks:
            ros.callbacks[status](Record(nav_state=mode, arming_state=armed))
        return mode is not None

    return script


def north(ros: Ros) -> list[float]:
    return [m.position[0] for topic, m in ros.sent if topic == "/fmu/in/trajectory_setpoint"]


def test_setpoints_wait_for_offboard_mode_play_once_and_hold(ros: Ros, setpoints: Any) -> None:
    ros.script = flight((1.0, 2.0, -3.0), 2, 2, 14, 14, 14, 14, 14)
    assert setpoints.main([]) == 0
    assert north(ros) == [1.0, 1.0, 1.0, 1.1, 1.2, 1.2, 1.2]
    modes = [m for topic, m in ros.sent if topic == "/fmu/in/offboard_control_mode"]
    assert len(modes) == 7
    assert all(m.position for m in modes)
    played = [m for topic, m in ros.sent if topic == "/fmu/in/trajectory_setpoint"][3]
    assert (played.velocity[0], played.yaw) == (5.0, 1.5)


def test_a_vehicle_that_is_elsewhere_gets_no_setpoint(
    ros: Ros, setpoints: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.script = flight((1.0, 2.0, -2.0), 2, 2, 14, 14)
    assert setpoints.main([]) == 1
    assert north(ros) == []
    assert "the motion begins at" in capsys.readouterr().err


WAITS, FLIES = {"nav_state": 2, "arming_state": 2}, {"nav_state": 14, "arming_state": 2}
THERE = {"x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.0, "vy": 0.0, "vz": 0.0, "xy_valid": True, "z_valid": True}
LOOKS = {"heading": 1.5, "heading_good_for_control": True}


def told(*ticks: tuple[dict[str, int], dict[str, Any]]) -> Callable[[Ros], bool]:
    """PX4's status and what differs of its position, tick by tick."""
    left = iter(ticks)

    def script(ros: Ros) -> bool:
        found = next(left, None)
        if found is not None and STATUS in ros.callbacks:
            ros.callbacks["/fmu/out/vehicle_local_position"](Record(**{**THERE, **LOOKS, **found[1]}))
            ros.callbacks[STATUS](Record(**found[0]))
        return found is not None

    return script


@pytest.mark.parametrize(
    ("look", "named"),
    [
        ({"heading": -1.6}, "turn it 178 deg clockwise"),
        ({"heading": 2.5}, "turn it 57 deg anticlockwise"),
        ({"heading": float("nan")}, "the nose points to nan"),
        ({"heading_good_for_control": False}, "does not know its heading"),
    ],
)
def test_a_vehicle_that_looks_elsewhere_gets_no_setpoint(
    ros: Ros, setpoints: Any, look: Any, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """PX4 would turn it at once, half around at lift-off."""
    ros.script = told((WAITS, look), (WAITS, look), (FLIES, look), (FLIES, look))
    assert setpoints.main([]) == 1
    assert north(ros) == []
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_headings_are_angles(ros: Ros, setpoints: Any, turns: int) -> None:
    look = {"heading": 1.4 + turns * 6.283185307}
    ros.script = told(*[(WAITS, look)] * 2, *[(FLIES, look)] * 2)
    assert setpoints.main([]) == 0
    assert north(ros) == [1.0, 1.0, 1.0, 1.1]


@pytest.mark.parametrize(
    ("place", "named", "last"),
    [
        ({"x": 51.0}, "49.90 m from its set-point", 51.0),
        ({"z": -1.5}, "1.50 m from its set-point", 1.0),
        ({"xy_valid": False}, "has lost its position", 1.0),
        ({"z_valid": False}, "has lost its position", 1.0),
        ({"y": float("nan")}, "has lost its position", 1.0),
    ],
    ids=["far", "fallen", "no place", "no height", "nan"],
)
def test_a_vehicle_that_is_no_more_on_its_way_is_told_to_stay(
    ros: Ros, setpoints: Any, place: Any, named: str, last: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """A far set-point would have it cross the room, or, after a leap of the estimate, leave it."""
    ros.script = told((WAITS, {}), (FLIES, {}), *[(FLIES, place)] * 9)
    assert setpoints.main([]) == 1
    assert named in capsys.readouterr().err
    sent = [m for topic, m in ros.sent if topic == "/fmu/in/trajectory_setpoint"]
    assert sent[-1].position[0] == last
    assert len(sent) <= 3
    if "x" in place or "z" in place:
        assert [*sent[-1].position] == [{**THERE, **place}[name] for name in "xyz"]
        assert [*sent[-1].velocity, *sent[-1].acceleration] == [0.0] * 6
    ros.sent.clear()


CERTIFICATE = {
    "rows": [
        {"axis": "x", "quantity": "position", "lower": 1.0, "upper": 9.0, "tracking_margin": 0.4},
        {"axis": "y", "quantity": "position", "lower": -9.0, "upper": 1.3, "tracking_margin": 0.4},
        {"axis": "z", "quantity": "position", "lower": 1.0, "upper": 9.0, "tracking_margin": 0.2},
        {"axis": "z", "quantity": "position", "lower": 0.0, "upper": 9.0, "tracking_margin": 0.0},
        {"axis": "vehicle", "quantity": "speed", "lower": -5.0, "upper": 5.0, "tracking_margin": 0.1},
    ]
}
"""Set-points are at x 2 (east), y 1 to 1.2 (north) and z 3."""


@pytest.mark.parametrize(
    ("place", "named"),
    [
        ({"y": 2.79}, ""),
        ({"y": 2.81}, "0.81 m from its set-point along x, more than 0.80 m"),
        ({"x": 1.55}, ""),
        ({"x": 1.75}, "along y, more than"),
        ({"x": 0.35}, ""),
        ({"x": 0.1}, "along y, more than 0.80 m"),
        ({"z": -3.41}, "0.41 m from its set-point along z, more than 0.40 m"),
        ({"z": -3.39}, ""),
    ],
)
def test_how_far_it_may_get_is_what_the_certificate_keeps(
    ros: Ros, setpoints: Any, tmp_path: Path, place: Any, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Twice the margin of its own axis, and no farther than the room reaches: y ends at 1.7."""
    (tmp_path / "certificate.json").write_text(json.dumps(CERTIFICATE))
    ros.script = told((WAITS, {}), (FLIES, {}), (FLIES, place))
    assert setpoints.main([]) == (1 if named else 0)
    assert named in capsys.readouterr().err


def test_what_is_said_counts_before_the_certificate(ros: Ros, setpoints: Any, tmp_path: Path) -> None:
    (tmp_path / "certificate.json").write_text(json.dumps(CERTIFICATE))
    ros.script = told((WAITS, {}), (FLIES, {}), (FLIES, {"y": 4.0}))
    assert setpoints.main(["--away", "5"]) == 0


def test_how_far_it_may_get_can_be_said(ros: Ros, setpoints: Any) -> None:
    ros.script = told((WAITS, {}), *[(FLIES, {"x": 2.5})] * 1)
    assert setpoints.main(["--away", "5", "--tolerance", "2"]) == 0


def test_offboard_mode_that_was_on_before_begins_nothing(
    ros: Ros, setpoints: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another program flies it, or this one's last run, whose set-point is held."""
    ros.script = told(*[(FLIES, {})] * 9)
    assert setpoints.main([]) == 1
    assert north(ros) == []
    assert "in offboard mode already" in capsys.readouterr().err


def test_a_pilot_who_takes_over_ends_the_motion(
    ros: Ros, setpoints: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.script = flight((1.0, 2.0, -3.0), 2, 14, 14, 2, 14, 14)
    assert setpoints.main([]) == 1
    assert "offboard mode ended" in capsys.readouterr().err
    assert north(ros) == [1.0, 1.0, 1.1], "and nothing more is sent, also where offboard mode comes again"


@pytest.mark.parametrize("version", [None, 0, 1, 4])
def test_topics_are_those_of_the_messages_version(
    ros: Ros, tmp_path: Path, version: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PX4's documentation: "_v" and MESSAGE_VERSION after the name, but for version 0 and before 1.16."""
    messages = sys.modules["px4_msgs.msg"]
    if version is not None:
        monkeypatch.setattr(messages.VehicleStatus, "MESSAGE_VERSION", version, raising=False)
    own = player("play_setpoints.py", tmp_path, "setpoints.csv", SETPOINTS)
    name = STATUS if not version else f"{STATUS}_v{version}"
    ros.script = flight((1.0, 2.0, -3.0), 2, 2, 14, 14, status=name)
    assert own.main([]) == 0
    assert north(ros) == [1.0, 1.0, 1.0, 1.1]
    others = [topic for topic in ros.callbacks if topic.startswith(STATUS) and topic != name]
    assert not others or version is None, "another version's bytes would be read wrongly"


def test_older_messages_are_heard_by_any_name(ros: Ros, setpoints: Any) -> None:
    ros.script = flight(
        (1.0, 2.0, -3.0), 2, 14, 14, status=f"{STATUS}_v1", position="/fmu/out/vehicle_local_position_v1"
    )
    assert setpoints.main([]) == 0
    assert north(ros) == [1.0, 1.0, 1.1]


@pytest.mark.parametrize(
    ("facts", "modes", "named", "sent"),
    [
        ({"status": "/elsewhere"}, [2] * 300, "nothing answers on /fmu/out/vehicle_status", 0),
        ({"position": "/elsewhere"}, [2] * 300, "nothing answers on /fmu/out/vehicle_local_position", 0),
        ({"speed": 0.5}, [2, 14, 14], "moves at 0.50 m/s", 0),
        ({"speed": float("nan")}, [2, 14, 14], "moves at nan", 0),
        ({"armed": 1}, [2, 14, 14, 14], "", 4),
    ],
    ids=["no status", "no position", "moves", "nan", "not armed"],
)
def test_a_vehicle_that_is_silent_or_not_ready_plays_nothing(
    ros: Ros,
    setpoints: Any,
    facts: Any,
    modes: Any,
    named: str,
    sent: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    ros.script = flight((1.0, 2.0, -3.0), *modes, **facts)
    assert setpoints.main([]) == (1 if named else 0)
    assert north(ros) == [1.0] * sent
    assert named in capsys.readouterr().err


def test_a_vehicle_that_falls_silent_while_it_plays_gets_nothing_more(
    ros: Ros, setpoints: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    heard = flight((1.0, 2.0, -3.0), 2, 14, 14)
    ros.script = lambda own: heard(own) or True
    assert setpoints.main([]) == 1
    assert "has arrived for 2 s" in capsys.readouterr().err
    assert len(north(ros)) < 110


def test_it_says_its_state_once_a_second(
    ros: Ros, setpoints: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    ros.script = flight((1.0, 2.0, -3.0), *[2] * 100, *[14] * 120)
    assert setpoints.main([]) == 0
    said = capsys.readouterr().out.splitlines()
    assert 4 <= len(said) <= 6
    assert "switch to offboard mode" in said[0]
    assert "the last set-point is held, 0.20 m from" in said[-1]
