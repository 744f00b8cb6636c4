"""The model of a campaign goes on learning: in simulated tests, and in a folder that leaves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from etude.campaign.folder import Campaign
from etude.campaign.stored import newest_model
from etude.campaign.supplied import told_logs
from etude.contracts import Controller, Robot
from etude.errors import UsageError
from etude.models.online.guard_effort import command_limits, feedback_of
from etude.models.online.learner import OnlineConfig
from etude.models.online.model import OnlineModel

ONLINE_STREAM = 5
"""Separates the random numbers of learners on line from those of other things."""


def learning(campaign: Campaign, robot: Robot, config: OnlineConfig) -> Callable[[], Controller]:
    """Makes controllers that begin with the newest model and go on learning, each anew.

    Raises:
        UsageError: as `require_ticks`, or the model cannot go on learning.
        DataError: the logs do not tell what the feedback adds, so that nothing could judge.
    """
    require_ticks(campaign, robot)
    kind, spec = campaign.kind, campaign.spec
    state = campaign.state()
    model, limits = newest_model(campaign, state), command_limits(kind, spec)
    feedback = feedback_of(told_logs(campaign), kind.channels(spec), kind.path, limits, spec.rate)
    number = state.trained[-1].number

    def made() -> Controller:
        frozen = kind.controller(spec, campaign.config, model)
        rng = np.random.default_rng([state.seed, number, ONLINE_STREAM])
        return OnlineModel(model, kind.channels(spec), frozen, limits, config, spec.rate, rng, feedback)

    return made


def require_ticks(campaign: Campaign, robot: Robot) -> None:
    """UsageError: the robot takes its feedforward ahead of a run."""
    if not getattr(robot, "asks_each_tick", False):
        raise UsageError(
            f"the simulated {campaign.name} takes its feedforward before a run, so nothing is learned in it",
            next_step="Leave --online out.",
        )
