"""MoveIt's joint_limits.yaml: what is read counts, what is written reads back, what is odd is said."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm import KIND
from etude_arm.joint_limits import JOINT_LIMITS, read, written
from etude_arm.model_file import spec_from_model
from etude_arm.spec import Envelope

URDF = """<robot name="two"><link name="base"/><link name="a"/><link name="b"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="2" effort="40"/></joint>
<joint name="reach" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.8" velocity="0.5" effort="100"/></joint></robot>"""
WHOLE = """\
# joint_limits.yaml allows limits to be overwritten
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 1.0

joint_limits:
  turn:
    has_velocity_limits: true
    max_velocity: 1.5   # tighter
    has_acceleration_limits: true
    max_acceleration: 3
    has_jerk_limits: true
    max_jerk: 50.0
    min_position: !degrees -90
    max_position: 3.0
  "reach":
    has_velocity_limits: true
    max_velocity: 0.75
    has_acceleration_limits: false
    max_acceleration: 0
"""


def given(folder: Path, text: str, urdf: str = URDF) -> tuple[Path, Path]:
    (folder / "two.urdf").write_text(urdf)
    (folder / "joint_limits.yaml").write_text(text)
    return folder / "two.urdf", folder / "joint_limits.yaml"


def test_limits_count_where_they_are_tighter_or_the_file_has_none(tmp_path: Path) -> None:
    robot, limits = given(tmp_path, WHOLE)
    found = spec_from_model(robot, joint_limits=limits)
    turn, reach = found.spec.axes
    assert (turn.lower, turn.upper) == (pytest.approx(-math.pi / 2), 2.0)
    assert (turn.velocity, turn.acceleration, turn.jerk) == (1.5, 3.0, 50.0)
    assert (reach.velocity, reach.acceleration, reach.jerk) == (0.5, 1.0, None)
    said = "\n".join(found.confirm)
    assert "looser: upper of turn 3 for 2, velocity of reach 0.75 for 0.5" in said
    assert "default_velocity_scaling_factor 0.1" in said
    assert "default_acceleration_scaling_factor" not in said
    assert "assumed, velocity limit / 0.5 s: reach 1 " in said


def test_what_a_person_types_counts_before_both_files(tmp_path: Path) -> None:
    robot, limits = given(tmp_path, WHOLE)
    own = {"*": {"acceleration": 7.0}, "turn": {"velocity": 1.9}}
    turn, reach = spec_from_model(robot, given=own, joint_limits=limits).spec.axes
    assert (turn.velocity, turn.acceleration, reach.acceleration) == (1.9, 7.0, 7.0)


@pytest.mark.parametrize("above", ["robot_description_planning:", "/**:\n  ros__parameters:"])
def test_levels_above_are_those_of_parameter_files(above: str, tmp_path: Path) -> None:
    depth = "  " * len(above.splitlines())
    text = above + "\n" + "".join(f"{depth}{line}\n" for line in WHOLE.splitlines())
    _, limits = given(tmp_path, text)
    found = read(limits)
    assert found.limits["turn"]["velocity"] == 1.5
    assert found.scaling == {"default_velocity_scaling_factor": 0.1}


def test_a_joint_that_is_not_named_is_said(tmp_path: Path) -> None:
    robot, limits = given(tmp_path, WHOLE.split('  "reach"', maxsplit=1)[0])
    found = spec_from_model(robot, joint_limits=limits)
    assert any("does not name reach: the model file's limits are used" in line for line in found.confirm)


BAD = {
    "another joint": (WHOLE.replace("turn:", "elbow:"), r"no moving joint elbow.*turn, reach"),
    "no joint": (WHOLE.split("  turn", maxsplit=1)[0], "limits no joint"),
    "degrees a second": (WHOLE.replace("max_velocity: 1.5", "max_velocity: 120"), "degrees/s, not rad/s"),
    "mm a second": (WHOLE.replace("0.75", "500"), "mm/s, not m/s"),
    "degrees a second squared": (
        WHOLE.replace("max_acceleration: 3", "max_acceleration: 286"),
        r"degrees/s\^2.*in 7 ms",
    ),
    "a placeholder": (WHOLE.replace("has_acceleration_limits: false", ""), "above zero, not 0"),
    "an empty range": (WHOLE.replace("!degrees -90", "2.5"), r"2.5..2 do not overlap"),
    "no number": (WHOLE.replace("50.0", "fast"), "max_jerk of turn is not a number: fast"),
    "another form": (WHOLE.replace("  turn:", "  turn: {max_velocity: 1}"), r"line 6 is not `name: value`"),
    "another file": ("planner: ompl\n", "no joint_limits:"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_that_is_wrong_is_refused(case: str, tmp_path: Path) -> None:
    text, words = BAD[case]
    robot, limits = given(tmp_path, text)
    with pytest.raises(UsageError) as refused:
        spec_from_model(robot, joint_limits=limits)
    assert re.search(words, f"{refused.value.fact} {refused.value.next_step}")
    assert refused.value.where == str(limits)
    assert refused.value.next_step


def test_lower_velocities_of_a_file_are_no_sign_of_degrees(tmp_path: Path) -> None:
    """A cell may allow a twentieth of the speed and all of the acceleration."""
    robot, limits = given(
        tmp_path, WHOLE.replace("1.5", "0.1").replace("max_acceleration: 3", "max_acceleration: 15")
    )
    assert spec_from_model(robot, joint_limits=limits).spec.axes[0].acceleration == 15.0


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    odd = URDF.replace('"turn"', '"on"').replace('"reach"', '"a.b: c"')
    names = WHOLE.replace("turn:", '"on":').replace('"reach"', '"a.b: c"')
    robot, limits = given(tmp_path, names, odd)
    spec = spec_from_model(robot, joint_limits=limits).spec
    delivered = JOINT_LIMITS(None, KIND, spec, {})
    assert any("Acceleration limits are assumed" in line for line in delivered.notes) is bool(spec.confirm)
    again = tmp_path / "again.yaml"
    again.write_bytes(delivered.files["joint_limits.yaml"])
    found = read(again)
    assert list(found.limits) == ["on", "a.b: c"]
    for axis in spec.axes:
        own = found.limits[axis.name]
        assert (own["lower"], own["upper"]) == (axis.lower, axis.upper)
        assert (own["velocity"], own["acceleration"]) == (axis.velocity, axis.acceleration)
        assert own.get("jerk") == axis.jerk
    assert spec_from_model(robot, joint_limits=again).spec == spec
    yaml = pytest.importorskip("ruamel.yaml", reason="comes with the extra 'ros'")
    content = yaml.YAML(typ="safe", pure=True).load(written(spec))["joint_limits"]
    assert content["on"]["has_jerk_limits"] is True
    assert content["a.b: c"]["has_jerk_limits"] is False


@pytest.mark.parametrize("acceleration", [2.0, 4.0, 6.0, 40.0])
@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.4, 3.0])
def test_the_fastest_stop_within_what_is_written_keeps_the_envelope(
    offset: float, acceleration: float, tmp_path: Path
) -> None:
    """MoveIt has constant limits alone: positions keep the envelope, and no more are lost than need."""
    spec = spec_from_model(given(tmp_path, WHOLE)[0]).spec
    turn, reach = spec.axes
    envelope = Envelope(offset, 12.0, -2.1, 2.05)
    turn = replace(turn, acceleration=acceleration, envelope=envelope)
    path = tmp_path / "out.yaml"
    path.write_text(written(replace(spec, axes=(turn, reach))))
    own = read(path).limits["turn"]
    assert "# positions" in path.read_text()
    assert (own["velocity"], own["acceleration"]) == (2.0, acceleration)

    def slack(lower: float, upper: float) -> float:
        """Least left of the envelope on the fastest way to a stop at either end."""
        left = np.linspace(0.0, 4.0, 4001)
        speed = np.minimum(2.0, np.sqrt(2.0 * acceleration * left))
        ends = (envelope.upper - upper, lower - envelope.lower)
        tops = (np.maximum(offset + np.sqrt(12.0 * np.maximum(left + end, 0.0)), 0.0) for end in ends)
        return float(min((top - speed).min() for top in tops))

    assert slack(own["lower"], own["upper"]) > -1e-9
    cut = own["upper"] < turn.upper
    assert cut == (slack(turn.lower, turn.upper) < -1e-9)
    if cut:
        assert slack(own["lower"], own["upper"] + 0.003) < 0.0


def test_an_envelope_that_leaves_no_positions_is_refused(tmp_path: Path) -> None:
    spec = spec_from_model(given(tmp_path, WHOLE)[0]).spec
    turn, reach = spec.axes
    slow = replace(turn, envelope=Envelope(-0.3, 0.5, -2.1, 2.05))
    with pytest.raises(UsageError, match="no position of joint 'turn'"):
        written(replace(spec, axes=(slow, reach)))


def test_a_robot_file_has_limits_of_its_own(tmp_path: Path) -> None:
    _, limits = given(tmp_path, WHOLE)
    built_in = KIND.built_in()["arm4"]
    with pytest.raises(UsageError, match="robot file already states"):
        KIND.chosen(built_in, (), {}, (), {}, None, limits)
