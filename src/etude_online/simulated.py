"""Online learning of a campaign's model in simulated tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from etude.abilities import SupportsEachTick
from etude.campaign.deployment.model_export import ingested_logs
from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_models import newest_model
from etude.errors import UsageError
from etude.protocols import Controller, Robot
from etude_online.guard_effort import command_limits, feedback_of
from etude_online.learner import OnlineConfig
from etude_online.methods import known
from etude_online.online_model import OnlineModel

ONLINE_STREAM = 5
"""Separates the random numbers of learners on line from those of other things."""


@dataclass(frozen=True)
class OnlineLearning:
    """Controllers that go on learning (implements `campaign.simulation.Adaptation`)."""

    config: OnlineConfig

    def require(self, campaign: Campaign, robot: Robot) -> None:
        """As `Adaptation.require`."""
        require_ticks(campaign, robot)

    def controllers(self, campaign: Campaign, robot: Robot) -> Callable[[], Controller]:
        """As `Adaptation.controllers`; each begins with the newest model, anew.

        Raises:
            UsageError: as `require`, or the model cannot go on learning.
            DataError: the logs do not tell what the feedback adds, so that nothing could judge.
        """
        require_ticks(campaign, robot)
        kind, spec = campaign.kind, campaign.spec
        state = campaign.state()
        model, limits = newest_model(campaign, state), command_limits(kind, spec)
        feedback = feedback_of(ingested_logs(campaign), kind.channels(spec), kind.path, limits, spec.rate)
        number = state.trained[-1].number

        def made() -> Controller:
            frozen = kind.controller(spec, campaign.config, model)
            rng = np.random.default_rng([state.seed, number, ONLINE_STREAM])
            return OnlineModel(
                model, kind.channels(spec), frozen, limits, self.config, spec.rate, rng, feedback
            )

        return made


def online_learning(method: str) -> OnlineLearning:
    """By a method of `etude_online.methods`. UsageError: there is none of that name."""
    return OnlineLearning(OnlineConfig(known(method)))


def require_ticks(campaign: Campaign, robot: Robot) -> None:
    """UsageError: the robot takes its feedforward ahead of a run."""
    if not isinstance(robot, SupportsEachTick) or not robot.asks_each_tick:
        raise UsageError(
            f"the simulated {campaign.name} receives its feedforward before a run, so nothing is learned "
            "during it",
            next_step="Leave --online out.",
        )
