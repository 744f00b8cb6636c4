"""Units: each factor by its definition, through the reader, whatever the header or the steps say."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_examples import (
    CHANNELS,
    FLIGHT_CHANNELS,
    JOINTS,
    LIMITS,
    LOWER,
    RATE,
    UPPER,
    make_log,
    with_values,
)

from etude.errors import DataError
from etude.logs import match_columns, raw_log, read_log
from etude.logs.cleaning.ranges import check_consistency, check_positions
from etude.logs.columns.units import from_degrees, read_time, time_factor
from etude.types import Array, Channel, Log

DEGREE = math.pi / 180.0
PER_SECOND = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
KNOWN = {
    **dict.fromkeys(("", "1", "rad", "rad/s", "rad/s2", "rad/s^2", "rad/s²"), 1.0),
    **dict.fromkeys(("m", "m/s", "m/s2", "m/s^2", "m/s²"), 1.0),
    **dict.fromkeys(("deg", "degrees", "°", "deg/s", "°/s", "dps"), DEGREE),
    **dict.fromkeys(("deg/s2", "deg/s^2", "deg/s²"), DEGREE),
    **dict.fromkeys(("nm", "n m", "n*m", "n.m", "n", "a", "v", "pwm"), 1.0),
    **dict.fromkeys(("mrad", "mm", "mm/s", "mnm", "ma", "mv"), 0.001),
    **{"g": 9.81, "mg": 0.00981, "%": 0.01},
}


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("off", [0.05, 1.0, 20.0])
def test_steps_tell_the_unit_of_time(unit: str, rate: float, off: float) -> None:
    """A recorder up to 20 times slower or faster than the robot's rate does not mislead."""
    t = np.arange(50) * off / rate * PER_SECOND[unit]
    factor, name = time_factor(t, rate, "log.csv")
    assert name == unit
    assert factor == pytest.approx(1.0 / PER_SECOND[unit], rel=1e-12)


@pytest.mark.parametrize(("factor", "said"), [(60.0, "60 times"), (1.0 / 60.0, "a 60th of")])
@pytest.mark.parametrize("rate", [50.0, 125.0, 1000.0])
def test_a_clock_that_is_off_by_60_is_no_other_unit(rate: float, factor: float, said: str) -> None:
    """Times 60 lies nearer to milliseconds, at 17 times the rate, than to seconds."""
    with pytest.raises(DataError, match=f"fits no unit at {rate:g} Hz: {said}"):
        time_factor(np.arange(50) * factor / rate, rate, "log.csv")


def test_minutes_are_read_where_the_header_says_so() -> None:
    minutes = np.arange(50) / 60.0 / 100.0
    for header in ("t [min]", "time_min"):
        t, said = read_time(raw_log({header: minutes}, "log.csv"), 100.0, "log.csv")
        np.testing.assert_allclose(t, np.arange(50) / 100.0, atol=1e-12)
        assert said == [f"Time was converted from min (column {header})."]


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
    t, repairs = read_time(raw_log({name: values}, "log.csv"), 100.0, "log.csv")
    np.testing.assert_allclose(t - t[0], seconds, atol=1e-6)
    words = [] if unit == "s" else [f"Time was converted from {unit} (column {name})."]
    if (
        start and words
    ):  # such numbers lose digits in seconds: who has to find the rows again is told the start
        words.append(f"Time was counted from its first row, {values[0]:.0f} {unit}.")
    assert repairs == words


def test_whole_seconds_and_nanoseconds_together() -> None:
    seconds = 1_750_000_000 + np.arange(0.0, 3.0, 0.25)
    parts = {"header.stamp.sec": np.floor(seconds), "header.stamp.nanosec": 1e9 * (seconds % 1.0)}
    t, _ = read_time(raw_log(parts, "log.csv"), 4.0, "log.csv")
    np.testing.assert_allclose(t, np.arange(0.0, 3.0, 0.25), atol=1e-9)


WORDS = {"q": "q", "qd": "qd", "command": "tau"}


def saved(path: Path, table: dict[str, Array]) -> Path:
    rows = np.column_stack(list(table.values()))
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path


def written(path: Path, log: Log, units: dict[str, str], factors: dict[str, float]) -> Path:
    """A table of the log with each channel in another unit, named in its headers."""
    table: dict[str, Array] = {"time": log.t}
    for channel, unit in units.items():
        values = log[channel] / factors[channel]
        table |= {f"{WORDS[channel]}_{name} [{unit}]": values[:, j] for j, name in enumerate(JOINTS)}
    return saved(path, table)


def read(path: Path) -> Log:
    return read_log(path, CHANNELS, rate=RATE, limits=LIMITS)


@pytest.mark.parametrize(
    ("units", "factors"),
    [
        ({"q": "deg", "qd": "deg/s", "command": "N m"}, {"q": DEGREE, "qd": DEGREE, "command": 1.0}),
        ({"q": "mrad", "qd": "rad/s", "command": "mNm"}, {"q": 0.001, "qd": 1.0, "command": 0.001}),
        ({"q": "rad", "qd": "°/s", "command": "N*m"}, {"q": 1.0, "qd": DEGREE, "command": 1.0}),
    ],
    ids=["degrees", "thousandths", "mixed"],
)
def test_units_in_headers_are_converted(
    tmp_path: Path, units: dict[str, str], factors: dict[str, float]
) -> None:
    plain = make_log()
    log = with_values(plain, qd=np.gradient(plain["q"], plain.t, axis=0))
    found = read(written(tmp_path / "log.csv", log, units, factors))
    for channel, factor in factors.items():
        np.testing.assert_allclose(found[channel], log[channel], rtol=1e-12, atol=1e-15)
        said = f"Channel {channel} was converted from {units[channel]}, as stated." in found.repairs
        assert said is (factor != 1.0)


def test_each_column_has_its_own_factor(tmp_path: Path) -> None:
    log = make_log()
    table = {"time": log.t}
    for j, (unit, factor) in enumerate([("deg", DEGREE), ("rad", 1.0), ("mrad", 0.001)]):
        table[f"q_{JOINTS[j]} [{unit}]"] = log["q"][:, j] / factor
    table |= {f"tau_{name}": log["command"][:, j] for j, name in enumerate(JOINTS)}
    found = read(saved(tmp_path / "log.csv", table))
    np.testing.assert_allclose(found["q"], log["q"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0 / DEGREE, "look like degrees"),
        (1000.0, "milliradians"),
        (5e4, "the position reaches"),
    ],
)
def test_positions_far_outside_are_suspected_of_a_unit(factor: float, words: str) -> None:
    wide = 0.99 * UPPER - np.linspace(0.0, 0.98, 2000)[:, None] * (UPPER - LOWER)
    log = with_values(make_log(), q=wide)
    assert check_positions(log, LIMITS) is log
    with pytest.raises(DataError, match=words):
        check_positions(with_values(log, q=wide * factor), LIMITS)


@pytest.mark.parametrize("unit", [unit for unit in KNOWN if unit != "1"])  # in brackets an index, no unit
def test_a_flight_is_read_in_si(unit: str) -> None:
    headers = [f"acc_{a}" for a in "xyz"] + [f"gyro_{a} [{unit}]" for a in "xyz"]
    found = match_columns([*headers, *(f"motor_{i}" for i in range(1, 5))], FLIGHT_CHANNELS, "log.csv")
    assert [c.factor for c in found.channels["rates"]] == pytest.approx([KNOWN[unit]] * 3)
    assert [c.factor for c in found.channels["specific_force"]] == [1.0] * 3


def test_degrees_are_a_matter_of_units_not_of_names() -> None:
    """A sliding joint is in m, a command in N m: neither is an angle; its rates are."""
    log = make_log()
    slide = replace(log.channels["q"], units=("rad", "m", "rad"))
    speed = Channel("qd", JOINTS, ("rad/s", "m/s", "rad/s"), derivative_of="q")
    log = log.put(slide, log["q"]).put(speed, log["q"])
    asked = from_degrees(log)
    factors = np.array([DEGREE, 1.0, DEGREE])
    for name in ("q", "qd"):
        np.testing.assert_allclose(asked[name], log[name] * factors, rtol=1e-14)
    np.testing.assert_array_equal(asked["command"], log["command"])
    believed = from_degrees(log, ("q", "qd"))
    np.testing.assert_array_equal(believed["q"], log["q"])
    assert "and this unit was used" in believed.repairs[-1]


@pytest.mark.parametrize(
    ("unit", "step", "right"),
    [("ms", 10.0, True), ("ms", 9864.0, False), ("s", 1.9, True), ("s", 2.1, False), ("ns", 1e-4, False)],
)
def test_a_stated_unit_of_time_in_which_nothing_is_recorded_is_refused(
    unit: str, step: float, right: bool
) -> None:
    """Microseconds called ms: the reader of such a flight would believe minutes."""
    raw = raw_log({f"# time[{unit}]": step * np.arange(50.0), "q": np.zeros(50)}, "log.csv")
    if right:
        assert read_time(raw, RATE, "log.csv")[0][-1] == pytest.approx(49 * step / PER_SECOND[unit])
        return
    with pytest.raises(DataError, match=f"in {unit} by the header, give a row every"):
        read_time(raw, RATE, "log.csv")


@pytest.mark.parametrize(("unit", "words"), [("m", "q in mm"), ("rad", "q in milliradians")])
def test_a_rate_that_disagrees_names_the_unit_of_that_joint(unit: str, words: str) -> None:
    log = make_log()
    way = np.sin(2.0 * log.t)[:, None]
    log = log.put(Channel("q", ("lift",), (unit,)), 1000.0 * way)
    log = log.put(
        Channel("qd", ("lift",), (f"{unit}/s",), derivative_of="q"), 2.0 * np.cos(2.0 * log.t)[:, None]
    )
    with pytest.raises(DataError, match=f"{words}\\?"):
        check_consistency(log)


def test_a_vehicle_far_from_its_room_is_not_in_millimetres() -> None:
    """Its place, which no model looks at: noted. What mm would be goes thousands of m."""
    lower, upper = np.full(3, -5.0), np.full(3, 5.0)
    channel = Channel("position", ("x", "y", "z"), ("m",) * 3, "aside")
    way = 1.0 - np.cos(np.linspace(0.0, 6.0, 200))[:, None] * np.ones(3)
    log = Log(np.arange(200.0), {}, {}, "flight.ulg")
    far = check_positions(log.put(channel, 28.0 * way), {"position": (lower, upper)})
    assert far.repairs == tuple(f"{a} went 51 m outside its position limits; kept." for a in "xyz")
    with pytest.raises(DataError, match=r"look like mm, not m:"):
        check_positions(log.put(channel, 1000.0 * way), {"position": (lower, upper)})
