"""The demo's figures are the journal's, and it is of the robot that was asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.campaign import open_campaign
from etude.cli import demonstration as demo
from etude.cli.demo import Demo
from etude.cli.parse import command
from etude.errors import UsageError


def test_the_quadrotor_says_what_its_journal_says(tmp_path: Path) -> None:
    said: list[str] = []
    text, figures = demo.run(tmp_path / "lab", "quadrotor", None, 1, 2, said.append)
    campaign = open_campaign(tmp_path / "lab")
    assert campaign.name == figures["robot"] == "quadrotor_rough"
    assert campaign.state().seed == figures["seed"] == 2
    uniform = [e for _, e in campaign.state().evaluated if e.test == "uniform"]
    learned = next(e.errors[-1] for e in uniform if not e.baseline)
    assert figures["rounds"] == [
        {"robot_seconds": pytest.approx(14.9), "tracking_error_m": pytest.approx(learned)}
    ]
    assert any(
        line.split() == ["PID", "+", "Étude", "after", "1", "flight", "(15", "s)", f"{learned:.3f}", "m"]
        for line in text.splitlines()
    )
    for event in uniform:
        if event.baseline:
            assert figures["baselines"][event.baseline] == event.errors[-1]
            assert f"{event.errors[-1]:>8.3f} m" in text
    lines = [line for line in text.splitlines() if line.endswith(" m")]
    assert [line.split("   ")[0].strip() for line in lines[:4]] == [
        "PID alone",
        "PID + analytic model without drag",
        "PID + analytic, exact linear drag",
        "PID + identified vehicle",
    ]
    assert f"After 15 s of motion: {learned:.3f} m on the test motion." in said
    assert Path(figures["report"]).is_file()


def test_an_arm_cannot_be_the_quadrotor_and_nothing_is_made(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="'arm4' has the kind 'arm'"):
        demo.run(tmp_path / "lab", "quadrotor", "arm4", 1, 0, lambda _: None)
    with pytest.raises(UsageError, match="1 round or more"):
        demo.run(tmp_path / "lab", "quadrotor", None, 0, 0, lambda _: None)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("kind", "robot", "shown"),
    [("arm", None, "arm"), ("arm", "quadrotor", "quadrotor"), ("quadrotor", None, "quadrotor")],
)
def test_the_robot_decides_what_is_shown(kind: str, robot: str | None, shown: str) -> None:
    assert demo._show(robot or demo.SHOWS[kind].robot, kind) == demo.SHOWS[shown]


@pytest.mark.parametrize(
    ("words", "kind", "robot"),
    [([], "arm", None), (["quadrotor"], "quadrotor", None), (["--robot", "arm4"], "arm", "arm4")],
)
def test_the_command_line_chooses(words: list[str], kind: str, robot: str | None) -> None:
    found = command(["demo", *words])
    assert isinstance(found, Demo)
    assert (found.kind, found.robot, found.rounds) == (kind, robot, None)
