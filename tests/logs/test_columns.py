"""Columns are matched to joints by name, in any order and spelling, or refused by name."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_examples import SPEC

from etude.errors import DataError
from etude.logs.columns import match_columns

JOINTS = SPEC.names


def names_of(headers: list[str], channel: str) -> list[str]:
    return [column.name for column in match_columns(headers, SPEC, "log.csv").channels[channel]]


@pytest.mark.parametrize(
    "pattern",
    [
        "{c}_{j}",
        "{j}.{c}",
        "{c}.{j}",
        "{c}/{j}",
        "/joint_states/{j}/{c}",
        "joint_states.{c}.{j}",
        "{c} {j} [rad]",
    ],
)
@pytest.mark.parametrize("word", ["q", "position", "Position", "pos", "actual_q"])
@pytest.mark.parametrize("short", [False, True])
def test_spellings_of_a_position(pattern: str, word: str, short: bool) -> None:
    names = [name.removesuffix("_joint") if short else name for name in JOINTS]
    headers = [pattern.format(c=word, j=name) for name in reversed(names)]
    assert names_of([*headers, *(f"tau_{j}" for j in JOINTS)], "q") == headers[::-1]


@pytest.mark.parametrize(
    ("unit", "word"),
    [
        ("N m", "effort"),
        ("N m", "torque"),
        ("A", "current"),
        ("pwm", "pwm"),
        ("V", "voltage"),
        ("A", "effort"),
    ],
)
def test_the_command_is_the_column_of_the_robots_unit(unit: str, word: str) -> None:
    spec = replace(SPEC, command_unit=unit)
    headers = [f"q_{j}" for j in JOINTS] + [f"{j}.{word}" for j in JOINTS]
    assert [c.name for c in match_columns(headers, spec, "f").channels["tau"]] == headers[3:]


def test_desired_is_not_measured() -> None:
    headers = [f"{c}_{j}" for c in ("desired_position", "position", "effort") for j in JOINTS]
    assert names_of(headers, "q_des") == headers[:3]
    assert names_of(headers, "q") == headers[3:6]


@given(st.permutations([f"{c}.{j}" for c in ("position", "velocity", "effort") for j in JOINTS]))
def test_any_order(headers: list[str]) -> None:
    assert names_of(headers, "q") == [f"position.{j}" for j in JOINTS]
    assert names_of(headers, "tau") == [f"effort.{j}" for j in JOINTS]
    assert names_of(headers, "qd") == [f"velocity.{j}" for j in JOINTS]


@pytest.mark.parametrize("pattern", ["q{}", "q_{}", "position[{}]", "actual_q_{}", "q_j{}", "joint_{}_pos"])
@pytest.mark.parametrize("first", [0, 1])
def test_numbers_stand_for_the_axis_order_and_are_reported(pattern: str, first: int) -> None:
    headers = [pattern.format(first + i) for i in (2, 0, 1)] + [f"tau_{j}" for j in JOINTS]
    matching = match_columns(headers, SPEC, "log.csv")
    assert [c.name for c in matching.channels["q"]] == [pattern.format(first + i) for i in range(3)]
    assert any("taken for the joints pan_joint, lift_joint, elbow_joint" in s for s in matching.repairs)


def test_numbers_in_the_joints_names_win_over_their_order() -> None:
    axes = tuple(replace(axis, name=f"joint_{n}") for axis, n in zip(SPEC.axes, (3, 1, 2), strict=True))
    headers = [f"{c}_{n}" for c in ("q", "tau") for n in (1, 2, 3)]
    matching = match_columns(headers, replace(SPEC, axes=axes), "f")
    assert [c.name for c in matching.channels["q"]] == ["q_3", "q_1", "q_2"]


def test_units_in_headers_become_factors() -> None:
    headers = [f"q_{j} [deg]" for j in JOINTS] + [f"tau_{j} (Nm)" for j in JOINTS]
    matching = match_columns(headers, SPEC, "f")
    assert [c.factor for c in matching.channels["q"]] == pytest.approx([0.017453292519943295] * 3)
    with pytest.raises(DataError, match=r"unknown unit 'furlong'.*column 'q_pan_joint \[furlong\]'"):
        match_columns([f"q_{j} [furlong]" for j in JOINTS], SPEC, "f")


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        (
            ["q_pan", "q_lift", "tau_pan", "tau_lift", "tau_elbow"],
            ("'q' of joint elbow_joint", "pan_joint, lift"),
        ),
        (["q_pan", "q_lift", "q_elbwo", "tau_pan"], ("joint elbow_joint", "Did you mean q_elbwo", "Rename")),
        (["q_pan", "q_lift", "q_elbow"], ("channel 'tau'", "pan_joint, lift_joint, elbow_joint")),
        (["q_pan", "position_pan", "q_lift", "q_elbow"], ("q_pan and position_pan mean the same", "Remove")),
        (["q0", "q1", "q2", "q3", "tau0", "tau1", "tau2"], ("numbered 0, 1, 2, 3", "3 joints pan_joint")),
        (["q2", "q3", "q4"], ("numbered 2, 3, 4", "q_pan_joint")),
        (["q0", "q_lift", "q_elbow"], ("no column for channel 'q' of joint pan_joint",)),
        ([], ("no column for channel 'q'", "q_pan_joint")),
    ],
)
def test_wrong_joints_are_named(headers: list[str], words: tuple[str, ...]) -> None:
    with pytest.raises(DataError) as problem:
        match_columns(headers, SPEC, "log.csv")
    assert problem.value.exit_code == 3
    for word in (*words, "log.csv"):
        assert word in str(problem.value)


def test_extra_columns_are_ignored_and_listed() -> None:
    headers = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS] + ["battery", "q_gripper"]
    matching = match_columns(headers, SPEC, "f")
    assert matching.ignored == ("battery", "q_gripper")
    assert any("battery, q_gripper" in sentence for sentence in matching.repairs)
