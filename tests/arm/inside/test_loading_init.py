"""`etude init` of robots that are larger than an arm, from the command line to a certified motion."""

from __future__ import annotations

from pathlib import Path

import pytest
from loading_examples import write
from robots_of_others import FILES, file_of

import etude
from etude.campaign import RobotPart, create_campaign
from etude.cli import main
from etude.errors import UsageError

SEVEN = ("panda", "ur5", "iiwa", "xarm7", "so100", "z1", "tiago")


@pytest.mark.parametrize(
    "options",
    [
        ["--joints", "shoulder", "wrist", "--hold", "elbow=0.5", "finger_left=0.02"],
        ["--joints", "shoulder,wrist", "--hold", "elbow=0.5,finger_left=0.02"],
    ],
)
def test_joints_and_positions_come_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    urdf, lab = write(tmp_path), tmp_path / "lab"
    assert main(["init", str(lab), "--robot", str(urdf), *options]) == 0
    assert "2 axes (shoulder, wrist)" in capsys.readouterr().out
    spec = etude.open_campaign(lab).spec
    assert spec.held == {"elbow": 0.5, "finger_left": 0.02}
    assert (lab / "robot_meshes" / "0_cube.obj").is_file()
    text = (lab / "robot.toml").read_text()
    assert "\nconfirm = [\n" in text
    assert '[held]\n"elbow" = 0.5\n"finger_left" = 0.02\n' in text


def test_folders_of_meshes_are_taken_along(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = write(tmp_path / "near")
    mesh = urdf.parents[1] / "meshes/cube.obj"
    root = tmp_path / "far" / "arm" / "meshes"
    root.mkdir(parents=True)
    mesh.rename(root / "cube.obj")
    assert main(["init", str(tmp_path / "a"), "--robot", str(urdf)]) == 0
    assert "Meshes are missing: package://arm/meshes/cube.obj" in capsys.readouterr().out
    assert (
        main(["init", str(tmp_path / "b"), "--robot", str(urdf), "--mesh-root", str(tmp_path / "far")]) == 0
    )
    assert "missing" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("robot", "options", "words"),
    [
        ("urdf", ["--hold", "elbow"], "'elbow' does not have the form joint=position"),
        ("urdf", ["--hold", "=1"], "'=1' does not have the form joint=position"),
        ("urdf", ["--joints", "knee"], "no moving joint knee"),
        ("quadrotor", ["--joints", "knee"], "'quadrotor' have no joints to choose from"),
        ("arm4", ["--joints", "waist"], "robot file already states the moving joints"),
    ],
)
def test_what_cannot_be_chosen_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], robot: str, options: list[str], words: str
) -> None:
    robot = str(write(tmp_path)) if robot == "urdf" else robot
    assert main(["init", str(tmp_path / "lab"), "--robot", robot, *options]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "lab").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", SEVEN)
def test_from_a_file_of_a_package_to_a_certified_motion(name: str, tmp_path: Path) -> None:
    joints, path = FILES[name][1], file_of(name)
    campaign, confirm = create_campaign(tmp_path / "lab", str(path), part=RobotPart(joints))
    assert sum("Acceleration limits are assumed" in sentence for sentence in confirm) == 1
    assert etude.ask(campaign).number == 1
    assert (tmp_path / "lab/proposals/0001/certificate.json").is_file()


def test_a_kind_without_joints_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no joints to choose from"):
        create_campaign(tmp_path / "sky", "quadrotor", part=RobotPart(held={"rotor": 1.0}))


def test_a_range_of_ones_own_is_no_assumption(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, lab = write(tmp_path), tmp_path / "lab"
    options = ["--joints", "shoulder", "wrist", "--range", "wrist=-1:7", "shoulder=-1:1"]
    assert main(["init", str(lab), "--robot", str(urdf), *options]) == 0
    assert "Ranges are assumed" not in capsys.readouterr().out
    spec = etude.open_campaign(lab).spec
    assert (spec.lower.tolist(), spec.upper.tolist()) == ([-1.0, -1.0], [1.0, 7.0])
    for wrong, words in (
        ("shoulder=-3:1", "shoulder is not within the file's own, -1.5..2"),
        ("knee=-3:1", "no moving joint knee"),
        ("wrist=1", "'wrist=1' does not have the form joint=lower:upper"),
        ("wrist=2:1", "'wrist=2:1' does not have the form joint=lower:upper"),
    ):
        assert main(["init", str(tmp_path / "other"), "--robot", str(urdf), "--range", wrong]) != 0
        assert words in capsys.readouterr().err


def test_limits_that_a_file_has_no_place_for_come_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, lab = write(tmp_path), tmp_path / "lab"
    options = ["--joints", "shoulder", "wrist", "--velocity", "*=0.5", "wrist=0.7", "--command", "wr*=3"]
    assert main(["init", str(lab), "--robot", str(urdf), *options]) == 0
    assert "shoulder 1, wrist 1.4 (rad/s^2" in capsys.readouterr().out
    spec = etude.open_campaign(lab).spec
    assert spec.velocity.tolist() == [0.5, 0.7]
    assert spec.command[1] == 3.0 != spec.command[0]
    for wrong, words in (
        ("0.5", "'0.5' does not have the form joint=limit"),
        ("knee=1", "no moving joint knee"),
    ):
        assert main(["init", str(tmp_path / "other"), "--robot", str(urdf), "--velocity", wrong]) == 2
        assert words in capsys.readouterr().err
