"""Command limits against the arm's own weight: closed forms, what init says, what ask refuses, and warns."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rehearsal_examples import ARM, GRAVITY, LEVER, spec_of
from robots_of_others import robot_of
from test_loading_arms import ARMS, Arm

import etude
from etude import ask
from etude.campaign import RobotPart, create_campaign
from etude.cli import main
from etude.codes import Warn
from etude.errors import UnsafeTrajectoryError
from etude.limits import CommandLimit, require_certified
from etude.protocols import Trajectory
from etude.trajectories import PointToPoint
from etude.types import Array, Motion
from etude_arm import ArmSpec
from etude_arm.clearance.clear_pose import clearest
from etude_arm.command_limits import NO_MOTION, commands_of
from etude_arm.description import sentences, weight_of
from etude_arm.model_file import spec_from_model

LEVEL = GRAVITY * 3.0 * 0.3
"""N m that hold the lever level, where it stands at home."""
STRETCHED = GRAVITY * (3.0 * 0.3 + 1.0 * (0.4 + 0.2 + 2.0))
"""N m that hold the arm level with its telescope out."""
WORST = [0.0, 0.0, 2.0]


def lever(folder: Path, command: float, **what: object) -> ArmSpec:
    return spec_of(folder, LEVER, rate=100.0, unit="N m", command=command, **what)


def arm(folder: Path, command: float, unit: str = "N m") -> ArmSpec:
    return spec_of(folder, ARM, rate=100.0, unit=unit, command=command)


def test_the_heaviest_pose_is_the_one_that_mechanics_names(tmp_path: Path) -> None:
    spec = arm(tmp_path, 60.0)
    weight = weight_of(spec, np.zeros(3))
    assert weight is not None
    np.testing.assert_allclose(weight.most, [0.0, STRETCHED, GRAVITY], rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(weight.at[1, 1:], WORST[1:], atol=0.07)
    np.testing.assert_allclose(weight.home, [0.0, GRAVITY * 1.5, 0.0], atol=1e-9)
    rng = np.random.default_rng(3)  # nobody finds a heavier one
    lift, reach = rng.uniform(-2.0, 2.0, (2, 100_000))
    assert weight.most[1] >= np.abs(GRAVITY * (0.9 + 0.6 + reach) * np.cos(lift)).max() - 1e-9


def test_without_masses_or_forces_nothing_is_said(tmp_path: Path) -> None:
    assert sentences(arm(tmp_path, 0.01, unit="A"), np.zeros(3)) == ()
    assert sentences(replace(arm(tmp_path, 0.01), model_file=None), np.zeros(3)) == ()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (LEVEL * 1.01, "is used, lift 1 %. All of them together would almost exclude rest at home"),
        (LEVEL * 0.99, f"{NO_MOTION}: at rest at home lift takes 8.829 N m of 8.741; at worst lift takes"),
        (LEVEL * 0.01, "lift takes 8.829 N m of 0.08829; at worst"),
        (LEVEL * 8.0, None),
        (LEVEL * 1000.0, "at least 9"),
        (1e6, "placeholders, or another unit"),
    ],
)
def test_limits_that_cannot_be_are_said_and_others_are_not(
    tmp_path: Path, command: float, words: str | None
) -> None:
    found = sentences(lever(tmp_path, command), np.zeros(1))
    assert len(found) == (words is not None)
    assert words is None or words in found[0]


def test_before_any_log_wrong_masses_and_friction_have_room(tmp_path: Path) -> None:
    """A mass in doubt by 30 %, anywhere within the radius of gyration, and friction of 10 % of the limit."""
    command = 4.0 * LEVEL
    limit = commands_of(lever(tmp_path, command), None, np.zeros(1))
    assert isinstance(limit, CommandLimit)
    assert limit.deviation is not None
    gyration = math.sqrt((2.0 * 3.0 * 0.3**2 + 0.05) / 3.0)
    wanted = math.hypot(0.3 * 3.0 * gyration * GRAVITY, 0.1 * command)
    np.testing.assert_allclose(
        limit.deviation(Motion(np.zeros(1), np.zeros((3, 1, 1)))), [[wanted]], rtol=1e-6
    )
    # one mass for the whole motion: of a single joint within 1.96 deviations, however long it lasts
    assert limit.beyond(1.0) == limit.beyond(1000.0) == pytest.approx(1.96, abs=0.001)


def test_home_is_where_the_drives_hold_the_arm_with_room() -> None:
    """Everywhere clear: home is the middle, unless the drives need more there than their limit."""
    ends = np.array([-2.0, -2.0]), np.array([2.0, 2.0])
    poses = SimpleNamespace(
        lower=ends[0], upper=ends[1], random_poses=lambda rng, n: rng.uniform(*ends, (n, 2))
    )
    gaps = SimpleNamespace(list=["one"], skeleton=poses, of_poses=lambda at: np.ones((len(at), 1)))

    def found(weight: Callable[[Array], Array] | None) -> Array:
        return clearest(gaps, np.random.default_rng(1), weight)  # type: ignore[arg-type]

    np.testing.assert_array_equal(found(None), 0.0)
    np.testing.assert_array_equal(found(lambda at: 0.99 * np.cos(at[:, 0])), 0.0)
    aside = found(lambda at: 2.0 * np.cos(at[:, 0]))
    assert 2.0 * math.cos(aside[0]) < 1.05
    assert abs(aside[0]) < 1.4, "no farther than it must"
    edge = found(lambda at: 2.0 - 0.5 * np.abs(at[:, 0]))
    assert 1.45 < abs(edge[0]) <= 1.6, "a tenth of its range is left for what the feedback sags"


def test_an_arm_that_is_held_at_home_alone_says_where_it_is_not(tmp_path: Path) -> None:
    found, less = sentences(arm(tmp_path, 20.0), np.zeros(3))
    assert "masses is used, lift 31 %" in less
    assert not found.startswith(NO_MOTION)
    assert f"lift takes {STRETCHED:.4g} N m of 20 (at [" in found
    assert "reach" not in found, "the slide is held everywhere"
    (slide,) = sentences(replace_command(arm(tmp_path, 60.0), 2, 5.0), np.zeros(3))
    assert "reach takes 9.8" in slide
    assert " N of 5 (at" in slide


def replace_command(spec: ArmSpec, j: int, command: float) -> ArmSpec:
    axes = list(spec.axes)
    axes[j] = replace(axes[j], command=command)
    return replace(spec, axes=tuple(axes))


def test_a_smaller_torque_that_a_motion_may_ask_counts_too(tmp_path: Path) -> None:
    spec = lever(tmp_path, LEVEL * 2.0)
    assert sentences(replace(spec, axes=(replace(spec.axes[0], torque=LEVEL / 2.0),)), np.zeros(1))


def test_refused_until_a_person_takes_the_line_out_then_warned(tmp_path: Path) -> None:
    weak = lever(tmp_path, 0.5 * LEVEL)
    waits = replace(weak, confirm=sentences(weak, np.zeros(1)))
    refused, warned = (commands_of(spec, None, np.zeros(1)) for spec in (waits, weak))
    assert refused is not None
    assert "lift takes 8.829 N m of 4.4" in refused.refused[0]  # type: ignore[union-attr]
    assert warned.refused == ("", "")  # type: ignore[union-attr]
    enough = replace(waits, axes=lever(tmp_path, 2.0 * LEVEL).axes)
    assert not hasattr(commands_of(enough, None, np.zeros(1)), "refused"), "a corrected limit needs no word"


def campaign(folder: Path, *options: str) -> Path:
    (folder / "made.urdf").write_text(LEVER)
    assert main(["init", str(folder / "lab"), "--robot", str(folder / "made.urdf"), *options]) == 0
    return folder / "lab"


def test_from_init_to_ask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lab = campaign(tmp_path, "--joints", "lift", "--command", "lift=0.6")
    assert f"  - {NO_MOTION}: at rest at home lift takes 8.829 N m of 0.6" in capsys.readouterr().out
    assert main(["ask", str(lab)]) == 4
    said = capsys.readouterr().err
    assert "takes 8.829 N m of 0.6" in said
    assert "confirm" in said
    assert "With corrected masses begin anew: etude init" in said, "a campaign refuses another model file"
    assert not list((lab / "proposals").glob("*/*")), "nothing is written"
    robot = lab / "robot.toml"
    robot.write_text("".join(s for s in robot.read_text().splitlines(keepends=True) if NO_MOTION not in s))
    found = ask(etude.open_campaign(lab))
    (warning,) = found.certificate.warnings
    assert warning.code == Warn.BEYOND_LIMITS
    assert "Beyond the stated torque limits, by the model file's masses: lift" in warning.sentence
    assert warning.sentence in (found.folder / "certificate.json").read_text()
    assert not any(row.quantity == "torque" for row in found.certificate.rows)
    assert main(["ask", str(lab)]) == 0
    assert f"! {warning}" == capsys.readouterr().out.splitlines()[0]
    assert main(["report", str(lab)]) == 0
    assert warning.sentence.split(": ")[1] in (lab / "report.html").read_text()


def test_a_corrected_limit_is_asked_for_and_held(tmp_path: Path) -> None:
    lab = campaign(tmp_path, "--joints", "lift", "--command", "lift=0.6")
    robot = lab / "robot.toml"
    robot.write_text(robot.read_text().replace("command = 0.6\n", "command = 30.0\n"))
    found = ask(etude.open_campaign(lab))
    assert found.certificate.warnings == ()
    assert "warnings" not in (found.folder / "certificate.json").read_text(), "as it always was"
    (row,) = [row for row in found.certificate.rows if row.quantity == "torque"]
    assert (row.lower, row.upper) == (-30.0, 30.0)
    assert "assumed deviations" in row.method
    assert any("are assumed as deviations" in said for said in found.certificate.not_verified)


@pytest.mark.slow
def test_a_motion_beyond_what_drives_hold_is_drawn_back(tmp_path: Path) -> None:
    """Held at home, not everywhere: what is asked stays where the limit holds gravity and motion."""
    (tmp_path / "made.urdf").write_text(ARM)
    part = RobotPart(limits={"lift": {"command": 20.0}})
    lab, said = create_campaign(tmp_path / "lab", str(tmp_path / "made.urdf"), part=part)
    assert any("cannot be held in all of its range: at worst lift" in sentence for sentence in said)
    found = ask(lab)
    (row,) = [row for row in found.certificate.rows if (row.axis, row.quantity) == ("lift", "torque")]
    assert max(-row.proved_lower, row.proved_upper) <= 20.0
    with pytest.raises(UnsafeTrajectoryError, match="torque of 'lift' may reach"):
        require_certified(reaching_out(), etude.open_campaign(tmp_path / "lab").limits())


@pytest.mark.thinned
@pytest.mark.parametrize("name", ["panda", "z1", pytest.param("tiago", marks=pytest.mark.slow)])
@pytest.mark.parametrize("times", [1000.0, 0.001])
def test_one_limit_in_another_unit_is_named_and_no_other(name: str, times: float) -> None:
    spec = robot_of(name)
    home = 0.5 * (spec.lower + spec.upper)
    assert not any("differ much" in sentence for sentence in sentences(spec, home))
    for j, joint in enumerate(spec.names):
        found = sentences(replace_command(spec, j, times * spec.command[j]), home)
        odd = [sentence for sentence in found if "differ much from those of the other joints" in sentence]
        said = odd or [sentence for sentence in found if f"{joint} takes" in sentence]
        assert said, (joint, found)
        assert joint in said[0]
        assert not any(other in said[0] for other in spec.names if odd and other != joint)
        assert times < 1.0 or odd
        assert not (odd and any(f"{joint} takes" in sentence for sentence in found)), "once is enough"


def test_one_number_for_joints_of_all_sizes_is_named() -> None:
    spec = robot_of("ur10")
    home = 0.5 * (spec.lower + spec.upper)
    assert sentences(spec, home) == ()
    for command, named in ((1000.0, True), (150.0, False)):
        for j in range(spec.dof):
            spec = replace_command(spec, j, command)
        assert any("state the same command limit" in sentence for sentence in sentences(spec, home)) == named


def test_limits_in_two_groups_of_one_size_are_nobodys_fault(tmp_path: Path) -> None:
    spec = arm(tmp_path, 60.0)
    assert sentences(replace_command(spec, 0, 3e3), np.zeros(3)) == ()  # one of two hinges: which is it?
    assert sentences(replace_command(spec, 2, 5e2), np.zeros(3)) == ()  # a slide has a unit of its own


PLACEHOLDERS = {"ur3_robot": "placeholders", "so100": "placeholders", "pr2": NO_MOTION}
WEAK = {"baxter": "left_s1 takes 5", "talos_left_arm": "arm_left_2_joint takes 2"}


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.file)
def test_of_the_arms_of_others_only_those_with_wrong_numbers_are_named(arm: Arm) -> None:
    """A UR3 with a UR10's efforts, servos of 2 N m with 35, a balanced PR2, two that tire stretched."""
    spec = spec_from_model(arm.path(), joints=arm.joints).spec
    # nobody would choose this home: what it leaves of the assumed deviations is no wrong number
    found = [one for one in sentences(spec, 0.5 * (spec.lower + spec.upper)) if "in full" not in one]
    words = (PLACEHOLDERS | WEAK).get(arm.path().stem)
    assert len(found) == (words is not None), found
    assert words is None or words in found[0]


def reaching_out() -> Trajectory:
    """To the pose that no drive of 20 N m holds, slowly."""
    return PointToPoint(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.9]]), np.full(3, 0.1))


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((60.0, 60.0, 60.0), ""),
        ((60.0, 60.0, 60e3), "slides.*: reach 6e.04 N, .* Perhaps in another unit"),
        ((60.0, 60e3, 60.0), "differ much.*: lift 6e.04 N m, 1e.03 times the nearest"),
        ((0.05, 60.0, 60.0), "differ much.*: turn 0.05 N m"),
        ((1.0, 60.0, 60.0), ""),
    ],
)
def test_a_lone_slide_and_one_of_two_hinges_in_another_unit_are_named(
    tmp_path: Path, limits: tuple[float, ...], words: str
) -> None:
    spec = arm(tmp_path, 60.0)
    axes = tuple(replace(axis, command=own) for axis, own in zip(spec.axes, limits, strict=True))
    found = sentences(replace(spec, axes=axes), np.zeros(3))
    assert len(found) == bool(words), found
    assert re.search(words, " ".join(found))


def test_friction_of_the_file_is_in_the_limit_before_the_first_log(tmp_path: Path) -> None:
    """Against the motion, and nowhere at rest; no number that the drive could not move against."""
    level, commands = np.zeros((3, 1)), []
    for friction in (0.0, 5.0, 80.0):
        folder = tmp_path / f"{friction:g}"
        folder.mkdir()
        spec = lever(folder, 60.0)
        assert spec.model_file is not None
        text = LEVER.replace('damping="7"', f'damping="7" friction="{friction}"')
        assert spec.model_file.read_text() == LEVER
        spec.model_file.write_text(text)
        limit = commands_of(spec, None, np.zeros(1))
        assert isinstance(limit, CommandLimit)
        speeds = np.array([[-1.0], [0.0], [1.0]])
        commands.append(limit.mean(Motion(np.zeros(3), np.stack([level, speeds, level, level])))[:, 0])
        assert any("friction are those of the model file" in line for line in limit.gaps)
        motion = Motion(np.zeros(3), np.random.default_rng(3).normal(size=(3, 3, 1)))
        assert limit.both is not None
        assert limit.deviation is not None
        for one, other in zip(limit.both(motion), (limit.mean(motion), limit.deviation(motion)), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)
    assert commands[0][2] - commands[0][0] == pytest.approx(2.0 * 7.0)
    np.testing.assert_allclose(commands[1] - commands[0], [-5.0, 0.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(commands[2], commands[0], atol=1e-12)


def vague(size: float, level: float = LEVEL) -> SimpleNamespace:
    """A learned model of the lever, which takes `level` N m at home, unsure of `size` N m."""

    def posterior(motion: Motion) -> tuple[Array, Array]:
        weight = level * np.cos(motion.orders[0])
        return weight, np.full_like(weight, size**2)

    return SimpleNamespace(
        inputs=SimpleNamespace(orders=3, states=lambda motion: motion), posterior=posterior
    )


def test_a_model_that_is_unsure_at_home_leaves_the_limit_of_before_any_log(tmp_path: Path) -> None:
    """Deviations are no evidence against a limit; a mean beyond it at home is."""
    spec, home = lever(tmp_path, 2.0 * LEVEL), np.zeros(1)
    assumed = commands_of(spec, None, home)
    assert isinstance(assumed, CommandLimit)
    sure = commands_of(spec, vague(0.05 * LEVEL), home)  # type: ignore[arg-type]
    assert isinstance(sure, CommandLimit)
    assert sure.source == "the learned model"
    for size in (LEVEL, 20.0 * LEVEL):
        found = commands_of(spec, vague(size), home)  # type: ignore[arg-type]
        assert isinstance(found, CommandLimit)
        assert (found.source, found.gaps[1:]) == (assumed.source, assumed.gaps[1:])
        assert "do not determine rest at home" in found.gaps[0]
    for level in (2.1 * LEVEL, -2.1 * LEVEL):
        assert not isinstance(commands_of(spec, vague(LEVEL, level), home), CommandLimit)  # type: ignore[arg-type]
    volts = replace(spec, command_unit="V")
    assert not isinstance(commands_of(volts, vague(LEVEL), home), CommandLimit)  # type: ignore[arg-type]
