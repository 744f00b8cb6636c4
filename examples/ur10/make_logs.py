"""Makes bag/ and controller.csv from ur10_exciting.csv: python make_logs.py. The motion as others record it.

bag/ is what `ros2 bag record --storage mcap /joint_states` leaves, of the first 15 s; controller.csv has a
controller's own names, degrees, semicolons and decimal commas, and the first 8 s.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
START_S = 1_700_000_000
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def table() -> tuple[np.ndarray, ...]:
    """Times (T,), positions, velocities and efforts (T, 6) of the recording."""
    with (HERE / "ur10_exciting.csv").open() as file:
        names = file.readline().strip().split(",")
        values = np.loadtxt(file, delimiter=",")
    column = dict(zip(names, values.T, strict=True))
    own = [
        [column[f"{joint}_joint.{word}"] for joint in JOINTS] for word in ("position", "velocity", "effort")
    ]
    q, qd, effort = (np.column_stack(columns) for columns in own)
    return column["t"], q, qd, effort


def write_bag(folder: Path, t: np.ndarray, q: np.ndarray, qd: np.ndarray, effort: np.ndarray) -> None:
    """One topic of joint states, compressed as rosbag2 does."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/JointState"
    state, header = store.types[kind], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    names = [f"{joint}_joint" for joint in JOINTS]
    shutil.rmtree(folder, ignore_errors=True)
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection("/joint_states", kind, typestore=store)
        for seconds, position, velocity, torque in zip(t, q, qd, effort, strict=True):
            ns = START_S * 10**9 + round(1e9 * float(seconds - t[0]))
            stamp = header(stamp=time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            message = state(header=stamp, name=names, position=position, velocity=velocity, effort=torque)
            writer.write(topic, ns, store.serialize_cdr(message, kind))


def write_controller(path: Path, t: np.ndarray, q: np.ndarray, effort: np.ndarray) -> None:
    """A table with names that say nothing."""
    rows = np.column_stack([1e3 * (t - t[0]), np.rad2deg(q), effort])[t - t[0] <= 8.0]
    names = ["Clock_ms", *(f"ActPos{i}" for i in range(1, 7)), *(f"Moment{i}" for i in range(1, 7))]
    lines = [";".join(f"{value:.3f}".replace(".", ",") for value in row) for row in rows]
    path.write_text("\n".join([";".join(names), *lines]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_bag(HERE / "bag", *(column[: 15 * 125] for column in table()))
    t, q, _, effort = table()
    write_controller(HERE / "controller.csv", t, q, effort)
