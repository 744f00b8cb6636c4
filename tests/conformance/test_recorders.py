"""Columns of px4_msgs bags and of blackbox_decode, by the tables [log.columns] that the docs print."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.cli import main
from etude.logs import read_log_file
from etude.trajectories import FourierTrajectory
from etude.types import Array, Log
from etude_quadrotor import QuadrotorInputs

ROOT = Path(__file__).parents[2]
ACC_1G, FULL = 2048.0, 2047.0
TURN = np.array([1.0, -1.0, -1.0])
"""Forward, left, up to forward, right, down; north, west, up to north, east, down."""


def documented(word: str) -> str:
    """The block of docs/quadrotor.md that maps columns and has that word."""
    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "quadrotor.md").read_text(), re.DOTALL)
    (found,) = (block for block in blocks if word in block)
    assert "columns" in tomllib.loads(found)["log"]
    return found


def flight() -> tuple[Log, Array]:
    """What a perfect flight measures, and set-points of four motors that make it."""
    table = np.zeros((5, 3))
    table[0], table[1], table[3] = (0.0, 0.0, 2.0), (0.8, 0.0, 0.2), (0.0, 0.7, 0.3)
    table[2], table[4] = (0.0, 0.4, 0.0), (0.5, 0.0, 0.1)
    motion = FourierTrajectory(table, 2.0 * np.pi / 8.0, 8.0).motion(np.arange(0.0, 6.0, 0.02), 5)
    states = QuadrotorInputs(drag=(0.4, 0.5, 0.0)).states(motion)
    lift = 0.5 * states["specific_force"][:, 2:] / 9.81
    mixing = 0.004 * np.array([[-1.0, -1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0]])
    return states, lift + states["angular_acceleration"][:, :2] @ mixing.T


def campaign(folder: Path, mapping: str) -> Path:
    """A quadrotor's campaign with that table."""
    lab = folder / "lab"
    assert main(["init", str(lab), "--robot", str(ROOT / "examples" / "px4" / "px4_quad.toml")]) == 0
    config = lab / "campaign.toml"
    text = config.read_text()
    kept = re.sub(r"\n\[log\]\n.*?(?=\n\[|\Z)", "", text, flags=re.DOTALL)
    config.write_text(f"{kept}\n{mapping}")
    return lab


def ingested(lab: Path, log: Path) -> Log:
    assert main(["tell", str(lab), str(log), "--foreign"]) == 0
    (path,) = (lab / "runs").glob("0001.parquet")
    return read_log_file(path)


def at(found: Log, times: Array, values: Array) -> Array:
    """(n, k) values at the rows of what was stored, whose times begin with the log."""
    t = found.t - found.t[0]
    return np.column_stack([np.interp(t, times, column) for column in values.T])


def quaternion(attitude: Array) -> Array:
    """(T, 4) w, x, y, z of roll, pitch, yaw."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("ZYX", attitude[:, ::-1]).as_quat()[:, [3, 0, 1, 2]])


def test_a_bag_of_px4_msgs_is_turned_by_signs(tmp_path: Path) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="bags need the extra 'ros'")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    states, motors = flight()
    velocity = np.gradient(states["position_des"], states.t, axis=0)
    rows: dict[str, dict[str, Array]] = {
        "SensorCombined": {
            "gyro_rad": states["rates"] * TURN,
            "accelerometer_m_s2": states["specific_force"] * TURN,
        },
        "ActuatorMotors": {"control": np.hstack([motors, np.full((len(motors), 8), np.nan)])},
        "VehicleAttitude": {"q": quaternion(states["attitude_des"]) * [1.0, 1.0, -1.0, -1.0]},
        "VehicleLocalPosition": {
            **dict(zip("xyz", (states["position_des"] * TURN).T, strict=True)),
            **{f"v{name}": own for name, own in zip("xyz", (velocity * TURN).T, strict=True)},
        },
    }
    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        for kind, fields in rows.items():
            msgtype = f"px4_msgs/msg/{kind}"
            shapes = {name: f"[{own.shape[1]}]" if own.ndim == 2 else "" for name, own in fields.items()}
            text = "uint64 timestamp\n" + "".join(f"float32{shapes[n]} {n}\n" for n in fields)
            store.register(get_types_from_msg(text, msgtype))
            topic = "/fmu/out/" + re.sub(r"(?<!^)(?=[A-Z])", "_", kind).lower()
            connection = writer.add_connection(topic, msgtype, typestore=store)
            for i, t in enumerate(states.t):
                own = {name: values[i].astype(np.float32) for name, values in fields.items()}
                message = store.types[msgtype](timestamp=int(1e6 * t), **own)
                writer.write(connection, 10**9 * 1000 + round(1e9 * t), store.serialize_cdr(message, msgtype))
    found = ingested(campaign(tmp_path, documented("topics")), tmp_path / "bag")
    for name, values in (
        ("specific_force", states["specific_force"]),
        ("rates", states["rates"]),
        ("command", motors),
        ("position", states["position_des"]),
    ):
        np.testing.assert_allclose(found[name], at(found, states.t, values), atol=1e-3, err_msg=name)


def test_blackbox_decode_is_scaled(tmp_path: Path) -> None:
    states, motors = flight()
    columns = {
        "loopIteration": np.arange(len(states)),
        "time (us)": np.round(1e6 * states.t) + 5e6,
        **{f"gyroADC[{i}]": np.degrees(own) for i, own in enumerate(states["rates"].T)},
        **{f"accSmooth[{i}]": ACC_1G * own / 9.81 for i, own in enumerate(states["specific_force"].T)},
        **{f"motor[{i}]": FULL * own for i, own in enumerate(motors.T)},
    }
    lines = [", ".join(columns)]  # as blackbox_decode writes them, with blanks
    lines += [", ".join(f"{v:.3f}" for v in row) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "flight.csv").write_text("\n".join(lines) + "\n")
    found = ingested(campaign(tmp_path, documented("gyroADC")), tmp_path / "flight.csv")
    for name, values in (
        ("specific_force", states["specific_force"]),
        ("rates", states["rates"]),
        ("command", motors),
    ):
        np.testing.assert_allclose(found[name], at(found, states.t, values), atol=2e-3, err_msg=name)
