"""PX4 logs written by the example's own writer, of a short made-up flight."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

EXAMPLES = Path(__file__).parents[2] / "examples"


def loaded(path: Path) -> Any:
    """A script as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


WRITER = loaded(EXAMPLES / "px4" / "make_ulg.py")
T = np.arange(0.0, 4.0, 0.01)
STAMPS = np.round(1e6 * (T + 7.0)).astype(np.int64)


def topics() -> dict[str, dict[str, np.ndarray]]:
    """Two topics of the body, motors and battery, in PX4's frames."""
    swing = np.stack([np.sin(k * T) for k in (1, 2, 3)], axis=1)
    controls = np.hstack([0.5 + 0.1 * np.stack([np.sin(k * T) for k in range(1, 5)], axis=1), nan(8)])
    return {
        "vehicle_angular_velocity": {"timestamp": STAMPS, "xyz": swing},
        "sensor_combined": {
            "timestamp": STAMPS,
            "gyro_rad": swing,
            "accelerometer_m_s2": np.array([0.5, 0.25, -9.75]) + 0.1 * swing,
        },
        "actuator_motors": {"timestamp": STAMPS, "control": controls},
        "battery_status": {"timestamp": STAMPS[::50], "voltage_v": np.linspace(12.5, 12.0, 8)},
    }


def nan(width: int) -> np.ndarray:
    return np.full((len(T), width), np.nan)


def write_ulog(path: Path, own: dict[str, dict[str, np.ndarray]] | None = None, **more: Any) -> Path:
    path.write_bytes(WRITER.ulog_bytes(topics() if own is None else own, **more))
    return path
