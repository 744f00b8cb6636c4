"""What simulated rounds measure, and what was measured before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from etude.campaign.record.folder import Campaign, Say

ERROR = "tracking_error_"
"""Begins the fact that holds the errors of a test run; their unit ends it."""


@dataclass(frozen=True)
class SimulatedRound:
    """One trajectory, run and learned.

    Attributes:
        number: of the trajectory.
        robot_seconds: recorded motion so far, s.
        errors: per test motion, mean absolute tracking error of each axis, and the distance where axes are
            directions in space.
        unit: of the errors, "deg" or "m", for example.
        axes: how many there are.
    """

    number: int
    robot_seconds: float
    errors: dict[str, list[float]]
    unit: str
    axes: int

    def mean_errors(self) -> dict[str, float]:
        """One figure per test: the mean over the axes, or the distance in space."""
        return {name: summary(values, self.axes) for name, values in self.errors.items()}


def summary(values: list[float], axes: int) -> float:
    """The figure that stands for an evaluation: the mean over the axes, or what comes after theirs."""
    return values[-1] if len(values) > axes else sum(values) / len(values)


def measured(facts: dict[str, Any]) -> tuple[list[float], str]:
    """The errors of an evaluation and their unit."""
    key = next(key for key in facts if key.startswith(ERROR))
    return list(facts[key]), key.removeprefix(ERROR)


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
    from etude.campaign.training import learn_pending

    with campaign.writing():
        learn_pending(campaign, say=say)
    trained = campaign.state().trained
    return trained[-1].number if trained else None
