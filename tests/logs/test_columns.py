"""Columns are matched to joints by name, in any order and spelling, or refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_examples import CHANNELS, FLIGHT_CHANNELS, JOINTS, joint_channels

from etude.errors import DataError
from etude.logs import match_columns
from etude.types import Channel


def names_of(headers: list[str], channel: str) -> list[str]:
    return [column.name for column in match_columns(headers, CHANNELS, "log.csv").channels[channel]]


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
    headers = [f"q_{j}" for j in JOINTS] + [f"{j}.{word}" for j in JOINTS]
    assert [
        c.name for c in match_columns(headers, joint_channels(unit=unit), "f").channels["command"]
    ] == headers[3:]


@pytest.mark.parametrize(
    ("unit", "pair", "taken"),
    [
        ("1", ("u{}[N]", "u{}[PWM]"), 1),
        ("pwm", ("u{}[PWM]", "u{}[N]"), 0),
        ("V", ("u{}[N]", "u{}[mV]"), 1),
        ("N m", ("tau_{} [Nm]", "u{}"), 0),
    ],
)
def test_of_two_columns_of_a_command_the_one_in_its_unit_is_taken(
    unit: str, pair: tuple[str, str], taken: int
) -> None:
    headers = [f"q_{j}" for j in JOINTS] + [h.format(k) for k in (1, 2, 3) for h in pair]
    found = match_columns(headers, joint_channels(unit=unit), "f")
    assert [c.name for c in found.channels["command"]] == [pair[taken].format(k) for k in (1, 2, 3)]


@pytest.mark.parametrize("pair", [("u{}", "cmd{}"), ("u{} [A]", "cmd{} [mA]")])
def test_of_two_columns_of_a_command_in_the_same_unit_none_is_taken(pair: tuple[str, str]) -> None:
    headers = [f"q_{j}" for j in JOINTS] + [h.format(k) for k in (1, 2, 3) for h in pair]
    with pytest.raises(DataError, match="mean the same thing") as problem:
        match_columns(headers, joint_channels(unit="A"), "f")
    assert "ignored" in problem.value.next_step


def test_desired_is_not_measured() -> None:
    headers = [f"{c}_{j}" for c in ("desired_position", "position", "effort") for j in JOINTS]
    assert names_of(headers, "q_des") == headers[:3]
    assert names_of(headers, "q") == headers[3:6]


@pytest.mark.parametrize("word", ["desired", "des", "ref", "reference", "target", "setpoint", "goal"])
@pytest.mark.parametrize("pattern", ["{j}.{d}", "{d}.{j}", "{j}_{d}", "/joint_states/{j}/{d}"])
def test_what_is_only_desired_is_the_planned_position(word: str, pattern: str) -> None:
    """Beside the measured position, which it is not, and never in its place."""
    plain = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS]
    headers = [pattern.format(j=j.removesuffix("_joint"), d=word) for j in JOINTS]
    matching = match_columns([*headers, *plain], CHANNELS, "f")
    assert [c.name for c in matching.channels["q_des"]] == headers
    assert [c.name for c in matching.channels["q"]] == plain[:3]
    assert matching.ignored == ()
    with pytest.raises(DataError, match="no column for channel 'q'"):
        match_columns([*headers, *plain[3:]], CHANNELS, "f")


@pytest.mark.parametrize(
    ("pattern", "channel"),
    [
        ("q_des_{j}", "q_des"),
        ("{j}_pos_ref", "q_des"),
        ("desired/{j}/position", "q_des"),
        ("q{n}_des", "q_des"),
        ("q_{n}_ref", "q_des"),
        ("joint{n}_desired", "q_des"),
        ("{j}_ref [deg]", "q_des"),
        ("{j}_desired_deg", "q_des"),
        ("{j}_vel_des", "qd_des"),
        ("reference.{j}.velocity", "qd_des"),
        ("qd{n}_ref", "qd_des"),
        ("{j}_acc_target", "qdd_des"),
    ],
)
def test_desired_values_of_each_quantity(pattern: str, channel: str) -> None:
    plain = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS]
    headers = [pattern.format(j=j, n=n) for n, j in enumerate(JOINTS, 1)]
    matching = match_columns([*plain, *headers], CHANNELS, "f")
    assert [c.name for c in matching.channels[channel]] == headers
    assert matching.ignored == ()
    assert matching.channels[channel][0].factor == pytest.approx(np.pi / 180 if "deg" in pattern[-5:] else 1)


def test_a_desired_torque_is_no_desired_position() -> None:
    plain = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS]
    headers = [f"{j}_ref [Nm]" for j in JOINTS]
    matching = match_columns([*plain, *headers], CHANNELS, "f")
    assert "q_des" not in matching.channels
    assert matching.ignored == tuple(headers)


def test_of_two_plans_the_first_whole_spelling_is_taken() -> None:
    plain = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS]
    other, own = ([text.format(j) for j in JOINTS] for text in ("{}.desired", "q_des_{}"))
    matching = match_columns([*plain, *other, *own], CHANNELS, "f")
    assert [c.name for c in matching.channels["q_des"]] == own
    assert matching.ignored == tuple(other)


def test_set_points_of_a_flight() -> None:
    headers = [
        *(f"acc_{a}" for a in "xyz"),
        *(f"gyro_{a}" for a in "xyz"),
        *(f"motor_{n}" for n in range(1, 5)),
    ]
    told = match_columns([*headers, *(f"{a}_ref" for a in "xyz")], FLIGHT_CHANNELS, "f")
    assert [c.name for c in told.channels["position_des"]] == ["x_ref", "y_ref", "z_ref"]
    assert "position" not in told.channels


@settings(max_examples=25)
@given(st.permutations([f"{c}.{j}" for c in ("position", "velocity", "effort") for j in JOINTS]))
def test_any_order(headers: list[str]) -> None:
    assert names_of(headers, "q") == [f"position.{j}" for j in JOINTS]
    assert names_of(headers, "command") == [f"effort.{j}" for j in JOINTS]
    assert names_of(headers, "qd") == [f"velocity.{j}" for j in JOINTS]


@pytest.mark.parametrize("pattern", ["q{}", "q_{}", "position[{}]", "actual_q_{}", "q_j{}", "joint_{}_pos"])
@pytest.mark.parametrize("first", [0, 1])
def test_numbers_stand_for_the_axis_order_and_are_reported(pattern: str, first: int) -> None:
    headers = [pattern.format(first + i) for i in (2, 0, 1)] + [f"tau_{j}" for j in JOINTS]
    matching = match_columns(headers, CHANNELS, "log.csv")
    assert [c.name for c in matching.channels["q"]] == [pattern.format(first + i) for i in range(3)]
    assert any("read as pan_joint, lift_joint, elbow_joint" in s for s in matching.repairs)


def test_numbers_in_the_joints_names_win_over_their_order() -> None:
    channels = joint_channels(tuple(f"joint_{n}" for n in (3, 1, 2)))
    headers = [f"{c}_{n}" for c in ("q", "tau") for n in (1, 2, 3)]
    matching = match_columns(headers, channels, "f")
    assert [c.name for c in matching.channels["q"]] == ["q_3", "q_1", "q_2"]


def test_units_in_headers_become_factors() -> None:
    headers = [f"q_{j} [deg]" for j in JOINTS] + [f"tau_{j} (Nm)" for j in JOINTS]
    matching = match_columns(headers, CHANNELS, "f")
    assert [c.factor for c in matching.channels["q"]] == pytest.approx([0.017453292519943295] * 3)
    with pytest.raises(DataError, match=r"unknown unit 'furlong'.*column 'q_pan_joint \[furlong\]'"):
        match_columns([f"q_{j} [furlong]" for j in JOINTS], CHANNELS, "f")


@pytest.mark.parametrize(
    ("position", "velocity", "command", "factors"),
    [
        ("q_{}_deg", "qd_{}_deg_s", "tau_{}_nm", (np.pi / 180, np.pi / 180, 1.0)),
        ("{} Position rad", "{} Velocity rad/s", "{} Torque mNm", (1.0, 1.0, 1e-3)),
        ("q_{}_mrad", "qd_{}_dps", "effort_{}_Nm", (1e-3, np.pi / 180, 1.0)),
    ],
)
def test_units_at_the_end_of_headers_become_factors(
    position: str, velocity: str, command: str, factors: tuple[float, ...]
) -> None:
    headers = [text.format(joint) for text in (position, velocity, command) for joint in JOINTS]
    matching = match_columns(headers, CHANNELS, "f")
    found = [matching.channels[name] for name in ("q", "qd", "command")]
    assert [[c.factor for c in own] for own in found] == [pytest.approx([f] * 3) for f in factors]
    assert all(column.stated for own in found for column in own)
    assert matching.ignored == ()


def test_a_unit_at_the_end_counts_where_nothing_else_says_it() -> None:
    """Beside plain columns, of too few joints, or twice: what was read before is read as before."""
    plain = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS]
    degrees = [f"q_{j}_deg" for j in JOINTS]
    assert [c.name for c in match_columns([*degrees, *plain], CHANNELS, "f").channels["q"]] == plain[:3]
    matching = match_columns([*plain, "qd_pan_joint_rad_s"], CHANNELS, "f")
    assert "qd" not in matching.channels
    assert matching.ignored == ("qd_pan_joint_rad_s",)
    both = match_columns([*degrees, *(f"q_{j}_rad" for j in JOINTS), *plain[3:]], CHANNELS, "f")
    assert [c.factor for c in both.channels["q"]] == [1.0] * 3


@pytest.mark.parametrize("unit", ["ma", "mv", "deg"])
def test_a_unit_at_the_end_of_another_dimension_says_nothing(unit: str) -> None:
    """Milliamperes are no torque: such columns are refused as missing, not scaled."""
    with pytest.raises(DataError, match="command"):
        match_columns([*(f"q_{j}" for j in JOINTS), *(f"effort_{j}_{unit}" for j in JOINTS)], CHANNELS, "f")


def test_numbered_columns_are_not_displaced_by_ones_with_a_unit_at_the_end() -> None:
    numbered = [f"{c}{n}" for c in ("q", "tau") for n in (1, 2, 3)]
    found = match_columns([*numbered, *(f"q_{j}_deg" for j in JOINTS)], CHANNELS, "f")
    assert [c.name for c in found.channels["q"]] == numbered[:3]


def test_a_joint_whose_name_ends_like_a_unit_keeps_it() -> None:
    channels = joint_channels(("lift_mm", "turn_deg", "tilt_rad"))
    headers = [f"{c}_{j}" for c in ("q", "tau") for j in ("lift_mm", "turn_deg", "tilt_rad")]
    assert [c.factor for c in match_columns(headers, channels, "f").channels["q"]] == [1.0] * 3


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        (
            ["q_pan", "q_lift", "tau_pan", "tau_lift", "tau_elbow"],
            ("'q' of elbow_joint", "pan_joint, lift"),
        ),
        (
            ["q_pan", "q_lift", "q_elbwo", "tau_pan"],
            ("of elbow_joint", "Perhaps q_elbwo means q_elbow_joint.", "Rename"),
        ),
        (["q_pan", "q_lift", "q_elbow"], ("channel 'command'", "pan_joint, lift_joint, elbow_joint")),
        (["q_pan", "position_pan", "q_lift", "q_elbow"], ("q_pan and position_pan mean the same", "Remove")),
        (["q0", "q1", "q2", "q3", "tau0", "tau1", "tau2"], ("numbered 0, 1, 2, 3", "3 parts pan_joint")),
        (["q2", "q3", "q4"], ("numbered 2, 3, 4", "q_pan_joint")),
        (["q0", "q_lift", "q_elbow"], ("no column for channel 'q' of pan_joint",)),
        ([], ("no column for channel 'q'", "q_pan_joint")),
    ],
)
def test_wrong_joints_are_named(headers: list[str], words: tuple[str, ...]) -> None:
    with pytest.raises(DataError) as problem:
        match_columns(headers, CHANNELS, "log.csv")
    assert problem.value.exit_code == 3
    for word in (*words, "log.csv"):
        assert word in str(problem.value)


def test_extra_columns_are_ignored_and_listed() -> None:
    headers = [f"{c}_{j}" for c in ("q", "tau") for j in JOINTS] + ["battery", "q_gripper"]
    matching = match_columns(headers, CHANNELS, "f")
    assert matching.ignored == ("battery", "q_gripper")
    assert any("battery, q_gripper" in sentence for sentence in matching.repairs)


def flight_headers(*extra: str) -> list[str]:
    sensors = [f"{word}_{axis}" for word in ("acc", "gyro") for axis in "xyz"]
    return [*sensors, *(f"motor_{i}" for i in range(1, 5)), *extra]


@pytest.mark.parametrize(
    ("headers", "channel"),
    [
        (["gyro.x", "gyro.y", "gyro.z"], "rates"),
        (["wx [deg/s]", "wy [deg/s]", "wz [deg/s]"], "rates"),
        (["omega_0", "omega_1", "omega_2"], "rates"),
        (["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"], "rates"),
        (["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"], "position"),
        (["px", "py", "pz"], "position"),
        (["vx", "vy", "vz"], "velocity"),
        (["stateEstimate.vx", "stateEstimate.vy", "stateEstimate.vz"], "velocity"),
        (["qw", "qx", "qy", "qz"], "orientation"),
        (["quat_w", "quat_x", "quat_y", "quat_z"], "orientation"),
        (["roll", "pitch", "yaw"], "attitude"),
        (["stabilizer.roll", "stabilizer.pitch", "stabilizer.yaw"], "attitude"),
        (["setpoint_x", "setpoint_y", "setpoint_z"], "position_des"),
        (["front_right", "back_right", "back_left", "front_left"], "command"),
        (["pwm_front_right", "pwm_back_right", "pwm_back_left", "pwm_front_left"], "command"),
        (["m1", "m2", "m3", "m4"], "command"),
        (["motor.m1", "motor.m2", "motor.m3", "motor.m4"], "command"),
        (["altitude"], "altitude"),
    ],
)
def test_spellings_of_a_flight(headers: list[str], channel: str) -> None:
    other = [
        h
        for h in flight_headers()
        if channel not in ("command", "rates")
        or not h.startswith({"command": "motor", "rates": "gyro"}[channel])
    ]
    matching = match_columns([*reversed(headers), *other], FLIGHT_CHANNELS, "f")
    assert [c.name for c in matching.channels[channel]] == headers
    assert set(matching.channels) == {"command", "specific_force", "rates", channel}


def test_of_several_sensors_the_first_spelling_is_taken() -> None:
    more = [*(f"imu_acc_{a}" for a in "xyz"), *(f"accel_{a}" for a in "xy")]
    matching = match_columns(flight_headers(*more), FLIGHT_CHANNELS, "f")
    assert [c.name for c in matching.channels["specific_force"]] == ["acc_x", "acc_y", "acc_z"]
    assert matching.ignored == tuple(more)


def test_a_channel_that_no_log_needs_may_be_there_in_part() -> None:
    matching = match_columns(flight_headers("stateEstimate.z", "roll"), FLIGHT_CHANNELS, "f")
    assert "position" not in matching.channels
    assert any("position lacks x, y" in sentence for sentence in matching.repairs)


def test_bare_names_of_commands_are_not_taken_for_the_attitude() -> None:
    """Vehicles commanded by roll, pitch, yaw rate and thrust, whose attitude has the same names."""
    command = replace(FLIGHT_CHANNELS[0], parts=("roll", "pitch", "yaw_rate", "thrust"), units=("1",) * 4)
    channels = (command, *FLIGHT_CHANNELS[1:])
    sensors, attitude = flight_headers()[:6], ["roll", "pitch", "yaw"]
    both = [*sensors, *attitude, *(f"command_{part}" for part in command.parts)]
    found = match_columns(both, channels, "f").channels
    assert [c.name for c in found["attitude"]] == attitude
    assert [c.name for c in found["command"]] == both[-4:]
    alone = match_columns([*sensors, *command.parts], channels, "f").channels
    assert [c.name for c in alone["command"]] == list(command.parts)
    assert "attitude" not in alone
    with pytest.raises(DataError, match="may belong to the channel command or attitude"):
        match_columns([*sensors, *command.parts, "yaw"], channels, "f")


def test_commands_in_another_unit_name_the_setting() -> None:
    """As a UR's RTDE client records currents of a robot that is described in N m."""
    joints = [Channel("q", JOINTS, ("rad",) * 3, required=True)]
    command = Channel("command", JOINTS, ("N m",) * 3, "command", required=True, acts_on="q")
    headers = [f"{word}_{k}" for word in ("actual_q", "actual_current") for k in range(3)]
    with pytest.raises(DataError, match="no column") as refused:
        match_columns(headers, [*joints, command], "run.csv")
    assert 'actual_current_0 and similar units are read if the robot file states command_unit = "A"' in str(
        refused.value
    )
    others = [f"{word}_{k}" for word in ("actual_q", "colour") for k in range(3)]
    with pytest.raises(DataError) as other:
        match_columns(others, [*joints, command], "run.csv")
    assert "command_unit" not in str(other.value)


def test_torques_as_libfranka_names_them() -> None:
    command = Channel("command", JOINTS, ("N m",) * 3, "command", required=True, acts_on="q")
    found = match_columns([f"tau_J[{k}]" for k in range(3)], [command], "run.csv")
    assert [column.name for column in found.channels["command"]] == ["tau_J[0]", "tau_J[1]", "tau_J[2]"]
