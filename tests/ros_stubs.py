"""Stand-ins of rclpy and of the message packages that players import; time is what `Ros.spin` makes it."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest


class Record:
    """A message: whatever fields are set."""

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)


class Ros:
    """What a robot and its controller do with a player, and what they heard."""

    def __init__(self) -> None:
        self.now, self.sent, self.goal = 0, [], None
        self.state: dict[str, float] = {}
        self.answers, self.accepted, self.code = True, True, 0
        self.speeds: dict[str, float] = {}
        self.cancelled = 0
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.timers: list[Callable[[], None]] = []
        self.script: Callable[[Ros], bool] = lambda _: True

    def spin(self, *_: Any, **__: Any) -> None:
        self.now += 20_000_000
        if "/joint_states" in self.callbacks:
            speeds = [self.speeds.get(name, 0.0) for name in self.state] if self.speeds else []
            state = Record(name=list(self.state), position=list(self.state.values()), velocity=speeds)
            self.callbacks["/joint_states"](state)
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


def future(result: Any, pending: Callable[[], bool] = lambda: False) -> Any:
    return SimpleNamespace(result=lambda: result, done=lambda: not pending())


def client_of(ros: Ros) -> type:
    class Client:
        def __init__(self, _: Any, __: Any, name: str) -> None:
            assert name == "/joint_trajectory_controller/follow_joint_trajectory"

        def wait_for_server(self, timeout_sec: float) -> bool:
            return ros.answers

        def send_goal_async(self, goal: Any) -> Any:
            ros.goal = goal
            ended = future(
                Record(result=Record(error_code=ros.code, error_string="tolerance")),
                lambda: not ros.script(ros),
            )

            def cancel() -> Any:
                ros.cancelled += 1
                return future(Record())

            return future(
                Record(accepted=ros.accepted, get_result_async=lambda: ended, cancel_goal_async=cancel)
            )

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


def installed(monkeypatch: pytest.MonkeyPatch) -> Ros:
    """The packages can be imported, and all nodes are of this one."""
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
            init=lambda **_: None,
            shutdown=lambda: None,
            ok=lambda: own.script(own),
            spin_once=own.spin,
            spin_until_future_complete=own.spin,
        ),
        module("rclpy.node", Node=OwnNode),
        module("rclpy.signals", SignalHandlerOptions=SimpleNamespace(NO=0)),
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


def loaded(path: Path) -> Any:
    """A program as a module."""
    spec = importlib.util.spec_from_file_location("etude_player", path)
    assert spec
    assert spec.loader
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found
