"""Flights as files: stored ones read back exactly; foreign tables are matched, converted or refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from etude.errors import DataError
from etude.logs.flight.log import FlightLog
from etude.logs.flight.parquet import flight_bytes, read_flight_parquet, write_flight
from etude.logs.flight.table import read_flight
from etude.robots.toml_file import load_robot
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.states import FlightStates

SPEC = load_robot("quadrotor").flight
RATE, COUNT = 100.0, 600
WEIGHT = np.array([0.0, 0.0, GRAVITY])


def motion(t):
    """Roll, pitch, yaw and position with closed-form rates: rotation about one axis at a time is exact."""
    roll = 0.3 * np.sin(2.0 * t)
    R = Rotation.from_euler("x", roll[:, None]).as_matrix()
    position = np.stack([np.sin(t), np.cos(t), 1.5 + 0.2 * np.sin(t)], axis=1)
    velocity = np.stack([np.cos(t), -np.sin(t), 0.2 * np.cos(t)], axis=1)
    acceleration = np.stack([-np.sin(t), -np.cos(t), -0.2 * np.sin(t)], axis=1)
    return roll, R, position, velocity, acceleration


def columns(unit_acc="", unit_gyro=""):
    """A recorder's table of that motion, header -> values, accelerometer and gyroscope in SI."""
    t = np.arange(COUNT) / RATE
    roll, R, position, _, acceleration = motion(t)
    force = np.einsum("tji,tj->ti", R, acceleration + WEIGHT)
    rates = np.stack([0.6 * np.cos(2.0 * t), 0.0 * t, 0.0 * t], axis=1)
    table = {"Time [s]": t, "roll": roll, "pitch": 0.0 * t, "yaw": 0.0 * t}
    table |= {f"acc.{a}{unit_acc}": force[:, j] for j, a in enumerate("xyz")}
    table |= {f"gyro.{a}{unit_gyro}": rates[:, j] for j, a in enumerate("xyz")}
    table |= {f"stateEstimate.{a}": position[:, j] for j, a in enumerate("xyz")}
    table |= {f"motor_{i}": 5.9 + 0.1 * np.sin(t + i) for i in range(1, 5)}
    return table


def written(path, table):
    rows = np.stack(list(table.values()), axis=1)
    text = ",".join(table) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    path.write_text(text + "\n")
    return path


def test_a_table_becomes_states(tmp_path):
    log = read_flight(written(tmp_path / "flight.csv", columns()), SPEC)
    t = log.t
    _, R, position, velocity, acceleration = motion(t)
    inside = slice(50, -50)  # ends of the zero-phase derivative
    np.testing.assert_allclose(log.position, position, atol=1e-12)
    np.testing.assert_allclose(log.states.altitude, position[:, 2], atol=1e-12)
    body_velocity = np.einsum("tji,tj->ti", R, velocity)
    np.testing.assert_allclose(log.states.velocity[inside], body_velocity[inside], atol=5e-3)
    np.testing.assert_allclose(log.states.acceleration, np.einsum("tji,tj->ti", R, acceleration), atol=1e-12)
    np.testing.assert_allclose(
        log.states.angular_acceleration[inside, 0], -1.2 * np.sin(2.0 * t[inside]), atol=5e-3
    )
    assert log.command.shape == (COUNT, 4)
    assert log.repairs == ()


def test_units_are_converted_as_stated(tmp_path):
    table = columns(unit_acc=" [g]", unit_gyro=" [deg/s]")
    table |= {k: v / GRAVITY for k, v in table.items() if "[g]" in k}
    table |= {k: np.rad2deg(v) for k, v in table.items() if "[deg/s]" in k}
    stated = read_flight(written(tmp_path / "stated.csv", table), SPEC)
    plain = read_flight(written(tmp_path / "plain.csv", columns()), SPEC)
    for field in fields(FlightStates):
        np.testing.assert_allclose(
            getattr(stated.states, field.name), getattr(plain.states, field.name), atol=1e-9
        )


def test_unstated_g_is_recognised_by_gravity(tmp_path):
    table = columns()
    table |= {k: v / GRAVITY for k, v in table.items() if k.startswith("acc")}
    log = read_flight(written(tmp_path / "g.csv", table), SPEC)
    plain = read_flight(written(tmp_path / "plain.csv", columns()), SPEC)
    np.testing.assert_allclose(log.states.specific_force, plain.states.specific_force, atol=1e-9)
    np.testing.assert_allclose(log.states.acceleration, plain.states.acceleration, atol=1e-9)
    assert any("from g" in sentence for sentence in log.repairs)


def test_attitude_as_quaternion_is_the_same(tmp_path):
    table = columns()
    roll = table.pop("roll")
    del table["pitch"], table["yaw"]
    table |= {"qw": np.cos(roll / 2), "qx": np.sin(roll / 2), "qy": 0.0 * roll, "qz": 0.0 * roll}
    log = read_flight(written(tmp_path / "quaternion.csv", table), SPEC)
    plain = read_flight(written(tmp_path / "euler.csv", columns()), SPEC)
    np.testing.assert_allclose(log.states.velocity, plain.states.velocity, atol=1e-9)


def test_without_position_and_attitude_the_states_say_less(tmp_path):
    table = {k: v for k, v in columns().items() if not k.startswith(("state", "roll", "pitch", "yaw"))}
    states = read_flight(written(tmp_path / "imu.csv", table), SPEC).states
    assert states.altitude is states.velocity is states.acceleration is None


def broken(change):
    table = columns()
    change(table)
    return table


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: [t.pop(k) for k in list(t) if k.startswith("gyro")], "there is no rates"),
        (lambda t: t.pop("motor_2"), "there is no command 'back_right'"),
        (
            lambda t: t.update({k: 57.3 * v for k, v in t.items() if k.startswith("gyro")}),
            "look like degrees",
        ),
        (
            lambda t: t.update({k: 1000.0 * v for k, v in t.items() if k.startswith("acc")}),
            "accelerometer's length",
        ),
        (lambda t: t.update({"motor_3": 1000.0 * t["motor_3"]}), "back_left' reaches"),
        (lambda t: t.update({"motor_1": 0.0 * t["motor_1"] + 11.1}), "at its limit throughout"),
        (lambda t: t["gyro.x"].__setitem__(slice(0, 300), np.nan), "rows have empty or NaN"),
        (lambda t: t.update({k: v[:20] for k, v in t.items()}), "usable rows"),
        (lambda t: t.update({"acc.x [furlong]": t.pop("acc.x")}), "unknown unit"),
    ],
)
def test_unusable_flights_are_refused(tmp_path, change, message):
    with pytest.raises(DataError, match=message):
        read_flight(written(tmp_path / "bad.csv", broken(change)), SPEC)


def test_a_few_bad_cells_are_dropped_and_told(tmp_path):
    table = broken(lambda t: t["acc.y"].__setitem__(slice(100, 103), np.nan))
    log = read_flight(written(tmp_path / "gap.csv", table), SPEC)
    assert len(log) == COUNT  # the gap is bridged on the grid
    assert "3 rows with empty cells" in log.repairs[0]


def some_log(altitude=True):
    rng = np.random.default_rng(1)
    rows = lambda: rng.normal(size=(60, 3))  # noqa: E731
    force = rows() + WEIGHT
    states = FlightStates(rng.uniform(1, 2, 60) if altitude else None, force, rows(), rows(), rows(), None)
    command = rng.uniform(5, 6, (60, 4))
    return FlightLog(np.arange(60) / 10, states, command, SPEC.command_names, "V", rows(), None, "s", ("r",))


@pytest.mark.parametrize("altitude", [True, False])
def test_stored_flights_read_back_exactly(tmp_path, altitude):
    log = some_log(altitude)
    write_flight(log, tmp_path / "f.parquet")
    back = read_flight_parquet(tmp_path / "f.parquet")
    assert flight_bytes(back) == flight_bytes(log)
    assert (back.states.altitude is None) is not altitude
    again = read_flight(tmp_path / "f.parquet", SPEC)
    np.testing.assert_array_equal(again.command, log.command)


def test_a_flight_of_another_vehicle_or_with_nan_is_refused(tmp_path):
    log = some_log()
    write_flight(replace(log, command_names=("a", "b", "c", "d")), tmp_path / "other.parquet")
    with pytest.raises(DataError, match="the flight has the commands a, b, c, d"):
        read_flight(tmp_path / "other.parquet", SPEC)
    log.states.rates[7, 1] = np.nan
    write_flight(log, tmp_path / "nan.parquet")
    with pytest.raises(DataError, match="not a number"):
        read_flight(tmp_path / "nan.parquet", SPEC)
    (tmp_path / "cut.parquet").write_bytes(flight_bytes(log)[:200])
    with pytest.raises(DataError):
        read_flight(tmp_path / "cut.parquet", SPEC)
