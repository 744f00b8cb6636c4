"""Vehicles that are no quadrotors are refused in a sentence: a servo is not taken for a motor."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.cli import main
from etude.errors import DataError
from etude.logs import read_raw

EXAMPLES = Path(__file__).parents[2] / "examples"
T = np.arange(0.0, 2.0, 0.01)
STAMPS = np.round(1e6 * (T + 3.0)).astype(np.int64)


def writer() -> Any:
    spec = importlib.util.spec_from_file_location("make_ulg", EXAMPLES / "px4" / "make_ulg.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flight(path: Path, status: dict[str, int], parameters: dict[str, int]) -> Path:
    """A log whose first four motors move, with what it says of its airframe."""
    swing = np.stack([np.sin(k * T) for k in (1, 2, 3)], axis=1)
    control = np.hstack([0.5 + 0.1 * swing[:, [0, 1, 2, 0]], np.full((len(T), 8), np.nan)])
    topics: dict[str, Any] = {
        "vehicle_angular_velocity": {"timestamp": STAMPS, "xyz": swing},
        "sensor_combined": {"timestamp": STAMPS, "accelerometer_m_s2": 0.1 * swing - [0.0, 0.0, 9.8]},
        "actuator_motors": {"timestamp": STAMPS, "control": control},
    }
    if status:
        rows = {name: np.full(len(T) // 50, value) for name, value in status.items()}
        topics["vehicle_status"] = {"timestamp": STAMPS[::50], **rows}
    kinds = dict.fromkeys(status, "uint8_t")
    path.write_bytes(writer().ulog_bytes(topics, types=kinds, parameters=parameters))
    return path


@pytest.mark.parametrize(
    ("status", "parameters", "said"),
    [
        ({}, {"MAV_TYPE": 13}, "a hexarotor (MAV_TYPE 13)"),
        ({}, {"MAV_TYPE": 22}, "a VTOL aircraft (MAV_TYPE 22)"),
        ({"system_type": 14}, {}, "an octorotor (vehicle_status.system_type 14)"),
        ({"system_type": 0, "vehicle_type": 2}, {}, "a fixed-wing aircraft (vehicle_status.vehicle_type 2)"),
        ({"system_type": 2, "is_vtol": 1}, {"MAV_TYPE": 2}, "a VTOL aircraft (vehicle_status.is_vtol)"),
        ({}, {"CA_AIRFRAME": 2}, "a VTOL aircraft (CA_AIRFRAME 2)"),
        ({}, {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 6}, "a vehicle of 6 rotors (CA_ROTOR_COUNT 6)"),
    ],
)
def test_a_log_of_another_airframe_is_refused(
    tmp_path: Path, status: dict[str, int], parameters: dict[str, int], said: str
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    with pytest.raises(DataError, match="only quadrotors are supported") as problem:
        read_raw(flight(tmp_path / "own.ulg", status, parameters))
    assert said in problem.value.fact


@pytest.mark.parametrize(
    ("status", "parameters"),
    [
        ({}, {}),
        ({}, {"MAV_TYPE": 2, "CA_AIRFRAME": 0, "CA_ROTOR_COUNT": 4}),
        ({"system_type": 2, "vehicle_type": 1, "is_vtol": 0}, {"MAV_TYPE": 0}),
    ],
)
def test_quadrotors_and_logs_that_do_not_say_are_read(
    tmp_path: Path, status: dict[str, int], parameters: dict[str, int]
) -> None:
    pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
    found = read_raw(flight(tmp_path / "own.ulg", status, parameters))
    assert found is not None


def test_a_description_of_six_motors_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    six, (low, high) = [f"motor_{i}" for i in range(1, 7)], ([0.0] * 6, [1.0] * 6)
    text = (EXAMPLES / "px4" / "px4_quad.toml").read_text().splitlines()
    kept = [line for line in text if not line.startswith("command")]
    more = [f"commands = {six}".replace("'", '"'), 'command_unit = "1"']
    more += [f"command_lower = {low}", f"command_upper = {high}"]
    at = next(i for i, line in enumerate(kept) if line.startswith("name"))
    (tmp_path / "hexa.toml").write_text("\n".join([*kept[: at + 1], *more, *kept[at + 1 :]]) + "\n")
    assert main(["init", str(tmp_path / "lab"), "--robot", str(tmp_path / "hexa.toml")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "A quadrotor has 4 motors, this vehicle has 6 commands" in said
    assert "are not supported" in said
    assert not (tmp_path / "lab").exists()
