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
        from etude.campaign.rounds import SimulatedRound
        from etude.campaign.simulate import simulate
        from etude.errors import UsageError

        if self.rounds < 0:
            raise UsageError(f"the number of rounds must be 0 or more, not {self.rounds}")
        rounds: list[SimulatedRound] = []
        campaign = open_campaign(self.folder)
        for done in simulate(campaign, self.rounds, self.engine, say):
            errors = ", ".join(f"{name} {e:.3f} {done.unit}" for name, e in done.mean_errors().items())
            say(f"After {done.robot_seconds:.0f} s of robot time: {errors}.")
            rounds.append(done)
        baselines = _baselines(campaign.state().evaluated)
        rows = [[name, "", *(f"{e:.3f}" for e in errors.values())] for name, errors in baselines.items()]
        rows += [
            [
                f"after {r.number}",
                f"{r.robot_seconds:.0f}",
                *(f"{e:.3f}" for e in r.mean_errors().values()),
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
                    f"tracking_error_{r.unit}": r.mean_errors(),
                    "joints_deg" if r.unit == "deg" else "xyz_and_distance_m": r.errors,
                }
                for r in rounds
            ],
            "baselines": baselines,
        }
        unit = "m" if campaign.spec.flight is not None else "deg"
        tests = list(next(iter(baselines.values()), {}))
        return Outcome(table([f"tracking error, {unit}", "robot s", *tests], rows), data)


def _baselines(evaluated: tuple[dict[str, Any], ...]) -> dict[str, dict[str, float]]:
    """Newest error by baseline and test."""
    from etude.campaign.rounds import summary

    found: dict[str, dict[str, float]] = {}
    for event in evaluated:
        if event.get("baseline"):
            unit = "m" if "tracking_error_m" in event else "deg"
            value = summary(event[f"tracking_error_{unit}"], unit)
            found.setdefault(event["baseline"], {})[event["test"]] = value
    return found
