"""The file of a vehicle: reads back as written, and refuses what cannot be."""

from dataclasses import replace

import msgspec
import pytest
from etude.robots.toml_file import load_robot, parse_robot, robot_to_toml

from etude.errors import UsageError
from etude.plants.flight.registry import FLIGHT_PLANTS, flight_plant
from etude.robots.flight_file import flight_from_table, flight_to_toml


@pytest.fixture
def table():
    flight = load_robot("quadrotor").flight
    return msgspec.toml.decode(flight_to_toml(flight))


@pytest.mark.parametrize("name", ["quadrotor", "quadrotor_rough", "pelican"])
def test_written_text_reads_back(name, tmp_path):
    spec = load_robot(name)
    assert parse_robot(robot_to_toml(spec), where="", folder=tmp_path) == spec
    assert spec.names == ("x", "y", "z")
    assert spec.outputs == spec.flight.command_names


def test_optional_limits_read_back():
    flight = replace(
        load_robot("quadrotor").flight,
        radius=1.5,
        tilt=0.4,
        thrust=(4.0, 16.0),
        vehicle=None,
        vertical_margin=0.2,
    )
    assert flight_from_table(msgspec.toml.decode(flight_to_toml(flight)), where="") == flight


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeed": 1.0}, "speeed"),
        ({"speed": -1.0}, "speed must be a number above zero"),
        ({"speed": float("nan")}, "speed must be a number above zero"),
        ({"lower": [0.0, 0.0, 6.0]}, "z of the box"),
        ({"margin": 10.0}, "which two margins of 10 m fill"),
        ({"margin": float("nan")}, "a margin must be 0 or more"),
        ({"margin": 2.0, "radius": 1.5}, "fills the cylinder"),
        ({"vertical_margin": 2.6}, "z, which two margins of 2.6 m fill"),
        ({"vertical_margin": -0.1}, "a margin must be 0 or more"),
        ({"tilt": 30.0}, "looks like degrees"),
        ({"upper": [10000.0, 10.0, 5.0]}, "looks like millimetres"),
        ({"command_upper": [11100.0] * 4}, "looks like millivolts"),
        ({"thrust": [10.0, 20.0]}, "cannot hover"),
        ({"command_unit": "kV"}, "unknown command_unit"),
        ({"commands": ["a", "a", "b", "c"]}, "four different names"),
        ({"commands": ["a", "b", "c"]}, "describes no vehicle"),
    ],
)
def test_what_cannot_be_is_refused(table, change, message):
    with pytest.raises(UsageError, match=message):
        flight_from_table(table | change, where="robot.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 436.0}, "would hover at"),
        ({"mass": 30.0, "thrust_constant": 1e-2}, "looks like grams"),
        ({"arm": 178.0}, "looks like millimetres"),
        ({"mas": 1.0}, "unknown key 'mas'"),
        ({"resistance": 0.0}, "resistance must be a number above zero"),
        ({"inertia": [1e-3, 1e-3, -1e-3]}, "inertia z"),
    ],
)
def test_an_impossible_body_is_refused(table, change, message):
    with pytest.raises(UsageError, match=message):
        flight_from_table(table | {"vehicle": table["vehicle"] | change}, where="robot.toml")


def test_the_owner_can_vouch_for_units(table):
    checked = table | {"upper": [10000.0, 10.0, 5.0], "units_checked": True}
    flight = flight_from_table(checked, where="")
    assert flight.upper[0] == 10000.0
    assert flight_from_table(msgspec.toml.decode(flight_to_toml(flight)), where="") == flight


@pytest.mark.parametrize("name", list(FLIGHT_PLANTS))
def test_the_owner_knows_what_the_plant_is_commanded_by(name):
    """The shipped description and the simulated vehicle agree in what both state; the room is the owner's."""
    told, built = load_robot(name).flight, flight_plant(name).spec
    for field in ("command_names", "command_unit", "command_lower", "command_upper", "rate", "vehicle"):
        assert getattr(told, field) == getattr(built, field), field
