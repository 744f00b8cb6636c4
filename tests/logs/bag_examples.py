"""Bags written by rosbags itself, of the small robot's motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from log_examples import JOINTS, make_log
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from etude.logs.ros_messages import DEFINITIONS

LOG = make_log(rate=25.0)
ORDER = (2, 0, 1)
EPOCH = 1_700_000_000
STORE = get_typestore(Stores.LATEST)
for name, text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(text, name))
STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nsensor_msgs/JointState measured_joint_state\n"
        "sensor_msgs/JointState desired_joint_state\nfloat64 load\n",
        "lab_msgs/msg/ArmState",
    )
)
Message = tuple[str, str, int, Any]
"""Topic, type, ns, message."""


def made(msgtype: str, **fields: Any) -> Any:
    return STORE.types[msgtype](**fields)


def nanoseconds(t: float) -> int:
    return EPOCH * 10**9 + round(t * 1e9)


def header(t: float) -> Any:
    ns = nanoseconds(t)
    stamp = made("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id="")


def joint_state(row: int, *, t: float, names: Iterable[str] = JOINTS, effort: bool = True) -> Any:
    """Row of the log with the joints in another order, which changes."""
    order = np.roll(ORDER, row % 3)
    own = tuple(names)
    return made(
        "sensor_msgs/msg/JointState",
        header=header(t),
        name=[own[k] for k in order],
        position=LOG["q"][row, order],
        velocity=np.zeros(0),
        effort=LOG["command"][row, order] if effort else np.zeros(0),
    )


def joint_states(topic: str = "/joint_states", **how: Any) -> list[Message]:
    kind = "sensor_msgs/msg/JointState"
    return [(topic, kind, nanoseconds(t), joint_state(i, t=t, **how)) for i, t in enumerate(LOG.t)]


def point(row: int, values: str = "q") -> Any:
    empty = np.zeros(0)
    return made(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        positions=LOG[values][row],
        velocities=empty,
        accelerations=empty,
        effort=LOG["command"][row],
        time_from_start=made("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
    )


def controller_states(topic: str = "/controller/state") -> list[Message]:
    kind = "control_msgs/msg/JointTrajectoryControllerState"
    return [
        (
            topic,
            kind,
            nanoseconds(t),
            made(
                kind,
                header=header(t),
                joint_names=list(JOINTS),
                desired=point(i, "command"),
                actual=point(i),
                error=point(i),
            ),
        )
        for i, t in enumerate(LOG.t)
    ]


def dynamic_states(topic: str = "/dynamic_joint_states") -> list[Message]:
    kind, inner = "control_msgs/msg/DynamicJointState", "control_msgs/msg/InterfaceValue"
    return [
        (
            topic,
            kind,
            nanoseconds(t),
            made(
                kind,
                header=header(t),
                joint_names=list(JOINTS),
                interface_values=[
                    made(
                        inner,
                        interface_names=["position", "effort"],
                        values=np.array([LOG["q"][i, k], LOG["command"][i, k]]),
                    )
                    for k in range(len(JOINTS))
                ],
            ),
        )
        for i, t in enumerate(LOG.t)
    ]


def arm_states(topic: str = "/arm_state") -> list[Message]:
    kind = "lab_msgs/msg/ArmState"
    return [
        (
            topic,
            kind,
            nanoseconds(t),
            made(
                kind,
                header=header(t),
                measured_joint_state=joint_state(i, t=t),
                desired_joint_state=joint_state(i, t=t, effort=False),
                load=1.0,
            ),
        )
        for i, t in enumerate(LOG.t)
    ]


def write_bag(
    folder: Path,
    messages: Iterable[Message],
    plugin: str = "SQLITE3",
    compression: str = "",
    version: int = 9,
) -> Path:
    """A bag folder of these messages."""
    writer = Writer(folder, version=version, storage_plugin=StoragePlugin[plugin])
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for topic, kind, ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], ns, STORE.serialize_cdr(message, kind))
    return folder


def storage(folder: Path) -> Path:
    """The one storage in a bag folder."""
    return next(one for one in folder.iterdir() if one.name != "metadata.yaml")


Messages = Callable[[], list[Message]]
