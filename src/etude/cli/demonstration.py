"""Demo: the whole loop on a simulated robot, compared with no learning and with the noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from etude.campaign.create import create_campaign, find_robot
from etude.campaign.record.events import summary
from etude.campaign.record.folder import Campaign
from etude.campaign.record.rounds import SimulatedRound
from etude.cli.outcome import Say
from etude.errors import UsageError
from etude.report.build import build_report

LEARNED = "feedback + Étude, {seconds:.0f} s of motion"


@dataclass(frozen=True)
class Show:
    """Texts and baselines of a demo for one kind of robot.

    Attributes:
        robot: a built-in one that no simple model describes.
        rounds: how many motions it takes.
        before, after: labels of the baselines listed above and below what was learned; others keep their
            names.
        learned: name of what was learned, with {rounds} and {seconds} filled in.
        what: heading of the table.
    """

    robot: str = ""
    rounds: int = 4
    before: Mapping[str, str] = field(default_factory=dict)
    after: Mapping[str, str] = field(default_factory=dict)
    learned: str = LEARNED
    what: str = "Mean error on a test motion that is never used for training:"


SHOWS: Mapping[str, Show] = {
    "arm": Show(
        "arm4_rough",
        6,
        {"pd": "PD alone", "rigid_body": "PD + identified rigid-body model"},
        {"perfect": "PD + perfect model (the floor)"},
        "PD + Étude, {seconds:.0f} s of motion",
        "Mean tracking error on a test motion that is never used for training:",
    ),
    "quadrotor": Show(
        "quadrotor_rough",
        4,
        {
            "pid": "PID alone",
            "analytic": "PID + analytic model without drag",
            "exact_drag": "PID + analytic, exact linear drag",
            "rigid_body": "PID + identified vehicle",
        },
        {},
        "PID + Étude after {rounds} ({seconds:.0f} s)",
        "Mean position error on a random test flight that is never used for training:",
    ),
}
"""By kind of robot. Any other kind is shown with the names of its own baselines."""


def run(
    folder: Path | None, kind: str, robot: str | None, rounds: int | None, seed: int, say: Say
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
        UsageError: rounds < 1, an unknown robot, one of another kind, or one without a plant.
    """
    if rounds is not None and rounds < 1:
        raise UsageError(f"the demo needs 1 round or more, not {rounds}")
    robot = robot or SHOWS[kind].robot
    show = _show(robot, kind)
    campaign, _ = create_campaign(folder or _new_folder(), robot, seed=seed)
    say(f"Étude identifies the inverse dynamics of {campaign.name}; every plan stays inside its limits.")
    done: list[SimulatedRound] = []
    from etude.campaign.simulation import simulate

    for result in simulate(campaign, rounds or show.rounds, say=say):
        done.append(result)
        error = next(iter(result.mean_errors().values()))
        say(f"After {result.robot_seconds:.0f} s of motion: {error:.3f} {result.unit} on the test motion.")
    say("Drawing the report.")
    report = build_report(campaign.path)
    figures = {
        "robot": campaign.name,
        "seed": seed,
        "rounds": [
            {
                "robot_seconds": r.robot_seconds,
                f"tracking_error_{r.unit}": next(iter(r.mean_errors().values())),
            }
            for r in done
        ],
        "baselines": _baselines(campaign, next(iter(done[-1].errors))),
        "report": str(report),
    }
    return _text(campaign, show, done, figures), figures


def _show(robot: str, kind: str) -> Show:
    """Demo of that robot; the default demo accepts any kind."""
    robot_kind = find_robot(robot)[0].name
    if kind != next(iter(SHOWS)) and robot_kind != kind:
        raise UsageError(
            f"'{robot}' has the kind {robot_kind!r}, not {kind!r}",
            next_step=f"Leave out `{kind}`, or name another robot.",
        )
    return SHOWS.get(robot_kind, Show())


def _new_folder() -> Path:
    number = 1
    while Path(f"etude-demo-{number}").exists():
        number += 1
    return Path(f"etude-demo-{number}")


def _baselines(campaign: Campaign, test: str) -> dict[str, float]:
    """Newest error of each baseline on the test motion; identified baselines use all data so far."""
    return {
        run.baseline: summary(run.errors, len(campaign.axes))
        for _, run in campaign.state().evaluated
        if run.baseline and run.test == test
    }


def _text(campaign: Campaign, show: Show, done: list[SimulatedRound], figures: Mapping[str, Any]) -> str:
    baselines: Mapping[str, float] = figures["baselines"]
    named = {**show.before, **{name: name for name in baselines if name not in {**show.before, **show.after}}}
    rows = [(label, baselines[name]) for name, label in named.items() if name in baselines]
    for count, r in enumerate(done, start=1):
        runs = f"{count} flight{'s' if count > 1 else ''}"
        label = show.learned.format(rounds=runs, seconds=r.robot_seconds)
        rows.append((label, next(iter(r.mean_errors().values()))))
    rows += [(label, baselines[name]) for name, label in show.after.items() if name in baselines]
    lines = ["", show.what, *(f"  {label:<36}{error:>8.3f} {done[0].unit}" for label, error in rows)]
    return "\n".join([*lines, f"Campaign: {campaign.path}", f"Report:   {figures['report']}"])
