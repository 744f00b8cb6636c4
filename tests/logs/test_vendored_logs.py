"""Recordings of real robots in examples/: files as described, units as expected, damaged copies refused."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from etude.errors import DataError
from etude.logs.crazyflie import COLUMNS, Flight, read_flights
from etude.logs.derivatives import median_rate
from etude.logs.log import RobotLog
from etude.logs.read import read_log
from etude.models.preprocess import build_dataset, preset
from etude.robots.toml_file import load_robot

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
ARMS = ("tx40", "tiago")
FILES = {"tx40": "tx40_exciting.csv", "tiago": "tiago_exciting.csv", "crazyflie": "crazyflie_flights.csv"}
LICENCES = {"tx40": "Apache-2.0", "tiago": "Apache-2.0", "crazyflie": "MIT"}
WORDS = {"Apache-2.0": "Apache License", "MIT": "Permission is hereby granted, free of charge"}


def csv(name: str) -> Path:
    return EXAMPLES / name / FILES[name]


@pytest.fixture(scope="module")
def logs() -> dict[str, RobotLog]:
    return {name: read_log(csv(name), load_robot(EXAMPLES / name / f"{name}.toml")) for name in ARMS}


@pytest.fixture(scope="module")
def flights() -> list[Flight]:
    return read_flights(csv("crazyflie"))


@pytest.mark.parametrize("name", FILES)
def test_the_files_are_what_their_readme_says(name: str) -> None:
    text = (EXAMPLES / name / "README.md").read_text()
    assert hashlib.sha256(csv(name).read_bytes()).hexdigest() in text
    assert LICENCES[name] in text
    assert WORDS[LICENCES[name]] in (EXAMPLES / name / "LICENSE").read_text()
    assert csv(name).stat().st_size < 1_000_000


@pytest.mark.parametrize("name", FILES)
def test_an_installed_package_has_log_licence_and_origin(name: str) -> None:
    wheel = (ROOT / "pyproject.toml").read_text()
    for file in (FILES[name], "LICENSE", "README.md", *([f"{name}.toml"] if name in ARMS else [])):
        assert f'"examples/{name}/{file}" = "etude/examples/{name}/{file}"' in wheel


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


def test_the_flights_are_si(flights: list[Flight]) -> None:
    assert [(f.number, len(f.t)) for f in flights] == [(10, 3000), (15, 3500), (16, 600), (16, 400)]
    for flight in flights:
        assert median_rate(flight.t) == pytest.approx(100.0)
        # in the mean over a flight without climb, thrust carries the weight
        assert flight.specific_force[:, 2].mean() == pytest.approx(9.81, rel=0.1)
        assert 0.3 < flight.command.mean() < 0.9
        assert np.abs(flight.rates).max() < 25.0


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [lines[0].replace("motor_3", "motor3"), *lines[1:]], "no column motor_3"),
        (lambda lines: lines[:30], "has 29 rows"),
        (lambda lines: [*lines[:-1], ",".join(lines[-1].split(",")[:5])], "no numbers"),
        (lambda lines: [*lines[:9], lines[9].replace(lines[9].split(",")[6], "nan"), *lines[10:]], "row 9"),
        (lambda lines: [lines[0], *reversed(lines[1:])], "time does not increase"),
    ],
    ids=["columns", "short", "truncated", "nan", "backwards"],
)
def test_damaged_flights_are_refused(change, message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message):
        read_flights(_rewritten(tmp_path, "crazyflie", change))


@pytest.mark.parametrize(
    ("columns", "factor", "message"),
    [
        (("motor_1", "motor_2"), 65535.0, "divide 16 bits"),
        (("rate_x",), 180.0 / np.pi, "degrees"),
        (("force_x", "force_y", "force_z"), 1.0 / 9.80665, "in g"),
    ],
)
def test_flights_in_other_units_are_refused(columns, factor, message: str, tmp_path: Path) -> None:
    values = np.loadtxt(csv("crazyflie"), delimiter=",", skiprows=1)
    for column in columns:
        values[:, COLUMNS.index(column)] *= factor
    path = tmp_path / "flights.csv"
    np.savetxt(path, values[:3000], delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.7g")
    with pytest.raises(DataError) as caught:
        read_flights(path)
    assert message in f"{caught.value.fact} {caught.value.next_step}"
