"""The demo: the whole loop on a simulated robot, beside what there is without learning and the floor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from etude.campaign.create import create_campaign
from etude.campaign.folder import Campaign
from etude.campaign.robot_copy import robot_from
from etude.campaign.rounds import SimulatedRound, summary
from etude.campaign.simulate import simulate
from etude.errors import UsageError
from etude.report.build import build_report

Say = Callable[[str], None]
DemoKind = Literal["arm", "quadrotor"]


@dataclass(frozen=True)
class Show:
    """What a demo shows of one kind of robot.

    Attributes:
        robot: a built-in one that no simple model describes.
        rounds: how many motions it takes.
        test: the test motion whose errors are shown.
        unit: of the errors, "deg" or "m".
        before, after: names of the baselines listed above and below what was learned.
        learned: name of what was learned, with {rounds} and {seconds} filled in.
        what: heading of the table.
    """

    robot: str
    rounds: int
    test: str
    unit: str
    before: Mapping[str, str]
    after: Mapping[str, str]
    learned: str
    what: str


SHOWS: dict[DemoKind, Show] = {
    "arm": Show(
        "arm4_rough",
        6,
        "fourier",
        "deg",
        {"pd": "PD alone", "rigid_body": "PD + identified rigid-body model"},
        {"perfect": "PD + perfect model (the floor)"},
        "PD + Étude, {seconds:.0f} s of motion",
        "Mean tracking error on a test motion that was never trained on:",
    ),
    "quadrotor": Show(
        "quadrotor_rough",
        4,
        "uniform",
        "m",
        {
            "pid": "PID alone",
            "analytic": "PID + analytic model without drag",
            "exact_drag": "PID + analytic, exact linear drag",
        },
        {},
        "PID + Étude after {rounds} ({seconds:.0f} s)",
        "Mean position error on a random test flight that was never trained on:",
    ),
}


def run(
    folder: Path | None, kind: DemoKind, robot: str | None, rounds: int | None, seed: int, say: Say
) -> tuple[str, Mapping[str, Any]]:
    """Runs the demo; returns a short table for people and the figures for machines.

    Args:
        folder: of the campaign; None for a new folder in the working directory.
        kind: which demo.
        robot: a built-in robot with a simulated plant, which decides what is shown; None for the demo's own.
        rounds: motions to run; None for the demo's own number.
        seed: of the campaign.
        say: receives one sentence per step.

    Raises:
        UsageError: rounds < 1, an unknown robot, one without a plant, or one that does not fly as quadrotor.
    """
    if rounds is not None and rounds < 1:
        raise UsageError(f"the demo needs 1 round or more, not {rounds}")
    robot = robot or SHOWS[kind].robot
    show = _show(robot, kind)
    campaign, _ = create_campaign(folder or _new_folder(), robot, seed=seed)
    say(f"Étude teaches {campaign.spec.name} its inverse dynamics; every plan stays inside its limits.")
    done: list[SimulatedRound] = []
    for found in simulate(campaign, rounds or show.rounds, say=say):
        done.append(found)
        error = found.mean_errors()[show.test]
        say(f"After {found.robot_seconds:.0f} s of motion: {error:.3f} {show.unit} on the test motion.")
    say("Drawing the report.")
    report = build_report(campaign.path)
    figures = {
        "robot": campaign.spec.name,
        "seed": seed,
        "rounds": [
            {"robot_seconds": r.robot_seconds, f"tracking_error_{show.unit}": r.mean_errors()[show.test]}
            for r in done
        ],
        "baselines": _baselines(campaign, show),
        "report": str(report),
    }
    return _text(campaign, show, figures), figures


def _show(robot: str, kind: DemoKind) -> Show:
    spec, _ = robot_from(robot)
    flies = spec.flight is not None
    if kind == "quadrotor" and not flies:
        raise UsageError(f"'{spec.name}' does not fly", next_step="Leave out `quadrotor`, or name a vehicle.")
    return SHOWS["quadrotor" if flies else "arm"]


def _new_folder() -> Path:
    number = 1
    while Path(f"etude-demo-{number}").exists():
        number += 1
    return Path(f"etude-demo-{number}")


def _baselines(campaign: Campaign, show: Show) -> dict[str, float]:
    """Newest mean error of each baseline on the test motion; an identified one knows all the data."""
    return {
        event["baseline"]: summary(event[f"tracking_error_{show.unit}"], show.unit)
        for event in campaign.state().evaluated
        if event.get("baseline") and event["test"] == show.test
    }


def _text(campaign: Campaign, show: Show, figures: Mapping[str, Any]) -> str:
    baselines: Mapping[str, float] = figures["baselines"]
    rows = [(label, baselines[name]) for name, label in show.before.items() if name in baselines]
    for count, r in enumerate(figures["rounds"], start=1):
        flights = f"{count} flight{'s' if count > 1 else ''}"
        label = show.learned.format(rounds=flights, seconds=r["robot_seconds"])
        rows.append((label, r[f"tracking_error_{show.unit}"]))
    rows += [(label, baselines[name]) for name, label in show.after.items() if name in baselines]
    lines = ["", show.what, *(f"  {label:<36}{error:>8.3f} {show.unit}" for label, error in rows)]
    return "\n".join([*lines, f"Campaign: {campaign.path}", f"Report:   {figures['report']}"])
