"""What simulated rounds of both kinds of robot have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from etude.campaign.folder import Campaign
from etude.campaign.learn import learn_pending
from etude.campaign.learner import Say


@dataclass(frozen=True)
class SimulatedRound:
    """One trajectory, run and learned.

    Attributes:
        number: of the trajectory.
        robot_seconds: recorded motion so far, s.
        errors: per test motion, mean absolute tracking error: of each joint, or along x, y, z and in all.
        unit: of the errors, "deg" or "m".
    """

    number: int
    robot_seconds: float
    errors: dict[str, list[float]]
    unit: str

    def mean_errors(self) -> dict[str, float]:
        """One figure per test: the mean over the joints, or the distance in space."""
        return {name: summary(values, self.unit) for name, values in self.errors.items()}


def summary(values: list[float], unit: str) -> float:
    """The figure that stands for an evaluation: the mean over the joints in deg; the distance, last, in m."""
    return values[-1] if unit == "m" else sum(values) / len(values)


def known_evaluation(
    campaign: Campaign, test: str, number: int, baseline: str | None
) -> dict[str, Any] | None:
    """The facts of that test run if it was made before."""
    key = {"test": test, "baseline": baseline, "number": number}
    evaluated = campaign.state().evaluated
    return next((e for e in evaluated if all(e.get(name) == value for name, value in key.items())), None)


def robot_seconds(campaign: Campaign) -> float:
    """Recorded motion of all logs told, s."""
    return float(sum(r.told["robot_seconds"] for r in campaign.state().told if r.told))


def interrupted_round(campaign: Campaign, say: Say) -> int | None:
    """Learns a log that an earlier run left; the number of the last round learned, or None.

    Raises:
        DataError, NumericalError: the log cannot be learned.
    """
    with campaign.writing():
        learn_pending(campaign, say=say)
    trained = campaign.state().trained
    return trained[-1].number if trained else None
