"""The demo: the whole loop on a simulated arm, beside what a user has today and the best that is possible."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from etude.campaign.create import create_campaign
from etude.campaign.folder import Campaign
from etude.campaign.rounds import SimulatedRound
from etude.campaign.simulate import simulate
from etude.errors import UsageError
from etude.report.build import build_report

Say = Callable[[str], None]
TEST = "fourier"
NAMES = {
    "pd": "PD alone",
    "rigid_body": "PD + identified rigid-body model",
    "perfect": "PD + perfect model (the floor)",
}


def run(folder: Path | None, robot: str, rounds: int, seed: int, say: Say) -> tuple[str, Mapping[str, Any]]:
    """Runs the demo; returns a short table for people and the figures for machines.

    Args:
        folder: of the campaign; None for a new folder in the working directory.
        robot: a built-in robot with a simulated plant.
        rounds: trajectories to run.
        seed: of the campaign.
        say: receives one sentence per step.

    Raises:
        UsageError: rounds < 1, an unknown robot, or one without a plant.
    """
    if rounds < 1:
        raise UsageError(f"the demo needs 1 round or more, not {rounds}")
    campaign, _ = create_campaign(folder or _new_folder(), robot, seed=seed)
    say(f"Étude teaches {campaign.spec.name} its inverse dynamics; every trajectory stays inside its limits.")
    done: list[SimulatedRound] = []
    for found in simulate(campaign, rounds, say=say):
        done.append(found)
        error = found.mean_errors()[TEST]
        say(f"After {found.robot_seconds:.0f} s of motion: {error:.3f} deg on the test motion.")
    say("Drawing the report.")
    report = build_report(campaign.path)
    baselines = _baselines(campaign)
    figures = {
        "robot": campaign.spec.name,
        "seed": seed,
        "rounds": [
            {"robot_seconds": r.robot_seconds, "tracking_error_deg": r.mean_errors()[TEST]} for r in done
        ],
        "baselines": baselines,
        "report": str(report),
    }
    return _text(campaign, figures), figures


def _new_folder() -> Path:
    number = 1
    while Path(f"etude-demo-{number}").exists():
        number += 1
    return Path(f"etude-demo-{number}")


def _baselines(campaign: Campaign) -> dict[str, float]:
    """Newest mean error of each baseline on the test motion, degrees; rigid_body knows all the data."""
    return {
        event["baseline"]: _mean(event["tracking_error_deg"])
        for event in campaign.state().evaluated
        if event.get("baseline") and event["test"] == TEST
    }


def _text(campaign: Campaign, figures: Mapping[str, Any]) -> str:
    baselines: Mapping[str, float] = figures["baselines"]
    lines = ["", "Mean tracking error on a test motion that was never trained on:"]
    lines += [
        f"  {NAMES[name]:<36}{baselines[name]:>8.3f} deg"
        for name in ("pd", "rigid_body")
        if name in baselines
    ]
    for r in figures["rounds"]:
        label = f"PD + Étude, {r['robot_seconds']:.0f} s of motion"
        lines.append(f"  {label:<36}{r['tracking_error_deg']:>8.3f} deg")
    lines.append(f"  {NAMES['perfect']:<36}{baselines['perfect']:>8.3f} deg")
    lines += [f"Campaign: {campaign.path}", f"Report:   {figures['report']}"]
    return "\n".join(lines)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
