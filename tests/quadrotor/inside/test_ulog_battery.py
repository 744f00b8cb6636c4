"""A PX4 log's battery voltage, from the topic to an input of the vehicle's model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etude.campaign import find_robot
from etude.logs import read_log, read_raw
from etude.types import Index, Log, Samples
from etude_quadrotor import QuadrotorInputs
from etude_quadrotor.preprocessing import FlightData, flight_samples

pytest.importorskip("pyulog", reason="PX4 logs need the extra 'px4'")
import ulog_examples as ulogs

ROBOT = Path(__file__).parents[3] / "examples" / "px4" / "px4_quad.toml"
KIND, FILE = find_robot(str(ROBOT))
SPEC = KIND.spec(FILE)
USUAL, LOST = 12.0, 1.0
"""V in the middle of the pack's discharge, and from its beginning to its end."""
FLIGHTS, SECONDS, EACH = 4, 24.0, 50
"""EACH: rows of the body for one of the battery, which is told twice a second."""


def flown(path: Path, number: int, *, measured: bool = True) -> Path:
    """One flight of several on one pack: the same thrust takes more of full scale as the voltage falls."""
    rng = np.random.default_rng(number)
    t = np.arange(0.0, SECONDS, 0.01)
    stamps = np.round(1e6 * (t + 7.0)).astype(np.int64)
    waves = sum(np.sin(rng.uniform(1.0, 4.0, 3) * t[:, None] + rng.uniform(0.0, 6.0, 3)) for _ in range(4))
    swing = np.asarray(0.3 * waves)
    up = 9.81 + swing[:, 2]
    voltage = USUAL + LOST * (0.5 - (number + t / SECONDS) / FLIGHTS)
    control = np.full((len(t), 12), np.nan)
    control[:, :4] = (0.05 * up * USUAL / voltage)[:, None]
    force = np.stack([swing[:, 0], swing[:, 1], -up], axis=1)
    own = {
        "vehicle_angular_velocity": {"timestamp": stamps, "xyz": 0.5 * swing},
        "sensor_combined": {"timestamp": stamps, "gyro_rad": 0.5 * swing, "accelerometer_m_s2": force},
        "actuator_motors": {"timestamp": stamps, "control": control},
        "battery_status": {
            "timestamp": stamps[::EACH],
            "voltage_v": voltage[::EACH] * measured,
            "current_a": np.full(len(t[::EACH]), 9.0 if measured else -1.0),
        },
    }
    return ulogs.write_ulog(path, own)


def read(path: Path) -> Log:
    return read_log(path, KIND.channels(SPEC), rate=100.0)


def samples_of(logs: list[Log]) -> Samples:
    groups: list[Index] = [np.full(len(log), number) for number, log in enumerate(logs)]
    return flight_samples(SPEC, FlightData(), logs, groups)


def test_the_voltage_of_every_flight_becomes_an_input(tmp_path: Path) -> None:
    logs = [read(flown(tmp_path / f"{number}.ulg", number)) for number in range(FLIGHTS)]
    for number, log in enumerate(logs):
        ends = USUAL + LOST * (0.5 - (number + np.array([0.0, 1.0])) / FLIGHTS)
        np.testing.assert_allclose(log["battery_voltage"][[0, -1], 0], ends, atol=0.01)
    inputs = QuadrotorInputs().fitted(samples_of(logs))
    assert inputs.volts == pytest.approx(USUAL, abs=0.05)
    assert inputs.columns[-1][0] == "battery_voltage"


def test_without_a_power_module_there_is_none(tmp_path: Path) -> None:
    """PX4 then writes 0 V and -1 A; one such flight leaves the others without the input too."""
    raw = read_raw(flown(tmp_path / "without.ulg", 0, measured=False))
    assert not any("battery" in name for name in raw.values)
    logs = [read(flown(tmp_path / f"{number}.ulg", number, measured=number > 0)) for number in range(3)]
    assert ["battery_voltage" in log for log in logs] == [False, True, True]
    assert QuadrotorInputs().fitted(samples_of(logs)).volts is None
