"""The model of a campaign goes on learning: in simulated tests, and in a folder that leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign.folder import ROBOT, Campaign
from etude.campaign.learn import MODEL, newest_model
from etude.contracts import Controller, Log, Robot
from etude.errors import UsageError
from etude.logs.log_file import read_log_file
from etude.models.online.guard_effort import command_limits, feedback_of
from etude.models.online.learner import OnlineConfig
from etude.models.online.model import OnlineModel
from etude.storage import sha256_of, write_atomic

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


def told_logs(campaign: Campaign) -> list[Log]:
    """The logs that the model was learned from."""
    rounds = [r for r in campaign.state().learned if campaign.run_file(r.number).is_file()]
    return [read_log_file(campaign.run_file(r.number)) for r in rounds]


def description(campaign: Campaign) -> Mapping[str, bytes]:
    """Files of the robot's description by name, as the campaign was made with them."""
    created = next(event for event in campaign.events() if event.event == "created")
    return {name: (campaign.path / name).read_bytes() for name in sorted({ROBOT, *created.files})}


def supplied(campaign: Campaign, needs: Sequence[str]) -> dict[str, Any]:
    """What a target of a model asks for beside it, by name: config, logs, description."""
    known: Mapping[str, Callable[[], Any]] = {
        "config": lambda: campaign.config,
        "logs": lambda: told_logs(campaign),
        "description": lambda: description(campaign),
    }
    return {name: known[name]() for name in needs}


def export_online(
    campaign: Campaign, output: Path, learning: OnlineConfig | None = None, seed: int = 0
) -> tuple[str, ...]:
    """Writes the newest model as a folder that `deploy.runtime.open_online` opens; returns the files' names.

    Args:
        output: the folder; made if missing.
        learning: how to go on. seed: of what the learners draw.

    Raises:
        UsageError: nothing was learned yet, or the model cannot go on learning.
        DataError: the logs do not tell what the feedback adds.
        EtudeError: the folder may not be written.
    """
    from etude.deploy.online_folder import HASHES, OnlineOptions, write

    state = campaign.state()
    model, needs = newest_model(campaign, state), supplied(campaign, ("config", "logs", "description"))
    digest = sha256_of(campaign.model_folder(state.trained[-1].number) / MODEL)
    options = OnlineOptions(
        needs["description"], needs["logs"], learning or OnlineConfig(), seed=seed, model_hash=digest
    )
    files = write(model, campaign.kind, campaign.spec, needs["config"], options)
    for name in sorted(files, key=lambda name: name == HASHES):  # what was cut short has no hashes
        write_atomic(output / name, files[name])
    return tuple(files)
