"""Recordings of real robots in examples/: files as described, units as expected, damaged copies refused."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.derivatives import median_rate
from etude.logs.flight.lag import command_lag
from etude.logs.flight.log import FlightLog
from etude.logs.flight.table import read_flight
from etude.logs.log import RobotLog
from etude.logs.read import read_log
from etude.models.preprocess import build_dataset, preset
from etude.robots.toml_file import load_robot

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
ARMS = ("tx40", "tiago")
FLIGHTS = {
    "crazyflie_10": "log10_thrust.csv",
    "crazyflie_15": "log15_roll_pitch.csv",
    "crazyflie_16a": "log16_yaw_first.csv",
    "crazyflie_16b": "log16_yaw_second.csv",
}
FILES = {"tx40": "tx40_exciting.csv", "tiago": "tiago_exciting.csv", **FLIGHTS}
LICENCES = {"tx40": "Apache-2.0", "tiago": "Apache-2.0", **dict.fromkeys(FLIGHTS, "MIT")}
WORDS = {"Apache-2.0": "Apache License", "MIT": "Permission is hereby granted, free of charge"}


VEHICLE = load_robot(EXAMPLES / "crazyflie" / "crazyflie.toml").flight


def folder(name: str) -> str:
    return name.split("_")[0]


def csv(name: str) -> Path:
    return EXAMPLES / folder(name) / FILES[name]


@pytest.fixture(scope="module")
def logs() -> dict[str, RobotLog]:
    return {name: read_log(csv(name), load_robot(EXAMPLES / name / f"{name}.toml")) for name in ARMS}


@pytest.fixture(scope="module")
def flights() -> list[FlightLog]:
    return [read_flight(csv(name), VEHICLE) for name in FLIGHTS]


@pytest.mark.parametrize("name", FILES)
def test_the_files_are_what_their_readme_says(name: str) -> None:
    text = (EXAMPLES / folder(name) / "README.md").read_text()
    assert hashlib.sha256(csv(name).read_bytes()).hexdigest() in text
    assert LICENCES[name] in text
    assert WORDS[LICENCES[name]] in (EXAMPLES / folder(name) / "LICENSE").read_text()
    assert csv(name).stat().st_size < 1_000_000


@pytest.mark.parametrize("name", FILES)
def test_an_installed_package_has_log_licence_and_origin(name: str) -> None:
    wheel = (ROOT / "pyproject.toml").read_text()
    own = folder(name)
    for file in (FILES[name], "LICENSE", "README.md", f"{own}.toml"):
        assert f'"examples/{own}/{file}" = "etude/examples/{own}/{file}"' in wheel


def test_arm_logs_are_read_without_repairs_at_their_rates(logs: dict[str, RobotLog]) -> None:
    assert logs["tx40"].q.shape == (4500, 6)
    assert logs["tiago"].q.shape == (8022, 5)
    assert median_rate(logs["tx40"].t) == pytest.approx(500.0)  # 5 kHz, ten averaged
    assert median_rate(logs["tiago"].t) == pytest.approx(100.0, rel=0.01)
    assert all(log.repairs == () for log in logs.values())
    assert logs["tx40"].t[-1] == pytest.approx(8.998)
    assert logs["tiago"].t[-1] == pytest.approx(80.21, abs=0.01)


def test_positions_are_radians_and_commands_those_of_the_unit(logs: dict[str, RobotLog]) -> None:
    assert np.ptp(logs["tx40"].q, axis=0) == pytest.approx([3.841, 1.991, 2.88, 5.587, 3.456, 6.98], abs=0.02)
    # gravity at the shoulder of an industrial arm: tens of N m, mostly of one sign
    assert 30.0 < np.abs(logs["tx40"].tau[:, 1]).max() < 100.0
    assert np.ptp(logs["tiago"].q[:, 0]) < 0.35  # the lift's travel in m
    assert logs["tiago"].command_unit == "A"
    assert logs["tx40"].command_unit == "N m"


def test_the_limits_hold_the_recorded_motion_with_little_to_spare(logs: dict[str, RobotLog]) -> None:
    for name, log in logs.items():
        spec = load_robot(EXAMPLES / name / f"{name}.toml")
        data = build_dataset(log, spec, preset("default"))
        assert np.all((spec.lower <= log.q) & (log.q <= spec.upper))
        used = np.abs(data.qd).max(axis=0) / spec.velocity
        assert np.all((used > 0.6) & (used < 1.0)), name
        assert np.all(np.abs(log.tau).max(axis=0) < spec.command)


def test_the_flights_are_si(flights: list[FlightLog]) -> None:
    assert [len(log) for log in flights] == [3000, 3500, 600, 400]
    for log in flights:
        assert median_rate(log.t) == pytest.approx(100.0)
        assert log.t[0] == 0.0
        # in the mean over a flight without climb, thrust carries the weight
        assert log.states.specific_force[:, 2].mean() == pytest.approx(9.81, rel=0.1)
        assert 0.3 < log.command.mean() < 0.9
        assert np.abs(log.states.rates).max() < 25.0
        assert log.states.altitude is log.states.velocity is log.position is None
        assert log.repairs == ()


def test_a_flight_is_its_file(flights: list[FlightLog]) -> None:
    values = np.loadtxt(csv("crazyflie_10"), delimiter=",", skiprows=1)
    np.testing.assert_allclose(flights[0].command, values[:, 7:], atol=1e-9)
    np.testing.assert_allclose(flights[0].states.rates, values[:, 4:7], atol=1e-9)


def test_the_motors_lag(flights: list[FlightLog]) -> None:
    thrust, roll_pitch = flights[:2]
    assert 0.02 < command_lag(roll_pitch) < command_lag(thrust, roll_pitch) < command_lag(thrust) < 0.08


def _rewritten(folder: Path, name: str, change) -> Path:
    lines = csv(name).read_text().splitlines()[:400]
    path = folder / FILES[name]
    path.write_text("\n".join(change(lines)) + "\n")
    return path


@pytest.mark.parametrize("name", ARMS)
def test_damaged_arm_logs_are_refused(name: str, tmp_path: Path) -> None:
    spec = load_robot(EXAMPLES / name / f"{name}.toml")
    last = csv(name).read_text().split("\n", 1)[0].split(",")[-1]
    wrong = _rewritten(tmp_path, name, lambda lines: [lines[0].replace(last, "temperature"), *lines[1:]])
    with pytest.raises(DataError, match="no column for channel 'tau'"):
        read_log(wrong, spec)
    with pytest.raises(DataError, match="usable rows"):
        read_log(_rewritten(tmp_path, name, lambda lines: lines[:40]), spec)
    blank = _rewritten(
        tmp_path, name, lambda lines: [lines[0], *(",".join([*x.split(",")[:-1], "nan"]) for x in lines[1:])]
    )
    with pytest.raises(DataError):
        read_log(blank, spec)


def _renamed(lines: list[str], old: str, new: str) -> list[str]:
    return [lines[0].replace(old, new), *lines[1:]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: _renamed(lines, "motor_3", "temperature"), "there is no command 'm3'"),
        (lambda lines: _renamed(lines, "gyro_y", "yaw_rate"), "there is no rates"),
        (lambda lines: _renamed(lines, "acc_z", "baro"), "there is no specific force"),
        (lambda lines: _renamed(lines, "t [s]", "row"), "no time column"),
        (lambda lines: _renamed(lines, "rad/s", "rpm"), "unknown unit 'rpm'"),
        (lambda lines: lines[:30], "29 usable rows"),
        (
            lambda lines: [lines[0], *(",".join(x.split(",")[:5]) + "," * 6 for x in lines[1:])],
            "empty or NaN",
        ),
        (lambda lines: [lines[0], *reversed(lines[1:])], "does not advance"),
    ],
    ids=["command", "gyro", "acc", "time", "unit", "short", "truncated", "backwards"],
)
def test_damaged_flights_are_refused(change, message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        read_flight(_rewritten(tmp_path, "crazyflie_10", change), VEHICLE)


@pytest.mark.parametrize(
    ("columns", "factor", "message"),
    [
        ((7, 8), 65535.0, "m1' reaches"),
        ((4, 5, 6), 180.0 / np.pi, "degrees per second"),
        ((1, 2, 3), 1000.0, "accelerometer's length"),
    ],
)
def test_flights_in_other_units_are_refused(columns, factor, message: str, tmp_path: Path) -> None:
    header = csv("crazyflie_15").read_text().split("\n", 1)[0].replace(" [rad/s]", "")
    values = np.loadtxt(csv("crazyflie_15"), delimiter=",", skiprows=1)
    values[:, columns] *= factor
    path = tmp_path / "flight.csv"
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.7g")
    with pytest.raises(DataError, match=message):
        read_flight(path, VEHICLE)
