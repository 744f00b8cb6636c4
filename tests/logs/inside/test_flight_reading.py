"""Recorders' tables of flights: channels matched, converted over channels, checked; nothing is derived."""

from __future__ import annotations

import numpy as np
import pytest
from log_examples import FLIGHT_CHANNELS, FLIGHT_LIMITS, FLIGHT_RATE, MOTORS

from etude.errors import DataError
from etude.logs import read_log
from etude.logs.columns.header_units import GRAVITY

RATE, COUNT = 100.0, 600
TILTS = ("roll", "pitch", "yaw")


def columns(unit_acc="", unit_gyro="", unit_tilt=""):
    """A recorder's table of a swinging flight, header -> values, in SI."""
    t = np.arange(COUNT) / RATE
    roll = 0.3 * np.sin(2.0 * t)
    force = np.stack([0.1 * np.sin(t), GRAVITY * np.sin(roll), GRAVITY * np.cos(roll)], axis=1)
    rates = np.stack([0.6 * np.cos(2.0 * t), 0.0 * t, 0.0 * t], axis=1)
    position = np.stack([np.sin(t), np.cos(t), 1.5 + 0.2 * np.sin(t)], axis=1)
    table = {"Time [s]": t}
    table |= {
        f"{name}{unit_tilt}": values for name, values in zip(TILTS, (roll, 0.0 * t, 0.1 * t), strict=True)
    }
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


def read(path, degrees=False):
    return read_log(path, FLIGHT_CHANNELS, rate=FLIGHT_RATE, limits=FLIGHT_LIMITS, degrees=degrees)


def assert_same(log, other, rtol=1e-12):
    assert set(log.values) == set(other.values)
    for name in log.values:
        np.testing.assert_allclose(log[name], other[name], rtol=rtol, atol=1e-12)


def test_a_table_becomes_channels(tmp_path):
    table = columns()
    log = read(written(tmp_path / "flight.csv", table))
    names = {"command", "specific_force", "rates", "attitude", "position"}
    assert set(log.values) == names
    assert log.channels["command"].parts == MOTORS
    np.testing.assert_array_equal(log["rates"][:, 0], table["gyro.x"])
    np.testing.assert_array_equal(log["attitude"][:, 2], table["yaw"])
    np.testing.assert_array_equal(log["position"][:, 1], table["stateEstimate.y"])
    np.testing.assert_array_equal(log["command"][:, 3], table["motor_4"])
    assert log.repairs == (
        "Columns motor_1, motor_2, motor_3, motor_4 were read as front_right, back_right, back_left, "
        "front_left, in this order.",
    )


def test_units_are_converted_as_stated(tmp_path):
    table = columns(" [g]", " [deg/s]", " [deg]")
    table |= {k: v / GRAVITY for k, v in table.items() if "[g]" in k}
    table |= {k: np.rad2deg(v) for k, v in table.items() if "[deg" in k}
    stated = read(written(tmp_path / "stated.csv", table))
    assert_same(stated, read(written(tmp_path / "plain.csv", columns())))


def in_degrees(table):
    angles = [k for k in table if k in TILTS or k.startswith("gyro")]
    return table | {k: np.rad2deg(table[k]) for k in angles}


def test_degrees_are_converted_in_every_channel_of_angles(tmp_path):
    """Rates and attitude alike; of 0.1 the attitude stayed in degrees."""
    plain = read(written(tmp_path / "plain.csv", columns()))
    path = written(tmp_path / "degrees.csv", in_degrees(columns()))
    asked = read(path, degrees=True)
    assert_same(asked, plain)
    assert "Angles were converted from degrees, as asked." in asked.repairs
    with pytest.raises(DataError, match="look like degrees"):
        read(path)


def test_what_states_its_unit_is_not_converted_again(tmp_path):
    table = in_degrees(columns())
    table = {(f"{k} [deg]" if k in TILTS else k): v for k, v in table.items()}
    log = read(written(tmp_path / "half.csv", table), degrees=True)
    assert_same(log, read(written(tmp_path / "plain.csv", columns())))
    assert "The file states the unit of attitude, and this unit was used." in log.repairs


def test_an_attitude_in_degrees_is_noticed_beside_rates_in_radians(tmp_path):
    table = columns()
    table["roll"] = np.rad2deg(table["roll"])
    with pytest.raises(DataError, match=r"the attitude reaches .* looks like degrees"):
        read(written(tmp_path / "mixed.csv", table))


def test_unstated_g_is_recognised_by_gravity(tmp_path):
    table = columns()
    table |= {k: v / GRAVITY for k, v in table.items() if k.startswith("acc")}
    log = read(written(tmp_path / "g.csv", table))
    assert_same(log, read(written(tmp_path / "plain.csv", columns())), rtol=1e-9)
    assert "Accelerations were converted from g." in log.repairs


def test_a_quaternion_is_a_channel(tmp_path):
    table = columns()
    roll = table.pop("roll")
    del table["pitch"], table["yaw"]
    table |= {"qw": np.cos(roll / 2), "qx": np.sin(roll / 2), "qy": 0.0 * roll, "qz": 0.0 * roll}
    log = read(written(tmp_path / "quaternion.csv", table))
    np.testing.assert_array_equal(log["orientation"][:, 1], table["qx"])
    assert "attitude" not in log


def broken(change):
    table = columns()
    change(table)
    return table


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: [t.pop(k) for k in list(t) if k.startswith("gyro")], "no column for channel 'rates'"),
        (lambda t: t.pop("motor_2"), "channel 'command' are numbered 1, 3, 4"),
        (
            lambda t: t.update({k: 57.3 * v for k, v in t.items() if k.startswith("gyro")}),
            "look like degrees",
        ),
        (
            lambda t: t.update({k: 1000.0 * v for k, v in t.items() if k.startswith("acc")}),
            "accelerometer's length",
        ),
        (lambda t: t.update({"motor_3": 1000.0 * t["motor_3"]}), "command of back_left reaches"),
        (lambda t: t.update({"motor_1": 0.0 * t["motor_1"] + 11.1}), "always at its limit"),
        (lambda t: t["gyro.x"].__setitem__(slice(0, 300), np.nan), "rows have empty, NaN"),
        (lambda t: t.update({k: v[:20] for k, v in t.items()}), "usable rows"),
        (lambda t: t.update({"acc.x [furlong]": t.pop("acc.x")}), "unknown unit"),
    ],
)
def test_unusable_flights_are_refused(tmp_path, change, message):
    with pytest.raises(DataError, match=message):
        read(written(tmp_path / "bad.csv", broken(change)))


def test_a_few_bad_cells_are_dropped_and_told(tmp_path):
    table = broken(lambda t: t["acc.y"].__setitem__(slice(100, 103), np.nan))
    log = read(written(tmp_path / "gap.csv", table))
    assert len(log) == COUNT - 3
    assert any("3 rows with empty" in sentence for sentence in log.repairs)


def test_a_sensor_that_is_mostly_empty_goes(tmp_path):
    table = broken(lambda t: t["stateEstimate.x"].__setitem__(slice(0, 400), np.nan))
    log = read(written(tmp_path / "gap.csv", table))
    assert "position" not in log
    assert any("Channel position has empty cells in 67 %" in sentence for sentence in log.repairs)
    assert len(log) == COUNT
