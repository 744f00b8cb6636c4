"""trajectory_msgs/JointTrajectory in a bag: MCAP or SQLite, written and read by rosbags.

joint_trajectory_controller joins points with accelerations by quintics. A command in `effort` is joined by
lines and added by controllers that command effort, since ros2_controllers' pull request 1200 (2025);
Humble's refuses a message that has any, so it is left empty unless asked for.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from etude.deploy.commanded import Commanded
from etude.deploy.exporters.knots import NANO, Knots, knots_of, require_joints
from etude.errors import UsageError
from etude.logs.readers.extras import needed
from etude.protocols import Kind, Trajectory
from etude.trajectories.splined import Splined

TOPIC = "/joint_trajectory_controller/joint_trajectory"
MESSAGE = "trajectory_msgs/msg/JointTrajectory"
FOLDER = "motion"
WRITING = "writing a JointTrajectory"
ORDERS = 3
VERSIONS: Mapping[str, Literal[8, 9]] = {"mcap": 9, "sqlite3": 8}
"""Of metadata.yaml: MCAP as Jazzy and later write it; SQLite as Humble reads it too."""
SUFFIX = {"mcap": "mcap", "sqlite3": "db3"}


@dataclass(frozen=True)
class JointTrajectoryBag:
    """A `protocols.Exporter`: a folder that `ros2 bag play` publishes, one message on TOPIC.

    Attributes:
        storage: "mcap" or "sqlite3".
    """

    storage: Literal["mcap", "sqlite3"]

    def __call__(self, what: Trajectory | Commanded, kind: Kind, spec: Any) -> Mapping[str, bytes]:
        """The folder's files by their paths. The message's stamp is zero: start now.

        Raises:
            UsageError: no robot of joints, too quick a motion, or rosbags is not installed.
        """
        require_joints(kind, spec, "a JointTrajectory")
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
        """What joint_trajectory_controller plays of the folder: quintics, cubics or lines.

        Raises:
            UsageError: there is no such message in it.
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
    given = [name for name in names if all(len(getattr(point, name)) for point in points)]
    given = [name for i, name in enumerate(names) if names[: i + 1] == given[: i + 1]]
    times = [(p.time_from_start.sec * NANO + p.time_from_start.nanosec) / NANO for p in points]
    table = [[getattr(point, name) for point in points] for name in given]
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
