"""Exporters of motions as trajectory_msgs/JointTrajectory: in a bag (MCAP or SQLite), as YAML, and as a
table with its player.

joint_trajectory_controller joins points with accelerations by quintics. It joins commands in `effort` by
lines, and controllers that command effort add them, since ros2_controllers' pull request 1200 (2025). The
controller of Humble refuses a message with efforts, so the field is empty by default.
"""

from __future__ import annotations

import csv
import io
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files as resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from etude.deploy.exporters.knots import NANO, Knots, MovesJoints, knots_of
from etude.deploy.feedforward import MotionWithCommands
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined

TOPIC = "/joint_trajectory_controller/joint_trajectory"
MESSAGE = "trajectory_msgs/msg/JointTrajectory"
FOLDER = "motion"
WRITING = "writing a JointTrajectory"
ORDERS = 3  # position, velocity, acceleration
VERSIONS: Mapping[str, Literal[8, 9]] = {"mcap": 9, "sqlite3": 8}
"""Of metadata.yaml: MCAP as Jazzy and later write it; SQLite as Humble reads it too."""
SUFFIX = {"mcap": "mcap", "sqlite3": "db3"}


@dataclass(frozen=True)
class JointTrajectoryBag(MovesJoints):
    """A `protocols.Exporter`: a folder for `ros2 bag play`, with one message on TOPIC.

    Attributes:
        storage: "mcap" or "sqlite3".
    """

    storage: Literal["mcap", "sqlite3"]

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The folder's files by their paths. The message's stamp is zero, so that it starts at once.

        Args:
            what: the motion, with or without commands. kind: of the robot. spec: its description.

        Raises:
            UsageError: the robot has no joints, the motion is too quick, or rosbags is not installed.
        """
        self.require_robot(kind, spec)
        knots = knots_of(what, kind, spec, ORDERS)
        rosbag2 = needed("rosbags.rosbag2", WRITING, Path(FOLDER))
        store = _store()
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / FOLDER
            plugin = rosbag2.StoragePlugin[self.storage.upper()]
            with rosbag2.Writer(folder, version=VERSIONS[self.storage], storage_plugin=plugin) as writer:
                connection = writer.add_connection(TOPIC, MESSAGE, typestore=store)
                writer.write(connection, 0, store.serialize_cdr(_message(knots, store.types), MESSAGE))
            return {f"{FOLDER}/{file.name}": file.read_bytes() for file in sorted(folder.iterdir())}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The curve that joint_trajectory_controller plays: quintics, cubics or lines.

        Raises:
            UsageError: the bag has no such message.
        """
        rosbag2 = needed("rosbags.rosbag2", WRITING, Path(FOLDER))
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / FOLDER
            folder.mkdir()
            for name, data in files.items():
                (folder / Path(name).name).write_bytes(data)
            with rosbag2.Reader(folder) as reader:
                for connection, _, data in reader.messages():
                    if connection.msgtype == MESSAGE:
                        return played(_store().deserialize_cdr(data, MESSAGE).points)
        raise UsageError(f"the bag holds no {MESSAGE}")


def played(points: Sequence[Any]) -> Splined:
    """The curve through a message's points, of the degree that its fields allow."""
    names = ["positions", "velocities", "accelerations"]
    present = [name for name in names if all(len(getattr(point, name)) for point in points)]
    present = [name for i, name in enumerate(names) if names[: i + 1] == present[: i + 1]]
    times = [(p.time_from_start.sec * NANO + p.time_from_start.nanosec) / NANO for p in points]
    table = [[getattr(point, name) for point in points] for name in present]
    return Splined(np.array(times), np.array(table, dtype=float))


def _store() -> Any:
    typesys = needed("rosbags.typesys", WRITING, Path(FOLDER))
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


def _message(knots: Knots, types: Mapping[str, Any]) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    points = [_point(knots, i, types) for i in range(len(knots.nanoseconds))]
    return types[MESSAGE](header=header, joint_names=list(knots.names), points=points)


def _point(knots: Knots, i: int, types: Mapping[str, Any]) -> Any:
    sec, nanosec = divmod(int(knots.nanoseconds[i]), NANO)
    # an array of integers, or one that is not contiguous, is written as other numbers without complaint
    rows = [np.ascontiguousarray(row, dtype=float) for row in knots.points[:, i]]
    effort = np.zeros(0) if knots.command is None else np.ascontiguousarray(knots.command[i], dtype=float)
    return types["trajectory_msgs/msg/JointTrajectoryPoint"](
        positions=rows[0],
        velocities=rows[1],
        accelerations=rows[2],
        effort=effort,
        time_from_start=types["builtin_interfaces/msg/Duration"](sec=sec, nanosec=nanosec),
    )


MCAP, SQLITE = JointTrajectoryBag("mcap"), JointTrajectoryBag("sqlite3")


FILE = "joint_trajectory.yaml"
ARGUMENT = 128 * 1024
"""Bytes that one argument of a command may have on Linux."""


class JointTrajectoryYaml(MovesJoints):
    """A `protocols.Exporter`: the message as one YAML document that is JSON below its comments."""

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The file; arguments as `JointTrajectoryBag`. UsageError: the robot has no joints, or the motion is
        too quick.
        """
        self.require_robot(kind, spec)
        text = _document(knots_of(what, kind, spec, ORDERS))
        return {FILE: (_usage_comment(len(text)) + text).encode()}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The curve that joint_trajectory_controller plays."""
        lines = files[FILE].decode().splitlines()
        content = json.loads("\n".join(line for line in lines if not line.startswith("#")))
        return played([_noun(point) for point in content["points"]])


def _usage_comment(size: int) -> str:
    lines = [f"{MESSAGE}, to be published once on {TOPIC}."]
    if size < ARGUMENT:
        lines.append(f'ros2 topic pub --once {TOPIC} {MESSAGE} "$(cat {FILE})"')
    else:
        lines.append(
            "If it is too long for a command-line argument: newer releases of ros2 topic pub have "
            "--yaml-file;"
        )
        lines.append("or play the bag of etude ask --format ros2.")
    return "".join(f"# {line}\n" for line in lines)


def _document(knots: Knots) -> str:
    """YAML in flow style, one point a line. Names are quoted, because some are numbers or words of YAML."""
    names = ", ".join(map(json.dumps, knots.names))
    points = ",\n".join(_yaml_point(knots, i) for i in range(len(knots.nanoseconds)))
    head = '{"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}'
    return f'{head}, "joint_names": [{names}], "points": [\n{points}]}}\n'


def _yaml_point(knots: Knots, i: int) -> str:
    sec, nanosec = divmod(int(knots.nanoseconds[i]), NANO)
    fields = dict(zip(("positions", "velocities", "accelerations"), knots.points[:, i], strict=True))
    if knots.command is not None:
        fields["effort"] = knots.command[i]
    lists = ", ".join(f'"{name}": {_numbers(row.tolist())}' for name, row in fields.items())
    return f'{{{lists}, "time_from_start": {{"sec": {sec}, "nanosec": {nanosec}}}}}'


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _number(value: float) -> str:
    """The shortest text with a decimal point, because YAML 1.1 reads 1e-05 as a string."""
    text = repr(value)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0{exponent}{power}" if exponent and "." not in mantissa else text


def _noun(content: Any) -> Any:
    if isinstance(content, dict):
        return SimpleNamespace(**{name: _noun(value) for name, value in content.items()})
    return content


YAML = JointTrajectoryYaml()


TABLE, PLAYER = "points.csv", "play.py"
TIME = "nanoseconds"
WORDS = ("position", "velocity", "acceleration")
EFFORT = "effort"


class CsvPlayer(MovesJoints):
    """A `protocols.Exporter`: points.csv (`position/shoulder`, ...) and play.py, a node for rclpy."""

    def __call__(self, what: Trajectory | MotionWithCommands, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """Both files; arguments as `JointTrajectoryBag`. UsageError: the robot has no joints, or the motion
        is too quick.
        """
        self.require_robot(kind, spec)
        knots = knots_of(what, kind, spec, ORDERS)
        columns = [f"{word}/{name}" for word in WORDS for name in knots.names]
        table = np.concatenate(list(knots.points), axis=1)
        if knots.command is not None:
            columns += [f"{EFFORT}/{name}" for name in knots.names]
            table = np.concatenate([table, knots.command], axis=1)
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow([TIME, *columns])
        lines.writerows(
            [t, *map(repr, row)] for t, row in zip(knots.nanoseconds.tolist(), table.tolist(), strict=True)
        )
        return {TABLE: text.getvalue().encode(), PLAYER: player("etude.deploy.exporters", "play_points.py")}

    def back(self, files: Mapping[str, bytes]) -> Splined:
        """The curve that the controller plays of the player's table."""
        header, *rows = csv.reader(io.StringIO(files[TABLE].decode()))
        times = np.array([int(row[0]) for row in rows]) / NANO
        columns = [
            [i for i, name in enumerate(header) if name.startswith(word + "/")] for word in WORDS[:ORDERS]
        ]
        return Splined(times, np.array([[[float(row[i]) for i in part] for row in rows] for part in columns]))


def player(package: str, name: str) -> bytes:
    """The text of a program for the robot's computer."""
    return (resources(package) / "players" / name).read_bytes()


PLAYED = CsvPlayer()
