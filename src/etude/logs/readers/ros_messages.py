"""ROS messages as rows of columns: joint states by the names beside them, all else field by field.

rosbag2 stores definitions in every MCAP, and in SQLite since ROS 2 Iron. What is older is of Foxy, Galactic
or Humble, which differ in what a controller's state holds (control_msgs, branches of these names).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import DataError
from etude.logs.readers.extras import READING, needed
from etude.types import Array

JOINT_STATE = "sensor_msgs/msg/JointState"


CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
DYNAMIC_STATE = "control_msgs/msg/DynamicJointState"

_NAMED = "std_msgs/Header header\nstring[] joint_names\n"
_GALACTIC, _HUMBLE = (
    ("desired", "actual", "error"),
    ("reference", "feedback", "error", "output", "desired", "actual"),
)


def _points(names: tuple[str, ...], kind: str, before: str = "") -> str:
    return "".join(f"trajectory_msgs/{kind} {before}{name}\n" for name in names)


DEFINITIONS: Mapping[str, str] = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    DYNAMIC_STATE: "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values\n",
    CONTROLLER_STATE: _NAMED + _points(_GALACTIC, "JointTrajectoryPoint"),
}
"""Type -> definition."""
LATER: Mapping[str, str] = {
    CONTROLLER_STATE: _NAMED
    + _points(_HUMBLE, "JointTrajectoryPoint")
    + "string[] multi_dof_joint_names\n"
    + _points(_HUMBLE, "MultiDOFJointTrajectoryPoint", "multi_dof_"),
}
"""The same of a later release, for messages that are not of the first kind."""


LIKED = (JOINT_STATE, DYNAMIC_STATE, CONTROLLER_STATE)
"""Types that hold joints, the first most readily read; others hold JointStates as fields."""
POINT = {
    "positions": "position",
    "velocities": "velocity",
    "accelerations": "acceleration",
    "effort": "effort",
}
STATE = ("position", "velocity", "effort")
LONGEST = 1000
"""Joints, or entries of a list: longer ones are images and scans."""
DEEPEST = 6
"""Messages within messages."""

Block = tuple[str, Sequence[str], Any]
"""A word, the names of the joints, and a value for each."""


@dataclass
class TopicRows:
    """Rows of one topic as they come: a time and blocks of values each.

    Attributes:
        received, stamped: ns, when the recorder got each message and what its header says (0: nothing).
    """

    received: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    _columns: dict[str, list[float]] = field(default_factory=dict)

    def add(self, received: int, stamped: int, blocks: Iterable[Block]) -> None:
        """Add one message. ValueError: it has a joint twice."""
        row = len(self.received)
        self.received.append(received)
        self.stamped.append(stamped)
        for word, names, values in blocks:
            if len(set(names)) != len(names):
                raise ValueError(f"a joint occurs twice in one message: {', '.join(map(str, names[:12]))}")
            for name, value in zip(names, values, strict=False):
                column = self._columns.setdefault(f"{word}/{name}" if name else word, [])
                column.extend([np.nan] * (row - len(column)))
                column.append(float(value))

    def columns(self) -> dict[str, Array]:
        """(T,) of each header; NaN where a message lacks it."""
        rows = len(self.received)
        return {
            name: np.array(column + [np.nan] * (rows - len(column))) for name, column in self._columns.items()
        }


def holds_joints(msgtype: str, fields: Mapping[str, Any]) -> bool:
    """Whether messages of a type hold joint states.

    Args:
        fields: of all known types, as a type store of rosbags has them.
    """
    return msgtype in LIKED or any(
        _of_type(one) == JOINT_STATE for _, one in fields.get(msgtype, ((), ()))[1]
    )


def stamp_of(message: Any) -> int:
    """ns of the message's header; 0 without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return int(stamp.sec) * 10**9 + int(stamp.nanosec) if stamp is not None else 0


def message_blocks(message: Any, msgtype: str) -> Iterator[Block]:
    """The numbers in a message."""
    if msgtype == JOINT_STATE:
        yield from _joint_state(message)
    elif msgtype == CONTROLLER_STATE:
        yield from _controller_state(message)
    elif msgtype == DYNAMIC_STATE:
        for joint, interface in zip(message.joint_names, message.interface_values, strict=False):
            for word, value in zip(interface.interface_names, interface.values, strict=False):
                yield word, (joint,), (value,)
    else:
        inner = {name: value for name, value in vars(message).items() if _type(value) == JOINT_STATE}
        for name, state in inner.items():
            yield from _joint_state(state, _suffix(name), "motor" in name)
        if not inner:
            yield from _numbers(message, "")


def _joint_state(message: Any, suffix: str = "", motors: bool = False) -> Iterator[Block]:
    """position, velocity and effort; of set-points as `position_desired`, of motors as `motor_position`."""
    if len(message.name) > LONGEST:
        raise ValueError(f"a message names {len(message.name)} joints")
    for word in STATE:
        values = getattr(message, word)
        if len(values) == len(message.name):
            yield f"{'motor_' if motors else ''}{word}{suffix}", message.name, values


def _suffix(name: str) -> str:
    return "_desired" if "desired" in name or "target" in name or "command" in name else ""


def _controller_state(message: Any) -> Iterator[Block]:
    """Measured and desired values; releases differ in the names of both."""
    measured = _point(message, "feedback", "actual")
    desired = _point(message, "reference", "desired")
    for point, suffix in ((measured, ""), (desired, "_desired")):
        for quantity, word in POINT.items():
            values = getattr(point, quantity, ())
            if len(values) == len(message.joint_names):
                yield f"{word}{suffix}", message.joint_names, values
    output = getattr(getattr(message, "output", None), "effort", ())
    if len(output) == len(message.joint_names) and not len(getattr(measured, "effort", ())):
        yield "effort", message.joint_names, output


def _point(message: Any, *names: str) -> Any:
    """The first of these fields that holds positions."""
    points = [getattr(message, name, None) for name in names]
    return next((one for one in points if one is not None and len(one.positions)), None)


def _numbers(message: Any, path: str, depth: int = 0) -> Iterator[Block]:
    """Every number in a message, by the path of its field; entries of lists are numbered."""
    if depth > DEEPEST:
        return
    for name, value in vars(message).items():
        place = f"{path}.{name}" if path else name
        if name in ("header", "__msgtype__") or isinstance(value, str | bytes):
            continue
        if isinstance(value, bool | int | float | np.number):
            yield place, ("",), (value,)
        elif isinstance(value, np.ndarray | list):
            if 0 < len(value) <= LONGEST and isinstance(value[0], float | int | np.number):
                for i, one in enumerate(value):
                    yield f"{place}[{i}]", ("",), (one,)
        elif _type(value):
            yield from _numbers(value, place, depth + 1)


def _type(value: Any) -> str:
    return str(getattr(value, "__msgtype__", ""))


def _of_type(described: Any) -> str:
    """The name of a field's type, if it is a message: rosbags describes it as (kind, name)."""
    try:
        return str(described[1]) if isinstance(described[1], str) else ""
    except (TypeError, IndexError):
        return ""


def unknown_type(topic: str, msgtype: str, where: str) -> DataError:
    """The error on a topic whose messages have no known definition."""
    return DataError(
        f"the message type {msgtype} of topic {topic} is not known",
        where=where,
        next_step="Record as MCAP, or with ROS 2 Iron or later, which store what a message holds; "
        "or convert the topic to CSV.",
    )


class Stores:
    """Type stores of messages: definitions in the recording, or else ROS's own."""

    def __init__(self, path: Path) -> None:
        self._typesys = needed("rosbags.typesys", READING, path)
        self._stores: dict[tuple[str, str], list[Any]] = {}

    def of(self, connection: Any) -> Any:
        """The type store for a topic's messages."""
        return self._all(connection)[0]

    def read(self, connection: Any, data: bytes) -> Any:
        """A message of a topic, by the first release of ROS that fits. Errors of rosbags: none fits."""
        stores = self._all(connection)
        for last, store in enumerate(stores, 1):
            try:
                message = store.deserialize_cdr(data, connection.msgtype)
            except Exception:
                if last == len(stores):
                    raise
            else:
                stores.insert(0, stores.pop(last - 1))  # the next message is of the same
                break
        return message

    def _all(self, connection: Any) -> list[Any]:
        key = (connection.msgtype, connection.msgdef.data)
        if key not in self._stores:
            self._stores[key] = self._make_stores(connection)
        return self._stores[key]

    def _make_stores(self, connection: Any) -> list[Any]:
        typesys, format_ = self._typesys, connection.msgdef.format.name
        if format_ == "NONE":
            later = [{**DEFINITIONS, **LATER}] if connection.msgtype in LATER else []
            return [self._of_ros(definitions) for definitions in (DEFINITIONS, *later)]
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(_types(typesys, connection.msgdef.data, format_, connection.msgtype))
        return [store]

    def _of_ros(self, definitions: Mapping[str, str]) -> Any:
        """A type store of ROS's own types and of additional ones."""
        store = self._typesys.get_typestore(self._typesys.Stores.LATEST)
        for name, text in definitions.items():
            if name not in store.fielddefs:
                store.register(self._typesys.get_types_from_msg(text, name))
        return store


def _types(typesys: Any, text: str, format_: str, msgtype: str) -> Any:
    """Types by name of a definition as the recording holds it; several IDLs stand between lines of =."""
    if format_ == "MSG":
        return typesys.get_types_from_msg(text, msgtype)
    types: dict[str, Any] = {}
    for part in text.split(80 * "=" + "\n"):
        definition = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if definition.strip():
            types |= typesys.get_types_from_idl(definition)
    return types
