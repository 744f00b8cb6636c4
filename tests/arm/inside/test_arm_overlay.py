"""[simulate] and [[motor]]: what is said counts, what is not is chosen by the rule that is stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rehearsal_examples import ABOUT, ARM, GRAVITY, LEVER, TABLE, made, motor, spec_of

from etude.errors import UsageError
from etude.types import Array
from etude_arm.rehearsal.rehearsed_robot import RehearsedRobot
from etude_arm.robot_file import parse_robot, robot_to_toml


def of_turn(robot: RehearsedRobot) -> dict[str, float]:
    motors = robot.parameters.motors
    return {name: float(getattr(motors, name)[0]) for name in motors.__dataclass_fields__}


def test_defaults_of_one_heavy_joint_by_hand(tmp_path: Path) -> None:
    """M = 0.29 at every pose, no gravity; tau = 60, V = 2, A = 4."""
    got = of_turn(made(tmp_path, TABLE))
    armature = min(max(0.15 * ABOUT, 60 / 500), max(60 / (3 * 4), 0.15 * ABOUT))
    load = 1.8 + 0.5 * 0.9 * 2 + (0.3 * armature + 0.5 * ABOUT) * 4
    kp = max(load / np.deg2rad(1.5), 100 * (ABOUT + armature))
    stiffness = 1.8 / 0.002
    expected = {
        "armature": armature,
        "coulomb": 1.8,
        "static": 2.34,
        "viscous": 0.9,
        "stribeck": 0.02,
        "stiffness": stiffness,
        "micro_damping": 0.6 * np.sqrt(stiffness * (ABOUT + armature)),
        "torque": 60.0,
        "gain": 1.0,
        "braking": 0.0,
        "kp": kp,
        "kd": 1.8 * np.sqrt(kp * (ABOUT + armature)),
        "tick": 2 * np.pi / 2**20,
    }
    assert got == pytest.approx(expected)


def test_gains_carry_the_heaviest_pose(tmp_path: Path) -> None:
    robot = made(tmp_path, LEVER)
    worst = 3.0 * GRAVITY * 0.3  # at q = 0, which random poses in [-2, 2] come near
    assert (
        0.9 * worst
        < robot.parameters.motors.kp[0] * np.deg2rad(1.5) - (1.8 + 0.9 + 1.2 * ABOUT * 2)
        < 1.2 * worst
    )


@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0])
def test_outside_the_drives_gains_bow_to_the_rate(tmp_path: Path, rate: float) -> None:
    robot = made(tmp_path, ARM, loop="outside", rate=rate, delay=0.004)
    motors = robot.parameters.motors
    assert (motors.kp <= 0.2 * rate * motors.kd * (1 + 1e-12)).all()
    # the telescope feels the others move with it: never more than its own mass
    assert motors.kd[2] <= 0.8 * (1.0 + motors.armature[2]) * rate
    free = made(tmp_path, ARM).parameters.motors
    heaviest = (free.kd / 1.8) ** 2 / free.kp
    assert np.sqrt(motors.kp / heaviest).max() <= 0.35 / (1.5 / rate + 0.004) * (1 + 1e-9)


def test_what_the_owner_says_counts_on_the_motors_side_of_the_gear(tmp_path: Path) -> None:
    table = motor("turn", gear=50.0, armature=1e-4, coulomb=0.02, viscous=1e-4, kp=0.3, kd=0.02, stribeck=2.0)
    got = of_turn(made(tmp_path, TABLE, motors=(table,)))
    said = {"armature": 0.25, "coulomb": 1.0, "viscous": 0.25, "kp": 750.0, "kd": 50.0, "stribeck": 0.04}
    assert {name: got[name] for name in said} == pytest.approx(said)
    assert got["tick"] == pytest.approx(2 * np.pi / 2**20 / 50)
    assert got["static"] == pytest.approx(1.3)


def test_currents_and_pwm_are_parts_of_the_files_effort(tmp_path: Path) -> None:
    current = of_turn(made(tmp_path, TABLE, unit="A", command=12.0))
    assert (current["torque"], current["gain"], current["braking"]) == pytest.approx((60.0, 5.0, 0.0))
    pwm = of_turn(made(tmp_path, TABLE, unit="pwm", command=255.0))
    assert (pwm["gain"], pwm["braking"]) == pytest.approx((60.0 / 255.0, 60.0 / 4.0))


def test_an_effort_that_no_file_states_is_three_times_the_greatest_weight(tmp_path: Path) -> None:
    robot = made(tmp_path, LEVER.replace('effort="60"', 'effort="0"'), unit="A", command=10.0)
    assert robot.parameters.motors.torque[0] == pytest.approx(3 * 3.0 * GRAVITY * 0.3, rel=0.01)


def test_what_the_file_says_of_damping_is_not_counted_twice(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE)
    assert robot.parameters.driven.dof_damping[0] == pytest.approx(0.9)
    assert "turn (damping 7, friction 0)" in robot.assumed[-1]


def test_one_who_cannot_lift_its_arm_is_refused_with_the_figure(tmp_path: Path) -> None:
    """3 kg at 0.3 m weigh 8.83 N m."""
    with pytest.raises(UsageError, match="joint 'lift' can carry 45 % of its own weight"):
        made(tmp_path, LEVER, command=4.0)


def test_limits_that_take_more_torque_than_there_is_are_said(tmp_path: Path) -> None:
    weak = made(tmp_path, TABLE, command=1.0)
    assert "more torque than they have: turn (" in weak.assumed[-1]
    assert weak.parameters.motors.armature[0] == pytest.approx(0.15 * ABOUT)  # a weak motor has a light rotor
    assert not any("more torque" in s for s in made(tmp_path, TABLE).assumed)


def test_the_tables_come_back_from_a_robot_file(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, ARM, rate=100.0, unit="N m", command=60.0, delay=0.003, friction="coulomb")
    text = robot_to_toml(spec) + "[[motor]]\nname = 'lift'\ngear = 50.0\n"
    again = parse_robot(text, where="robot.toml", folder=tmp_path)
    assert again.simulate == spec.simulate
    assert again.motors == (motor("lift", gear=50.0),)
    twice = parse_robot(robot_to_toml(again), where="robot.toml", folder=tmp_path)
    assert twice == again


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ("[simulate]\nfriction = 'wet'\n", "friction"),
        ("[simulate]\nloop = 'both'\n", "loop"),
        ("[simulate]\ndelay = -0.1\n", "delay"),
        ("[simulate]\ntimestep = 0.1\n", "timestep"),
        ("[simulate]\nspeed = 1\n", "unknown key 'speed'"),
        ("[[motor]]\nname = 'turn'\ngear = 0\n", "gear = 0"),
        ("[[motor]]\nname = 'turn'\ncoulomb = -1.0\n", "coulomb = -1.0"),
        ("[[motor]]\nname = 'turn'\nkp = nan\n", "kp = nan"),
        ("[[motor]]\nname = 'turn'\nencoder_bits = 40\n", "encoder_bits = 40"),
        ("[[motor]]\nname = 'knee'\n", "'knee' is not a joint of the robot"),
    ],
)
def test_what_is_impossible_is_named(tmp_path: Path, more: str, match: str) -> None:
    text = robot_to_toml(spec_of(tmp_path, TABLE, rate=100.0, unit="N m", command=60.0))
    with pytest.raises(UsageError, match=match):
        parse_robot(text + more, where="robot.toml", folder=tmp_path)


def test_a_rate_that_is_no_part_of_the_physics_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="300 Hz is not a whole number of time steps"):
        made(tmp_path, TABLE, rate=300.0)


def test_another_change_than_payload_and_friction_is_refused(tmp_path: Path) -> None:
    robot = made(tmp_path, TABLE)
    for what, match in (
        ({"wind": 1.0}, "'wind'"),
        ({"payload": -1.0}, "payload"),
        ({"friction": 0.0}, "friction"),
    ):
        with pytest.raises(UsageError, match=match):
            robot.changed(**what)


def test_a_wrong_shape_is_refused(tmp_path: Path) -> None:
    wrong: Array = np.zeros((5, 2))
    with pytest.raises(UsageError, match=r"q has shape \(5, 2\)"):
        made(tmp_path, TABLE).inverse(wrong, wrong, wrong)


def test_torque_limits_far_beyond_the_masses_are_said_to_be_placeholders(tmp_path: Path) -> None:
    """A turntable of 2 kg needs about 1 N m: 60 are a drive's, 60000 nobody's."""
    assert not any("far above" in sentence for sentence in made(tmp_path, TABLE).assumed)
    (said,) = [one for one in made(tmp_path, TABLE, command=6e4).assumed if "far above" in one]
    assert "turn (" in said
    assert "correct command in robot.toml" in said
