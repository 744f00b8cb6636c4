"""Bags written by rosbags itself, of the small robot's motion."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from log_examples import JOINTS, make_log
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from etude.logs.readers.ros_messages import DEFINITIONS

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


def made(msgtype: str, **fields: Any) -> Any:
    return STORE.types[msgtype](**fields)


NOTHING = made("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
NOWHERE = {
    "positions": np.zeros(0),
    "velocities": np.zeros(0),
    "accelerations": np.zeros(0),
    "effort": np.zeros(0),
    "time_from_start": NOTHING,
}
NOWHERE_AT_ALL = {"transforms": [], "velocities": [], "accelerations": [], "time_from_start": NOTHING}
Message = tuple[str, str, int, Any]
"""Topic, type, ns, message."""


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


def finger(t: float) -> Any:
    """A gripper's state."""
    return made(
        "sensor_msgs/msg/JointState",
        header=header(t),
        name=["finger"],
        position=np.array([0.02 * np.sin(t)]),
        velocity=np.zeros(0),
        effort=np.zeros(0),
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
    store: Any = STORE,
) -> Path:
    """A bag folder of these messages."""
    writer = Writer(folder, version=version, storage_plugin=StoragePlugin[plugin])
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for topic, kind, ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns, store.serialize_cdr(message, kind))
    return folder


def without_definitions(folder: Path) -> Path:
    """An SQLite bag (version 8) as of ROS 2 Humble and before, which did not store what messages hold."""
    with contextlib.closing(sqlite3.connect(storage(folder))) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
        database.commit()
    described = folder / "metadata.yaml"
    described.write_text(described.read_text().replace("version: 8", "version: 5"))
    return folder


def later_states(definition: str, topic: str = "/controller/state") -> tuple[list[Message], Any]:
    """The states of a controller by another release's definition, efforts as its output; and that release."""
    kind = "control_msgs/msg/JointTrajectoryControllerState"
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(definition, kind))
    own = store.types[kind]
    empty = made("trajectory_msgs/msg/JointTrajectoryPoint", **NOWHERE)
    many = made("trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", **{**NOWHERE_AT_ALL})
    blank = {"multi_dof_joint_names": [], "speed_scaling_factor": 1.0}
    for name in own.__dataclass_fields__:
        if name not in blank:
            blank[name] = many if name.startswith("multi_dof") else empty
    rows = []
    for i, t in enumerate(LOG.t):
        output = made("trajectory_msgs/msg/JointTrajectoryPoint", **{**NOWHERE, "effort": LOG["command"][i]})
        feedback = made("trajectory_msgs/msg/JointTrajectoryPoint", **{**NOWHERE, "positions": LOG["q"][i]})
        told = {"header": header(t), "joint_names": list(JOINTS), "output": output, "feedback": feedback}
        fields = {n: v for n, v in {**blank, **told}.items() if n in own.__dataclass_fields__}
        fields.pop("__msgtype__", None)
        rows.append((topic, kind, nanoseconds(t), own(**fields)))
    return rows, store


def storage(folder: Path) -> Path:
    """The one storage in a bag folder."""
    return next(one for one in folder.iterdir() if one.name != "metadata.yaml")


Messages = Callable[[], list[Message]]
