"""Robot files: strict, exact, and clear about what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.errors import UsageError
from etude_arm import KIND, ArmSpec, Axis
from etude_arm.robot_file import parse_robot, read_robot, robot_to_toml

TEXT = """name = "arm"
command_unit = "N m"
rate = 100.0
[[axis]]
name = "elbow"
lower = -1.0
upper = 1.5
velocity = 2.0
acceleration = 4
command = 150.0
"""


def parse(text: str) -> ArmSpec:
    return parse_robot(text, where="arm.toml", folder=Path("."))


def test_reads_every_field() -> None:
    spec = parse(TEXT)
    assert spec == ArmSpec("arm", (Axis("elbow", -1.0, 1.5, 2.0, 4.0, 150.0),), "N m", 100.0)


LIMIT = st.floats(0.01, 50.0)


@given(
    st.lists(st.tuples(st.floats(-12, 0), LIMIT, LIMIT, LIMIT, LIMIT), min_size=1, max_size=7),
    st.text(max_size=9),
)
def test_round_trip_is_exact(rows: list[tuple[float, ...]], name: str) -> None:
    axes = tuple(Axis(f"j{i} \"'\\ é", lo, lo + span / 5, *rest) for i, (lo, span, *rest) in enumerate(rows))
    unique = tuple(
        Axis(f"{a.name}{i}", a.lower, a.upper, a.velocity, a.acceleration, a.command)
        for i, a in enumerate(axes)
    )
    spec = ArmSpec(name, unique, "pwm", 125.0, None, "arm4")
    assert parse(robot_to_toml(spec)) == spec


def test_large_limits_round_trip_with_the_owners_word() -> None:
    spec = ArmSpec("motor", (Axis("rotor", -60.0, 60.0, 300.0, 1000.0, 3.0),), "A", 1000.0)
    text = robot_to_toml(spec)
    assert "units_checked = true" in text
    assert parse(text) == spec


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("upper = 1.5", "uper = 1.5", ("unknown key 'uper'", "joint 'elbow'", "Valid keys", "upper")),
        ("rate", "rates", ("unknown key 'rates'", "Valid keys: kind, name, command_unit, rate")),
        ("velocity = 2.0\n", "", ("missing velocity", "joint 'elbow'")),
        ("rate = 100.0\n", "", ("missing rate", "arm.toml")),
        ("upper = 1.5", "upper = -2.0", ("lower limit -1 is not below upper limit -2", "elbow")),
        ("upper = 1.5", "upper = nan", ("finite", "'upper'", "elbow")),
        ("velocity = 2.0", "velocity = inf", ("finite", "'velocity'")),
        ("velocity = 2.0", "velocity = 0.0", ("above zero", "'velocity'", "elbow")),
        ("acceleration = 4", "acceleration = -4", ("above zero", "'acceleration'")),
        ("command = 150.0", "command = -1.0", ("above zero", "'command'")),
        ("command = 150.0", 'command = "150"', ("takes a number", "command", "elbow")),
        ("upper = 1.5", "upper = 90.0", ("looks like degrees", "elbow", "radians", "units_checked")),
        ("velocity = 2.0", "velocity = 120.0", ("looks like degrees/s", "elbow")),
        ("rate = 100.0", "rate = 0.0", ("rate", "positive")),
        ('"N m"', '"lbf"', ("unknown command_unit 'lbf'", "N m, N, A, V, pwm")),
        ("[[axis]]", "[axis]", ("array of tables", "[[axis]]")),
        ('"arm"', "arm", ("not valid TOML", "arm.toml")),
        ("rate = 100.0", 'rate = 100.0\nmodel_file = "no.urdf"', ("no.urdf does not exist", "relative")),
    ],
)
def test_refuses_with_a_reason(old: str, new: str, words: tuple[str, ...]) -> None:
    assert old in TEXT
    with pytest.raises(UsageError) as problem:
        parse(TEXT.replace(old, new, 1))
    for word in words:
        assert word in str(problem.value)


def test_refuses_two_joints_of_one_name() -> None:
    with pytest.raises(UsageError, match="joint 'elbow' is described 2 times"):
        parse(TEXT + TEXT[TEXT.index("[[axis]]") :])


def test_refuses_a_robot_without_joints() -> None:
    with pytest.raises(UsageError, match="at least one axis"):
        parse('name = "a"\ncommand_unit = "A"\nrate = 1.0\naxis = []\n')


def test_model_file_is_relative_to_the_robot_file(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    (tmp_path / "arm.toml").write_text(TEXT.replace("rate", 'model_file = "arm.urdf"\nrate', 1))
    spec = read_robot(tmp_path / "arm.toml")
    assert spec.model_file == (tmp_path / "arm.urdf").resolve()
    assert 'model_file = "arm.urdf"' in robot_to_toml(spec, folder=tmp_path)


def test_missing_and_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no robot file"):
        read_robot(tmp_path / "arm5.toml")
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    with pytest.raises(UsageError, match="cannot be read"):
        read_robot(tmp_path / "binary.toml")


@pytest.mark.parametrize("name", KIND.built_in())
def test_built_in_robots_load(name: str) -> None:
    assert KIND.spec(KIND.built_in()[name]).name == name
