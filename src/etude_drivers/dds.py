"""The topics of a trajectory controller of ROS 2, through the wheel of Cyclone DDS: ROS is not needed.

Names and types are ROS's: topic /a/b is `rt/a/b`, type pkg/msg/Name is `pkg::msg::dds_::Name_`.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.types import Array

NANO = 1_000_000_000  # in a second
KEPT = 200
"""Messages that wait to be taken."""


@dataclass(frozen=True, eq=False)
class Points:
    """A JointTrajectory: t (n,) s after `starts`, which is of the robot's clock; q, qd, qdd (n, J)."""

    starts: float
    joints: tuple[str, ...]
    t: Array
    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True, eq=False)
class JointRow:
    """Joints by name at a time of the robot's clock, in any order; what is not measured is empty."""

    t: float
    names: Sequence[str]
    q: Array
    qd: Array
    effort: Array


class Topics(Protocol):
    """Interface that the driver needs."""

    def now(self) -> float:
        """Our clock, s."""
        ...

    def open(self, wait: float) -> None:
        """Raises UsageError where nobody is on the other side after `wait` s."""
        ...

    def close(self) -> None: ...

    def drop(self) -> None:
        """Forgets joint states that have come in: they are old."""
        ...

    def state(self, wait: float) -> JointRow | None:
        """The next joint state; None: there was none for `wait` s."""
        ...

    def reference(self) -> JointRow | None:
        """The controller's current reference, as far as it reports it."""
        ...

    def send(self, points: Points) -> None: ...


class DdsTopics:
    """Over Cyclone DDS.

    Args:
        controller: name of the joint_trajectory_controller, with its namespace.
        states: topic of joint states. domain: ROS_DOMAIN_ID.
    """

    def __init__(self, controller: str, states: str, domain: int) -> None:
        self.controller, self.states, self.domain = controller.strip("/"), states.strip("/"), domain
        self.types = types()
        self._parts: SimpleNamespace | None = None
        self._reference: JointRow | None = None

    def now(self) -> float:
        return time.monotonic()

    def open(self, wait: float) -> None:
        endpoints = self._parts = self._create_endpoints()
        until = time.monotonic() + wait
        # a message that is sent before both sides know each other is lost
        while not (
            endpoints.goal.get_matched_subscriptions() and endpoints.joints.get_matched_publications()
        ):
            if time.monotonic() > until:
                raise UsageError(
                    f"/{self.controller}/joint_trajectory has no reader, or /{self.states} no writer",
                    where=f"ROS_DOMAIN_ID {self.domain}",
                    next_step="Check: ros2 control list_controllers; its name is the driver's address.",
                )
            time.sleep(0.02)

    def _create_endpoints(self) -> SimpleNamespace:
        domain, topic, pub, sub = (
            importlib.import_module(f"cyclonedds.{name}") for name in ("domain", "topic", "pub", "sub")
        )
        qos = importlib.import_module("cyclonedds.qos")
        policy, participant = qos.Policy, domain.DomainParticipant(self.domain)
        reliable = policy.Reliability.Reliable(NANO)
        sends = qos.Qos(reliable, policy.History.KeepLast(1), policy.Durability.Volatile)
        hears = qos.Qos(policy.Reliability.BestEffort, policy.History.KeepLast(KEPT))

        def named(name: str, kind: Any) -> Any:
            return topic.Topic(participant, f"rt/{name}", kind)

        kinds = self.types
        return SimpleNamespace(
            participant=participant,
            goal=pub.DataWriter(
                participant, named(f"{self.controller}/joint_trajectory", kinds.JointTrajectory), sends
            ),
            joints=sub.DataReader(participant, named(self.states, kinds.JointState), hears),
            controller=sub.DataReader(
                participant, named(f"{self.controller}/controller_state", kinds.ControllerState), hears
            ),
        )

    def close(self) -> None:
        self._parts = None  # the participant ends with it

    def drop(self) -> None:
        assert self._parts is not None
        while self._parts.joints.take(KEPT):
            pass

    def state(self, wait: float) -> JointRow | None:
        assert self._parts is not None
        limit = importlib.import_module("cyclonedds.util").duration(seconds=max(wait, 1e-3))
        for message in self._parts.joints.take_iter(timeout=limit):
            return JointRow(
                _seconds(message.header.stamp),
                message.name,
                np.array(message.position),
                np.array(message.velocity),
                np.array(message.effort),
            )
        return None

    def reference(self) -> JointRow | None:
        assert self._parts is not None
        for message in self._parts.controller.take(KEPT):
            point = message.reference
            self._reference = JointRow(
                _seconds(message.header.stamp),
                message.joint_names,
                np.array(point.positions),
                np.array(point.velocities),
                np.array(point.effort),
            )
        return self._reference

    def send(self, points: Points) -> None:
        assert self._parts is not None
        self._parts.goal.write(message_of(points, self.types))


def message_of(points: Points, kinds: SimpleNamespace) -> Any:
    """The JointTrajectory of DDS."""
    rows = [
        kinds.Point(
            q.tolist(), qd.tolist(), qdd.tolist(), [], kinds.Duration(*_seconds_and_nanoseconds(float(t)))
        )
        for t, q, qd, qdd in zip(points.t, points.q, points.qd, points.qdd, strict=True)
    ]
    header = kinds.Header(kinds.Time(*_seconds_and_nanoseconds(points.starts)), "")
    return kinds.JointTrajectory(header, list(points.joints), rows)


def types() -> SimpleNamespace:
    """Messages of ROS 2 as types of DDS.

    Of the state of the controller only the beginning is there, which all distributions share: behind it they
    differ, and a reader of plain CDR may stop.
    """
    idl, idl_types = (needed(f"cyclonedds.{name}", "the driver ros2") for name in ("idl", "idl.types"))

    def made(package: str, kind: str, /, **fields: Any) -> Any:
        return idl.make_idl_struct(kind, f"{package}::msg::dds_::{kind}_", fields)

    def of(kind: Any) -> Any:
        return idl_types.sequence[kind]

    parts = {"sec": idl_types.int32, "nanosec": idl_types.uint32}
    stamp, span = (made("builtin_interfaces", name, **parts) for name in ("Time", "Duration"))
    header = made("std_msgs", "Header", stamp=stamp, frame_id=str)
    floats = of(idl_types.float64)
    point = made(
        "trajectory_msgs",
        "JointTrajectoryPoint",
        positions=floats,
        velocities=floats,
        accelerations=floats,
        effort=floats,
        time_from_start=span,
    )
    return SimpleNamespace(
        Time=stamp,
        Duration=span,
        Header=header,
        Point=point,
        JointTrajectory=made(
            "trajectory_msgs", "JointTrajectory", header=header, joint_names=of(str), points=of(point)
        ),
        JointState=made(
            "sensor_msgs",
            "JointState",
            header=header,
            name=of(str),
            position=floats,
            velocity=floats,
            effort=floats,
        ),
        ControllerState=made(
            "control_msgs",
            "JointTrajectoryControllerState",
            header=header,
            joint_names=of(str),
            reference=point,
        ),
    )


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _seconds_and_nanoseconds(seconds: float) -> tuple[int, int]:
    whole = round(seconds * NANO)
    return whole // NANO, whole % NANO
