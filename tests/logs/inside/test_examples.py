"""Recordings of real robots in examples/: files as described, values pinned, damaged copies refused."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_examples import FLIGHT_CHANNELS, FLIGHT_RATE, joint_channels

from etude.errors import DataError
from etude.logs import median_rate, read_log, smooth
from etude.logs.cleaning.filters import command_lag, differentiated, uniform
from etude.logs.columns.units import Limits
from etude.types import Array, Channel, Log

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples"
ARMS = ("ur10", "tx40", "tiago")
FLIGHTS = {
    "crazyflie_10": "log10_thrust.csv",
    "crazyflie_15": "log15_roll_pitch.csv",
    "crazyflie_16a": "log16_yaw_first.csv",
    "crazyflie_16b": "log16_yaw_second.csv",
}
FILES = {**{name: f"{name}_exciting.csv" for name in ARMS}, **FLIGHTS}
LICENCES = {
    "ur10": "BSD-3-Clause",
    "tx40": "Apache-2.0",
    "tiago": "Apache-2.0",
    **dict.fromkeys(FLIGHTS, "MIT"),
}
WORDS = {
    "Apache-2.0": "Apache License",
    "MIT": "Permission is hereby granted, free of charge",
    "BSD-3-Clause": "Redistribution and use",
}
# SHA-256 of times, then of the channels in alphabetical order, as version 0.1 read them: of the arms as they
# stand, of the flights on the uniform grid that it put them on
VALUES = {
    "ur10": "1707a144ee175dd1",
    "tx40": "4545241afca3b0a7",
    "tiago": "1a54193c33d63e6a",
    "crazyflie_10": "897ce4a95711c755",
    "crazyflie_15": "4448dbb8d44f08bc",
    "crazyflie_16a": "15f85504c107fdf8",
    "crazyflie_16b": "80336669b79da0cf",
}


def folder(name: str) -> str:
    return name.split("_")[0]


def csv(name: str) -> Path:
    return EXAMPLES / folder(name) / FILES[name]


def described(name: str) -> tuple[tuple[Channel, ...], Limits, float]:
    """Channels, limits and usual rate, from the robot file alone."""
    table = tomllib.loads((EXAMPLES / folder(name) / f"{folder(name)}.toml").read_text())
    if "axis" not in table:
        motors = replace(FLIGHT_CHANNELS[0], parts=tuple(table["commands"]), units=("1",) * 4)
        limits = {"command": (np.array(table["command_lower"]), np.array(table["command_upper"]))}
        return (motors, *FLIGHT_CHANNELS[1:]), limits, FLIGHT_RATE
    column = {key: np.array([axis[key] for axis in table["axis"]]) for key in ("lower", "upper")}
    q, qd, command = (np.array([axis[k] for axis in table["axis"]]) for k in ("upper", "velocity", "command"))
    limits = {"q": (column["lower"], q), "qd": (-qd, qd), "command": (-command, command)}
    names = tuple(axis["name"] for axis in table["axis"])
    return joint_channels(names, table["command_unit"]), limits, table["rate"]


def read(name: str, path: Path | None = None, own_clock: bool = False) -> Log:
    channels, limits, rate = described(name)
    return read_log(path or csv(name), channels, rate=rate, limits=limits, own_clock=own_clock)


def digest(t: Array, log: Log) -> str:
    found = hashlib.sha256()
    for values in (t, *(log[name] for name in sorted(log.values))):
        found.update(np.ascontiguousarray(values).tobytes())
    return found.hexdigest()[:16]


@pytest.fixture(scope="module")
def logs() -> dict[str, Log]:
    return {name: read(name) for name in FILES}


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


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_read_to_the_bit(name: str, logs: dict[str, Log]) -> None:
    assert digest(logs[name].t, logs[name]) == VALUES[name]
    assert logs[name].repairs == ()


@pytest.mark.parametrize("name", FLIGHTS)
def test_flights_are_read_to_the_bit(name: str, logs: dict[str, Log]) -> None:
    """On the grid of the recorder's clock, which 0.1 moved to 0 after and not before."""
    grid = uniform(read(name, own_clock=True))
    assert digest(grid.t - grid.t[0], grid) == VALUES[name]
    mine = uniform(logs[name])
    for channel in mine.values:
        np.testing.assert_allclose(mine[channel], grid[channel], rtol=0, atol=1e-11)
    assert [s for s in logs[name].repairs if "Time begins" not in s] == []


def test_a_flight_is_its_file(logs: dict[str, Log]) -> None:
    values = np.loadtxt(csv("crazyflie_10"), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(logs["crazyflie_10"]["command"], values[:, 7:])
    np.testing.assert_array_equal(logs["crazyflie_10"]["rates"], values[:, 4:7])


def test_rates_and_lengths(logs: dict[str, Log]) -> None:
    lengths = {"ur10": 3441, "tx40": 4500, "tiago": 8022}
    lengths |= dict(zip(FLIGHTS, (3000, 3500, 600, 400), strict=True))
    assert {name: len(log) for name, log in logs.items()} == lengths
    assert median_rate(logs["tx40"].t) == pytest.approx(500.0)  # 5 kHz, ten averaged
    assert median_rate(logs["tiago"].t) == pytest.approx(100.0, rel=0.01)
    assert logs["ur10"].t[-1] == pytest.approx(27.52)
    assert logs["tx40"].t[-1] == pytest.approx(8.998)
    assert logs["tiago"].t[-1] == pytest.approx(80.21, abs=0.01)
    assert all(log.t[0] == 0.0 for log in logs.values())


def test_positions_are_radians_and_commands_those_of_the_unit(logs: dict[str, Log]) -> None:
    reach = np.ptp(logs["tx40"]["q"], axis=0)
    assert reach == pytest.approx([3.841, 1.991, 2.88, 5.587, 3.456, 6.98], abs=0.02)
    # gravity at the shoulder of an industrial arm: tens of N m, mostly of one sign
    assert 30.0 < np.abs(logs["tx40"]["command"][:, 1]).max() < 100.0
    assert np.ptp(logs["tiago"]["q"][:, 0]) < 0.35  # the lift's travel in m


@pytest.mark.parametrize("name", ["tx40", "tiago"])
def test_the_limits_hold_the_recorded_motion_with_little_to_spare(name: str, logs: dict[str, Log]) -> None:
    log, limits = logs[name], described(name)[1]
    assert np.all((limits["q"][0] <= log["q"]) & (log["q"] <= limits["q"][1]))
    assert np.all(np.abs(log["command"]).max(axis=0) < limits["command"][1])


def test_the_flights_are_si(logs: dict[str, Log]) -> None:
    for log in (logs[name] for name in FLIGHTS):
        assert median_rate(log.t) == pytest.approx(100.0)
        # in the mean over a flight without climb, thrust carries the weight
        assert log["specific_force"][:, 2].mean() == pytest.approx(9.81, rel=0.1)
        assert 0.3 < log["command"].mean() < 0.9
        assert np.abs(log["rates"]).max() < 25.0
        assert set(log.values) == {"command", "specific_force", "rates"}


def test_the_motors_lag(logs: dict[str, Log]) -> None:
    turning = Channel("angular_acceleration", ("x", "y", "z"), ("rad/s^2",) * 3, derivative_of="rates")
    thrust, roll_pitch = (
        differentiated(uniform(logs[name]), "rates", turning, 12.5) for name in list(FLIGHTS)[:2]
    )
    states = ("specific_force", "rates", "angular_acceleration")
    lags = [command_lag(told, states) for told in ([roll_pitch], [thrust, roll_pitch], [thrust])]
    assert 0.02 < lags[0] < lags[1] < lags[2] < 0.08


def test_differentiated_positions_agree_with_the_drivers_velocity(logs: dict[str, Log]) -> None:
    log = logs["ur10"]
    slope = smooth(log.t, log["q"], 10.0).first
    np.testing.assert_allclose(slope[50:-50], log["qd"][50:-50], atol=0.05)


def test_degrees_are_noticed(logs: dict[str, Log], tmp_path: Path) -> None:
    log, header = logs["ur10"], csv("ur10").read_text().split("\n", 1)[0]
    values = np.column_stack([log.t, np.rad2deg(log["q"]), log["command"]])
    names = [name for name in header.split(",") if "velocity" not in name]
    np.savetxt(tmp_path / "deg.csv", values, delimiter=",", header=",".join(names), comments="")
    with pytest.raises(DataError, match="look like degrees"):
        read("ur10", tmp_path / "deg.csv")


def test_the_model_file_is_what_its_script_makes() -> None:
    script = EXAMPLES / "ur10" / "make_urdf.py"
    found = importlib.util.spec_from_file_location("make_urdf", script)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["make_urdf"] = module  # dataclasses look their module up by name
    try:
        found.loader.exec_module(module)
        assert module.urdf() == (EXAMPLES / "ur10" / "ur10.urdf").read_text()
    finally:
        del sys.modules["make_urdf"]


def _rewritten(target: Path, name: str, change) -> Path:  # type: ignore[no-untyped-def]
    lines = csv(name).read_text().splitlines()[:400]
    path = target / FILES[name]
    path.write_text("\n".join(change(lines)) + "\n")
    return path


@pytest.mark.parametrize("name", ARMS)
def test_damaged_arm_logs_are_refused(name: str, tmp_path: Path) -> None:
    last = csv(name).read_text().split("\n", 1)[0].split(",")[-1]
    wrong = _rewritten(tmp_path, name, lambda lines: [lines[0].replace(last, "temperature"), *lines[1:]])
    with pytest.raises(DataError, match="no column for channel 'command'"):
        read(name, wrong)
    with pytest.raises(DataError, match="usable rows"):
        read(name, _rewritten(tmp_path, name, lambda lines: lines[:40]))
    blank = _rewritten(
        tmp_path, name, lambda lines: [lines[0], *(",".join([*x.split(",")[:-1], "nan"]) for x in lines[1:])]
    )
    with pytest.raises(DataError):
        read(name, blank)


def _renamed(lines: list[str], old: str, new: str) -> list[str]:
    return [lines[0].replace(old, new), *lines[1:]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: _renamed(lines, "motor_3", "temperature"), "channel 'command' are numbered 1, 2, 4"),
        (lambda lines: _renamed(lines, "gyro_y", "yaw_rate"), "channel 'rates' of y"),
        (lambda lines: _renamed(lines, "acc_z", "baro"), "channel 'specific_force' of z"),
        (lambda lines: _renamed(lines, "t [s]", "row"), "no time column"),
        (lambda lines: _renamed(lines, "rad/s", "furlong"), "unknown unit 'furlong'"),
        (lambda lines: lines[:30], "29 usable rows"),
        (
            lambda lines: [lines[0], *(",".join(x.split(",")[:5]) + "," * 6 for x in lines[1:])],
            "empty, NaN",
        ),
    ],
    ids=["command", "gyro", "acc", "time", "unit", "short", "truncated"],
)
def test_damaged_flights_are_refused(change, message: str, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError, match=message):
        read("crazyflie_10", _rewritten(tmp_path, "crazyflie_10", change))


@pytest.mark.parametrize(
    ("columns", "factor", "message"),
    [
        ((7, 8), 65535.0, "m1 reaches"),
        ((4, 5, 6), 180.0 / np.pi, "degrees per second"),
        ((1, 2, 3), 1000.0, "accelerometer's length"),
    ],
)
def test_flights_in_other_units_are_refused(
    columns: tuple[int, ...], factor: float, message: str, tmp_path: Path
) -> None:
    header = csv("crazyflie_15").read_text().split("\n", 1)[0].replace(" [rad/s]", "").replace(" [m/s^2]", "")
    values = np.loadtxt(csv("crazyflie_15"), delimiter=",", skiprows=1)
    values[:, columns] *= factor
    path = tmp_path / "flight.csv"
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.7g")
    with pytest.raises(DataError, match=message):
        read("crazyflie_15", path)
