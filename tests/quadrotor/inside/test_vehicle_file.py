"""The file of a vehicle: reads back as written, and refuses what cannot be."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from etude.errors import UsageError
from etude_quadrotor import KIND
from etude_quadrotor.plant.simulated_vehicle import PLANTS, simulated_vehicle
from etude_quadrotor.spec_file import spec_from_table, spec_to_toml


def spec_of(name):
    return KIND.spec(KIND.built_in()[name])


@pytest.fixture
def table():
    flight = spec_of("quadrotor")
    return msgspec.toml.decode(spec_to_toml(flight))


@pytest.mark.parametrize("name", ["quadrotor", "quadrotor_rough", "pelican"])
def test_written_text_reads_back(name, tmp_path):
    spec = spec_of(name)
    for file, content in KIND.described(KIND.built_in()[name]).files.items():
        (tmp_path / file).write_bytes(content)
    assert KIND.recognises(tmp_path / "robot.toml")
    assert KIND.spec(tmp_path / "robot.toml") == spec
    assert KIND.limit(spec).tolist() == (0.5 * np.subtract(spec.command_upper, spec.command_lower)).tolist()


def test_a_vehicle_of_another_kind_or_none_is_refused(table, tmp_path):
    assert spec_from_table(table | {"kind": "vehicle"}, where="") == spec_from_table(table, where="")
    with pytest.raises(UsageError, match="is no quadrotor"):
        spec_from_table(table | {"kind": "zeppelin"}, where="robot.toml")
    for text in ('name = "arm"\n', "[[", 'kind = "zeppelin"\n'):
        (tmp_path / "robot.toml").write_text(text)
        assert not KIND.recognises(tmp_path / "robot.toml")
    with pytest.raises(UsageError, match="there is no robot file"):
        KIND.spec(tmp_path / "none.toml")


def test_optional_limits_read_back():
    flight = replace(
        spec_of("quadrotor"),
        radius=1.5,
        tilt=0.4,
        thrust=(4.0, 16.0),
        vehicle=None,
        vertical_margin=0.2,
    )
    assert spec_from_table(msgspec.toml.decode(spec_to_toml(flight)), where="") == flight


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeed": 1.0}, "speeed"),
        ({"speed": -1.0}, "speed must be a number above zero"),
        ({"speed": float("nan")}, "speed must be a number above zero"),
        ({"lower": [0.0, 0.0, 6.0]}, "z of the box"),
        ({"margin": 10.0}, "less than two margins of 10 m"),
        ({"margin": float("nan")}, "a margin must be 0 or more"),
        ({"margin": 2.0, "radius": 1.5}, "fills the cylinder"),
        ({"vertical_margin": 2.6}, "z, less than two margins of 2.6 m"),
        ({"vertical_margin": -0.1}, "a margin must be 0 or more"),
        ({"tilt": 30.0}, "looks like degrees"),
        ({"upper": [10000.0, 10.0, 5.0]}, "looks like millimetres"),
        ({"command_upper": [11100.0] * 4}, "looks like millivolts"),
        ({"thrust": [10.0, 20.0]}, "cannot hover"),
        ({"command_unit": "kV"}, "unknown command_unit"),
        ({"commands": ["a", "a", "b", "c"]}, "4 different names"),
        ({"commands": ["a", "b", "c"]}, "has 4 motors or more, this vehicle has 3"),
        ({"commands": ["a", "b", "c", "d", "e"]}, "command_lower has 4 limits for 5 commands"),
        ({"rotors": [[0.1, 0.1, 1.0]]}, "1 rotors for 4 commands"),
        ({"rotors": [[0.1, y, s] for y, s in ((1, 2), (-1, 1), (2, -1), (-2, 1))]}, "1 or -1"),
        ({"rotors": [[0.0, y, s] for y, s in ((1, 1), (-1, 1), (2, -1), (-2, -1))]}, "any pitch moment"),
        ({"rotors": [[x, y, 1] for x in (1, -1) for y in (1, -1)]}, "thrust and yaw moment apart"),
        ({"rotors": [[x, y, x * y / 1e4] for x in (100, -100) for y in (100, -100)]}, "rotor 141.421 from"),
    ],
)
def test_what_cannot_be_is_refused(table, change, message):
    with pytest.raises(UsageError, match=message):
        spec_from_table(table | change, where="robot.toml")


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
        spec_from_table(table | {"vehicle": table["vehicle"] | change}, where="robot.toml")


def test_the_owner_can_vouch_for_units(table):
    checked = table | {"upper": [10000.0, 10.0, 5.0], "units_checked": True}
    flight = spec_from_table(checked, where="")
    assert flight.upper[0] == 10000.0
    assert spec_from_table(msgspec.toml.decode(spec_to_toml(flight)), where="") == flight


@pytest.mark.parametrize("count", [6, 8])
def test_a_vehicle_of_more_motors_reads_back(table, count):
    angles = 2.0 * np.pi * np.arange(count) / count
    rotors = [[0.2 * float(np.cos(a)), 0.2 * float(np.sin(a)), (-1.0) ** i] for i, a in enumerate(angles)]
    own = {"commands": [f"m{i}" for i in range(count)], "command_lower": [0.0] * count}
    own |= {"command_upper": [11.1] * count, "rotors": rotors}
    del table["plant"]
    flight = spec_from_table(table | own, where="")
    assert spec_from_table(msgspec.toml.decode(spec_to_toml(flight)), where="") == flight
    assert KIND.limit(flight).shape == (count,)
    turned = spec_from_table(table | own | {"rotors": rotors[::-1]}, where="")
    assert KIND.body(turned) != KIND.body(flight)
    loads = flight.body.allocation() @ flight.body.mixer()
    np.testing.assert_allclose(loads, np.eye(4), atol=1e-12)
    with pytest.raises(UsageError, match="simulated vehicles have 4 motors"):
        spec_from_table(table | own | {"plant": "quadrotor"}, where="")
    with pytest.raises(UsageError, match=f"positions of its {count} rotors"):
        spec_from_table(table | own | {"rotors": []}, where="")


@pytest.mark.parametrize("name", PLANTS)
def test_the_owner_knows_what_the_plant_is_commanded_by(name):
    """The shipped description and the simulated vehicle agree in what both state."""
    told, built = spec_of(name), simulated_vehicle(name)
    assert told.vehicle == built.vehicle
    for field in ("names", "unit", "lower", "upper"):
        assert getattr(told, f"command_{field}") == getattr(built.commands, field), field
