"""Units: each factor by its definition, through the reader, whatever the header or the steps say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from log_examples import SPEC, Array, make_log

from etude.errors import DataError
from etude.logs import columns
from etude.logs.flight import columns as flight
from etude.logs.log import RobotLog
from etude.logs.read import read_log, read_time
from etude.logs.table import Table
from etude.logs.units import position_suspicion, time_factor

DEGREE = math.pi / 180.0
PER_SECOND = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
ANGLES = {
    **dict.fromkeys(("rad", "rad/s", "rad/s2", "rad/s^2", "m", "m/s", "m/s2", ""), 1.0),
    **dict.fromkeys(("deg", "degrees", "°", "deg/s", "°/s", "deg/s2", "deg/s^2"), DEGREE),
    **dict.fromkeys(("mrad", "mm", "mm/s"), 0.001),
}
COMMANDS = {
    **dict.fromkeys(("nm", "n m", "n*m", "n.m", "n", "a", "v", "pwm"), 1.0),
    **dict.fromkeys(("mnm", "ma", "mv"), 0.001),
}
FLIGHT = {
    **dict.fromkeys(("", "m", "m/s", "m/s2", "m/s^2", "rad", "rad/s", "v", "1"), 1.0),
    **dict.fromkeys(("deg", "deg/s", "°", "°/s", "dps"), DEGREE),
    **dict.fromkeys(("mm", "mm/s", "mv"), 0.001),
    **{"g": 9.81, "mg": 0.00981, "%": 0.01},
}


def test_every_unit_of_a_column_is_known_here() -> None:
    assert pytest.approx({**ANGLES, **COMMANDS}) == columns.UNITS
    assert pytest.approx(FLIGHT, rel=1e-3) == flight.UNITS  # which g is the vehicle's matter
    assert flight.UNITS["mg"] == pytest.approx(flight.UNITS["g"] / 1000.0)


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("off", [0.05, 1.0, 20.0])
def test_steps_tell_the_unit_of_time(unit: str, rate: float, off: float) -> None:
    """A recorder up to 20 times slower or faster than the robot's rate does not mislead."""
    t = np.arange(50) * off / rate * PER_SECOND[unit]
    factor, name = time_factor(t, rate, "log.csv")
    assert name == unit
    assert factor == pytest.approx(1.0 / PER_SECOND[unit], rel=1e-12)


def test_pauses_and_repeats_do_not_decide_the_unit() -> None:
    t = np.repeat(np.arange(50) * 10.0, 2)
    t[60:] += 1e6
    assert time_factor(t, 100.0, "log.csv") == (1e-3, "ms")


@pytest.mark.parametrize("step", [1e-12, 1e12])
def test_steps_of_no_unit(step: float) -> None:
    with pytest.raises(DataError, match="fits no unit at 1 Hz"):
        time_factor(np.arange(9) * step, 1.0, "log.csv")


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("header", ["time_{}", "t [{}]", "time"])
@pytest.mark.parametrize("start", [0.0, 1.75e9])
def test_time_in_any_unit_is_read_in_seconds(unit: str, header: str, start: float) -> None:
    seconds = np.arange(200) * 0.01
    name = header.format(unit)
    values = np.round(start * PER_SECOND[unit]) + seconds * PER_SECOND[unit]
    t, repairs = read_time(Table({name: values}, ()), 100.0, "log.csv")
    np.testing.assert_allclose(t - t[0], seconds, atol=1e-6)
    words = [] if unit == "s" else [f"Time was converted from {unit} (column {name})."]
    assert repairs == words


def test_whole_seconds_and_nanoseconds_together() -> None:
    seconds = 1_750_000_000 + np.arange(0.0, 3.0, 0.25)
    parts = {"header.stamp.sec": np.floor(seconds), "header.stamp.nanosec": 1e9 * (seconds % 1.0)}
    t, _ = read_time(Table(parts, ()), 4.0, "log.csv")
    np.testing.assert_allclose(t, np.arange(0.0, 3.0, 0.25), atol=1e-9)


def written(path: Path, log: RobotLog, units: dict[str, str], factors: dict[str, float]) -> Path:
    """A table of the log with each channel in another unit, named in its headers."""
    table: dict[str, Array] = {"time": log.t}
    for channel, unit in units.items():
        values = getattr(log, channel) / factors[channel]
        table |= {f"{channel}_{name} [{unit}]": values[:, j] for j, name in enumerate(log.names)}
    rows = np.column_stack(list(table.values()))
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("units", "factors"),
    [
        ({"q": "deg", "qd": "deg/s", "tau": "N m"}, {"q": DEGREE, "qd": DEGREE, "tau": 1.0}),
        ({"q": "mrad", "qd": "rad/s", "tau": "mNm"}, {"q": 0.001, "qd": 1.0, "tau": 0.001}),
        ({"q": "rad", "qd": "°/s", "tau": "N*m"}, {"q": 1.0, "qd": DEGREE, "tau": 1.0}),
    ],
    ids=["degrees", "thousandths", "mixed"],
)
def test_units_in_headers_are_converted(
    tmp_path: Path, units: dict[str, str], factors: dict[str, float]
) -> None:
    plain = make_log()
    slope = np.gradient(plain.q, plain.t, axis=0)
    log = RobotLog(plain.names, plain.command_unit, plain.t, plain.q, plain.tau, qd=slope)
    read = read_log(written(tmp_path / "log.csv", log, units, factors), SPEC)
    for channel in ("q", "qd", "tau"):
        np.testing.assert_allclose(getattr(read, channel), getattr(log, channel), rtol=1e-12, atol=1e-15)
    converted = [c for c, factor in factors.items() if factor != 1.0]
    for channel in ("q", "qd", "tau"):
        said = f"Channel {channel} was converted from the unit in its headers." in read.repairs
        assert said is (channel in converted)


def test_each_column_has_its_own_factor(tmp_path: Path) -> None:
    log = make_log()
    table = {"time": log.t}
    for j, (unit, factor) in enumerate([("deg", DEGREE), ("rad", 1.0), ("mrad", 0.001)]):
        table[f"q_{log.names[j]} [{unit}]"] = log.q[:, j] / factor
    table |= {f"tau_{name}": log.tau[:, j] for j, name in enumerate(log.names)}
    rows = np.column_stack(list(table.values()))
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows.tolist())]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    np.testing.assert_allclose(read_log(path, SPEC).q, log.q, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0 / DEGREE, "degrees"), (1000.0, "milliradians (or mm)"), (1.0, ""), (5e4, "")]
)
def test_positions_far_outside_are_suspected_of_a_unit(factor: float, unit: str) -> None:
    wide = 0.99 * SPEC.upper - np.linspace(0.0, 0.98, 50)[:, None] * (SPEC.upper - SPEC.lower)
    assert position_suspicion(wide * factor, SPEC) == unit


@pytest.mark.parametrize(
    ("unit", "factor"),
    [pair for pair in FLIGHT.items() if pair[0] != "1"],  # in brackets an index, no unit
)
def test_a_flight_is_read_in_si(unit: str, factor: float) -> None:
    from etude.robots.toml_file import load_robot

    spec = load_robot("quadrotor").flight
    assert spec is not None
    values = np.linspace(-1.0, 1.0, 20)
    plain = {f"acc_{a}": values for a in "xyz"} | {
        f"gyro_{a} [{unit}]": values * k for k, a in enumerate("xyz")
    }
    plain |= {f"motor_{i}": values for i in range(1, 5)}
    found = flight.flight_columns(Table(plain, ()), spec, "log.csv")
    expected = np.stack([values * k * factor for k in range(3)], axis=1)
    np.testing.assert_allclose(found.vectors["rates"], expected, rtol=1e-3)
    np.testing.assert_array_equal(found.vectors["specific_force"], np.stack([values] * 3, axis=1))
