"""Messages of ROS as rows of columns: joint states by the names beside them, all else field by field."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from etude.errors import DataError
from etude.logs.readers.ros_definitions import CONTROLLER_STATE, DYNAMIC_STATE
from etude.types import Array

JOINT_STATE = "sensor_msgs/msg/JointState"
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
class Rows:
    """Rows of one topic as they come: a time and blocks of values each.

    Attributes:
        received, stamped: ns, when the recorder got each message and what its header says (0: nothing).
    """

    received: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    _columns: dict[str, list[float]] = field(default_factory=dict)

    def add(self, received: int, stamped: int, blocks: Iterable[Block]) -> None:
        """One message. ValueError: a joint stands in it twice."""
        row = len(self.received)
        self.received.append(received)
        self.stamped.append(stamped)
        for word, names, values in blocks:
            if len(set(names)) != len(names):
                raise ValueError(f"a joint stands twice in one message: {', '.join(map(str, names[:12]))}")
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


def blocks_of(message: Any, msgtype: str) -> Iterator[Block]:
    """The numbers in a message."""
    if msgtype == JOINT_STATE:
        yield from _joint_state(message)
    elif msgtype == CONTROLLER_STATE:
        yield from _controller_state(message)
    elif msgtype == DYNAMIC_STATE:
        for joint, own in zip(message.joint_names, message.interface_values, strict=False):
            for word, value in zip(own.interface_names, own.values, strict=False):
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
    """What was measured and what was wanted; releases differ in the names of both."""
    measured = _point(message, "feedback", "actual")
    wanted = _point(message, "reference", "desired")
    for point, suffix in ((measured, ""), (wanted, "_desired")):
        for given, word in POINT.items():
            values = getattr(point, given, ())
            if len(values) == len(message.joint_names):
                yield f"{word}{suffix}", message.joint_names, values
    output = getattr(getattr(message, "output", None), "effort", ())
    if len(output) == len(message.joint_names) and not len(getattr(measured, "effort", ())):
        yield "effort", message.joint_names, output


def _point(message: Any, *names: str) -> Any:
    """The first of these fields that holds positions."""
    found = [getattr(message, name, None) for name in names]
    return next((one for one in found if one is not None and len(one.positions)), None)


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
    """The refusal of a topic whose messages nothing describes."""
    return DataError(
        f"the message type {msgtype} of topic {topic} is not known",
        where=where,
        next_step="Record as MCAP, or with ROS 2 Iron or later, which store what a message holds; "
        "or convert the topic to CSV.",
    )
