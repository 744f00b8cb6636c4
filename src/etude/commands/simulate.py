"""etude simulate"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from etude.commands.common import Common, Folder
from etude.commands.outcome import Outcome, Say, table


@dataclass(frozen=True, kw_only=True)
class Simulate(Common):
    """Close the loop with the robot's simulated plant, and test the controller after every trajectory."""

    folder: Folder
    rounds: int = 4
    """Trajectories to ask for, run and learn."""
    engine: Literal["compiled", "mujoco"] = "compiled"
    """Two independent implementations of the same physics; mujoco is slower."""

    def run(self, say: Say) -> Outcome:
        from etude.campaign.folder import open_campaign
        from etude.campaign.simulate import SimulatedRound, simulate
        from etude.errors import UsageError

        if self.rounds < 0:
            raise UsageError(f"the number of rounds must be 0 or more, not {self.rounds}")
        rounds: list[SimulatedRound] = []
        campaign = open_campaign(self.folder)
        for done in simulate(campaign, self.rounds, self.engine, say):
            errors = ", ".join(f"{name} {_mean(e):.3f} deg" for name, e in done.tracking_error_deg.items())
            say(f"After {done.robot_seconds:.0f} s of robot time: {errors}.")
            rounds.append(done)
        baselines = _baselines(campaign.state().evaluated)
        rows = [[name, "", *(f"{e:.3f}" for e in errors.values())] for name, errors in baselines.items()]
        rows += [
            [
                f"after {r.number}",
                f"{r.robot_seconds:.0f}",
                *(f"{_mean(e):.3f}" for e in r.tracking_error_deg.values()),
            ]
            for r in rounds
        ]
        data = {
            "robot": campaign.spec.name,
            "seed": campaign.state().seed,
            "rounds": [
                {
                    "number": r.number,
                    "robot_seconds": r.robot_seconds,
                    "tracking_error_deg": {k: _mean(e) for k, e in r.tracking_error_deg.items()},
                    "joints_deg": r.tracking_error_deg,
                }
                for r in rounds
            ],
            "baselines": baselines,
        }
        return Outcome(table(["tracking error, deg", "robot s", "fourier", "moves"], rows), data)


def _baselines(evaluated: tuple[dict[str, Any], ...]) -> dict[str, dict[str, float]]:
    """Newest mean error by baseline and test."""
    found: dict[str, dict[str, float]] = {}
    for event in evaluated:
        if event.get("baseline"):
            found.setdefault(event["baseline"], {})[event["test"]] = _mean(event["tracking_error_deg"])
    return found


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
