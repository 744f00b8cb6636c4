"""The programs that play exported files, run against stand-ins of the ROS packages that they import."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

START = {"a": 0.1, "b": -0.2}
ROW = "nanoseconds,position/a,position/b,velocity/a,velocity/b,acceleration/a,acceleration/b\n"
POINTS = ROW + "0,0.1,-0.2,0.0,0.0,0.0,0.0\n1500000000,0.5,0.5,0.0,0.0,0.0,0.0\n"
SETPOINTS = (
    "time,north,east,down,vnorth,veast,vdown,anorth,aeast,adown,yaw\n"
    "0.0,1.0,2.0,-3.0,0,0,0,0,0,0,1.5\n0.02,1.1,2.0,-3.0,5.0,0,0,0,0,0,1.5\n0.04,1.2,2.0,-3.0,0,0,0,0,0,0,1.5\n"
)


class Record:
    """A message: whatever fields are set."""

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)


class Ros:
    """What a robot and its controller do with a player, and what they heard."""

    def __init__(self) -> None:
        self.now, self.sent, self.goal = 0, [], None
        self.state: dict[str, float] = dict(START)
        self.answers, self.accepted, self.code = True, True, 0
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.timers: list[Callable[[], None]] = []
        self.script: Callable[[Ros], bool] = lambda _: True

    def spin(self, *_: Any, **__: Any) -> None:
        self.now += 20_000_000
        if "/joint_states" in self.callbacks:
            self.callbacks["/joint_states"](Record(name=list(self.state), position=list(self.state.values())))
        for timer in self.timers:
            timer()


class Node:
    ros: Ros

    def __init__(self, name: str) -> None: ...
    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.ros.now))

    def create_subscription(self, _: Any, topic: str, callback: Any, __: Any) -> None:
        self.ros.callbacks[topic] = callback

    def create_publisher(self, kind: Any, topic: str, _: Any) -> Any:
        return SimpleNamespace(publish=lambda m: self.ros.sent.append((topic, m)))

    def create_timer(self, _: float, callback: Any) -> None:
        self.ros.timers.append(callback)

    def destroy_node(self) -> None: ...


def future(result: Any) -> Any:
    return SimpleNamespace(result=lambda: result)


def client_of(ros: Ros) -> type:
    class Client:
        def __init__(self, _: Any, __: Any, name: str) -> None:
            assert name == "/joint_trajectory_controller/follow_joint_trajectory"

        def wait_for_server(self, timeout_sec: float) -> bool:
            return ros.answers

        def send_goal_async(self, goal: Any) -> Any:
            ros.goal = goal
            ended = future(Record(result=Record(error_code=ros.code, error_string="tolerance")))
            return future(Record(accepted=ros.accepted, get_result_async=lambda: ended))

    return Client


class Action:
    class Goal:
        def __init__(self) -> None:
            self.trajectory = Record()

    class Result:
        SUCCESSFUL = 0


def module(name: str, **content: Any) -> ModuleType:
    made = ModuleType(name)
    made.__dict__.update(content)
    return made


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Ros:
    own = Ros()

    class OwnNode(Node):
        ros = own

    profile: dict[str, Any] = {
        name: type(name, (), {"BEST_EFFORT": 0, "TRANSIENT_LOCAL": 0, "KEEP_LAST": 0})
        for name in ("DurabilityPolicy", "HistoryPolicy", "ReliabilityPolicy")
    }
    status = type("VehicleStatus", (Record,), {"NAVIGATION_STATE_OFFBOARD": 14})
    modules = [
        module(
            "rclpy",
            init=lambda: None,
            shutdown=lambda: None,
            ok=lambda: own.script(own),
            spin_once=own.spin,
            spin_until_future_complete=own.spin,
        ),
        module("rclpy.node", Node=OwnNode),
        module("rclpy.action", ActionClient=client_of(own)),
        module("rclpy.qos", QoSProfile=Record, **profile),
        module("builtin_interfaces.msg", Duration=Record),
        module("control_msgs.action", FollowJointTrajectory=Action),
        module("sensor_msgs.msg", JointState=Record),
        module("trajectory_msgs.msg", JointTrajectoryPoint=Record),
        module(
            "px4_msgs.msg",
            OffboardControlMode=Record,
            TrajectorySetpoint=Record,
            VehicleLocalPosition=Record,
            VehicleStatus=status,
        ),
    ]
    for one in modules:
        monkeypatch.setitem(sys.modules, one.__name__, one)
    return own


def player(name: str, folder: Path, table: str, text: str) -> Any:
    """The program beside its table, as a module."""
    path = folder / "play.py"
    shutil.copy(str(files("etude.deploy.exporters") / "players" / name), path)
    (folder / table).write_text(text)
    spec = importlib.util.spec_from_file_location("etude_player", path)
    assert spec
    assert spec.loader
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


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
    assert "has not been heard for 2 s" in capsys.readouterr().err
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
