"""Makes flight.ulg: python make_ulg.py. A simulated flight, written as PX4 records one.

Étude's built-in simulated vehicle flies a random motion inside its limits; what it measures is written in
PX4's topics, units and frames (body forward, right, down; world north, east, down). The format:
https://docs.px4.io/main/en/dev_log/ulog_file_format.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

MAGIC = b"\x55\x4c\x6f\x67\x01\x12\x35\x01"
CODES = {"uint64_t": "Q", "float": "f", "uint32_t": "I", "int32_t": "i", "uint8_t": "B"}
FULL_V = 11.1
"""Voltage of the simulated motors at full scale."""


def ulog_bytes(
    topics: Mapping[str, Mapping[str, np.ndarray]],
    types: Mapping[str, str] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> bytes:
    """A ULog of these topics.

    Args:
        topics: name (or `name:instance`) -> field -> (T,) or (T, n); `timestamp` in us first.
        types: field -> type; float if it is not here.
        parameters: name -> value.
    """
    kinds = {"timestamp": "uint64_t", **(types or {})}
    parts = [MAGIC, struct.pack("<Q", 0), _message("B", bytes(40))]
    parts += [_parameter(name, value) for name, value in (parameters or {}).items()]
    for name in dict.fromkeys(topic.partition(":")[0] for topic in topics):
        fields = next(data for topic, data in topics.items() if topic.partition(":")[0] == name)
        parts.append(_message("F", f"{name}:{_format(fields, kinds)}".encode()))
    rows: list[tuple[int, bytes]] = []
    for number, (topic, data) in enumerate(topics.items()):
        name, _, instance = topic.partition(":")
        parts.append(_message("A", struct.pack("<BH", int(instance or 0), number) + name.encode()))
        rows += _rows(number, data, kinds)
    return b"".join([*parts, *(_message("D", row) for _, row in sorted(rows, key=lambda row: row[0]))])


def _parameter(name: str, value: float) -> bytes:
    """Whole numbers are int32_t, as PX4's are; others float."""
    kind = "int32_t" if isinstance(value, int) else "float"
    text = f"{kind} {name}".encode()
    return _message("P", bytes([len(text)]) + text + struct.pack(f"<{CODES[kind]}", value))


def _message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def _format(fields: Mapping[str, np.ndarray], kinds: Mapping[str, str]) -> str:
    sizes = {name: f"[{values.shape[1]}]" if values.ndim == 2 else "" for name, values in fields.items()}
    return "".join(f"{kinds.get(name, 'float')}{sizes[name]} {name};" for name in fields)


def _rows(
    number: int, data: Mapping[str, np.ndarray], kinds: Mapping[str, str]
) -> Sequence[tuple[int, bytes]]:
    packers = []
    for name, values in data.items():
        table = values if values.ndim == 2 else values[:, None]
        packers.append((struct.Struct(f"<{table.shape[1]}{CODES[kinds.get(name, 'float')]}"), table.tolist()))
    times = [int(t) for t in data["timestamp"]]
    start = struct.pack("<H", number)
    return [(t, start + b"".join(p.pack(*table[i]) for p, table in packers)) for i, t in enumerate(times)]


def flight_topics(flight: Any, step: int) -> dict[str, dict[str, np.ndarray]]:
    """PX4's topics of a simulated flight: NED, FRD, set-points as parts of full scale.

    Args:
        flight: in the world east, north, up and the body forward, left, up; SI units.
        step: of its rows between two of the log's.
    """
    every = {"vehicle_attitude": 2, "vehicle_local_position": 10, "battery_status": 50}
    flip = np.array([1.0, -1.0, -1.0])
    R = flight.R_world_body
    force = np.einsum("tji,tj->ti", R, flight.acceleration + np.array([0.0, 0.0, 9.81]))
    east, north, up = flight.position.T
    rows = len(flight.t)
    signals = {
        "vehicle_angular_velocity": {"xyz": flight.rates * flip},
        "sensor_combined": {"gyro_rad": flight.rates * flip, "accelerometer_m_s2": force * flip},
        "vehicle_attitude": {"q": ned_frd(R)},
        "vehicle_local_position": {"x": north, "y": east, "z": -up},
        "actuator_motors": {"control": np.hstack([flight.command / FULL_V, np.full((rows, 8), np.nan)])},
        "battery_status": {"voltage_v": np.full(rows, FULL_V)},
    }
    t = np.round(1e6 * (flight.t + 42.0)).astype(np.int64)  # us since the vehicle was switched on
    found = {}
    for topic, fields in signals.items():
        rows_of = slice(0, None, step * every.get(topic, 1))
        found[topic] = {name: values[rows_of] for name, values in {"timestamp": t, **fields}.items()}
    return found


def ned_frd(R_world_body: np.ndarray) -> np.ndarray:
    """(T, 4) w, x, y, z as PX4 has them, of rotations (T, 3, 3) world east, north, up <- body."""
    from scipy.spatial.transform import Rotation

    world = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    turned = world @ R_world_body @ np.diag([1.0, -1.0, -1.0])
    return Rotation.from_matrix(turned).as_quat()[:, [3, 0, 1, 2]]


def flown(seconds: float = 20.0, rate: float = 100.0) -> tuple[Any, int]:
    """A flight of the built-in simulated vehicle, and its rows between two of a log at `rate` Hz."""
    import etude
    from etude.campaign import stored_trajectory
    from etude_quadrotor import flight_plan

    with tempfile.TemporaryDirectory() as folder:
        campaign, _ = etude.create_campaign(Path(folder) / "sky", "quadrotor")
        etude.ask(campaign)
        vehicle = campaign.kind.robot(campaign.spec, campaign.config).vehicle
        plan = flight_plan(stored_trajectory(campaign, 1), None, vehicle.vehicle, vehicle.rate)
        flight = vehicle.fly(plan, np.random.default_rng(0))
    last = int(np.searchsorted(flight.t, seconds))
    names = ("t", "position", "R_world_body", "rates", "command", "acceleration")
    cut = SimpleNamespace(**{name: getattr(flight, name)[:last] for name in names})
    return cut, max(1, round(1.0 / (rate * float(flight.t[1] - flight.t[0]))))


if __name__ == "__main__":
    Path(__file__).with_name("flight.ulg").write_bytes(ulog_bytes(flight_topics(*flown())))
