"""Rounds of a simulated campaign: measurements of these and of earlier rounds."""

from __future__ import annotations

from dataclasses import dataclass

from etude.campaign.record.events import Evaluated, summary
from etude.campaign.record.folder import Campaign, Say


@dataclass(frozen=True)
class SimulatedRound:
    """One trajectory that was run and learned.

    Attributes:
        number: of the trajectory.
        robot_seconds: recorded motion so far, s.
        errors: mean absolute tracking error of each axis, by test motion; then the distance, if the axes are
            directions in space.
        unit: of the errors, for example "deg" or "m".
        axes: number of axes.
    """

    number: int
    robot_seconds: float
    errors: dict[str, list[float]]
    unit: str
    axes: int

    def mean_errors(self) -> dict[str, float]:
        """One figure for each test: the mean over the axes, or the distance in space."""
        return {name: summary(values, self.axes) for name, values in self.errors.items()}


def known_evaluation(campaign: Campaign, test: str, number: int, baseline: str) -> Evaluated | None:
    """An earlier evaluation of this test after this round; None if there is none."""
    key = test, number, baseline
    return next((e for n, e in campaign.state().evaluated if (e.test, n, e.baseline) == key), None)


def robot_seconds(campaign: Campaign) -> float:
    """Recorded motion of all ingested logs, s."""
    return campaign.state().robot_seconds


def interrupted_round(campaign: Campaign, say: Say) -> int | None:
    """Learns a log that an interrupted run left; returns the number of the last learned round, or None.

    Raises:
        DataError, NumericalError: the log cannot be learned.
    """
    from etude.campaign.training import learn_pending

    with campaign.writing():
        learn_pending(campaign, say=say)
    trained = campaign.state().trained
    return trained[-1].number if trained else None
