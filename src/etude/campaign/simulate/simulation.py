"""Closes the loop with a simulated robot: the same asks and tells, and tests a real robot would not allow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from etude.campaign.ingest.simulated_logs import SIMULATED
from etude.campaign.ingest.tell import tell
from etude.campaign.record.folder import ROBOT, Campaign, Say
from etude.campaign.record.proposals import stored_trajectory
from etude.campaign.record.rounds import SimulatedRound, interrupted_round
from etude.campaign.simulate.loop import CERTAIN, RUN_STREAM, Adaptation, Loop, same
from etude.errors import DataError, UsageError
from etude.logs.readers.log_file import write_log
from etude.progress import counted, part

MOST_TRIES = 4
"""Trajectories tried for each that is wanted."""
BASELINES = 0.15
"""About the part that feedback alone takes of all."""


def simulate(
    campaign: Campaign,
    rounds: int,
    engine: str = "",
    say: Say = lambda _: None,
    change: Mapping[str, float] | None = None,
    online: Adaptation | None = None,
    *,
    feedforward: bool = False,
) -> Iterator[SimulatedRound]:
    """Asks, runs and tells `rounds` trajectories, and evaluates the controller after each one.

    Trajectories are collected under the robot's own feedback, and what its kind adds (`collecting`), or with
    what was learned so far beside it. The stop rule is not heeded: who simulates wants the whole curve.
    Interrupted work is finished first; a test of a round is evaluated once. A run whose log is refused is
    given up, and another trajectory asked for.

    With a `change` the robot is another one in these rounds, and its logs are told as a person would tell
    them: the first that is noticed waits for an answer, and nothing is run after it.

    Args:
        campaign: the folder.
        rounds: trajectories to learn.
        engine: of the simulation, where the robot has several; "": its own.
        say: receives one sentence per step.
        change: as for `Robot.changed`; None: the robot is what it was.
        online: how the model of each round goes on learning in the same tests; None: it is tested as it is.
        feedforward: run the motions that teach with the newest model beside the feedback, once there is one.

    Raises:
        UsageError: the robot has no simulated plant, no such engine or change, a log waits for an answer, a
            log of the real robot was told, or nothing can be learned while the robot runs.
        DataError: too many logs were refused, or they do not tell what the feedback adds.
    """
    _check_answered(campaign)
    loop = replace(Loop.of(campaign, engine, change or {}, online), feedforward=feedforward)
    if online is not None:
        online.require(campaign, loop.robot)
    for sentence in getattr(loop.robot, "assumed", ()):  # of a stand-in that its owner did not describe
        say(sentence)
    with part(BASELINES):
        for name, controller in counted(loop.baselines.items()):
            loop.evaluate(0, same(controller), name)
    left = interrupted_round(campaign, say)
    if left is not None:  # or its tests would be missing from the curve
        loop.evaluate_round(left)
    done = 0
    for _ in range(MOST_TRIES * rounds):
        if done == rounds:
            return
        with part((1.0 - BASELINES) / rounds):
            number = loop.learned_one(say)
        if campaign.state().held:
            return
        if number is not None:
            done += 1
            yield loop.evaluate_round(number)
    if done < rounds:
        raise DataError(
            f"only {done} of {rounds} runs left a log that can be used",
            where=str(campaign.path),
            next_step=f"The feedback cannot follow: lower the limits in {ROBOT}, or leave more room.",
        )


def simulate_confirmation(
    campaign: Campaign, engine: str = "", say: Say = lambda _: None, change: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """Asks for a motion that is never trained on, runs it without and with the model in use, and tells both.

    Returns:
        what `status` says of it.

    Raises:
        UsageError: no simulated plant, or nothing was learned yet. DataError: a run cannot be used.
    """
    from etude.campaign.evaluate.confirm import ask_to_confirm
    from etude.campaign.ingest.confirmed import RUNS, confirmed
    from etude.campaign.record.deployed_model import model_in_use

    loop = Loop.of(campaign, engine, change or {}, None)
    number = ask_to_confirm(campaign, say=say).number
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    alone = next(iter(loop.baselines.values()), None)
    learned = kind.controller(spec, config, model_in_use(campaign).model)
    for run, controller in zip(RUNS, (alone, learned), strict=True):
        say(f"Running trajectory {number} on the simulated {campaign.name}, {run} the feedforward.")
        rng = np.random.default_rng([campaign.state().seed, number, RUN_STREAM])
        log = loop.tried(stored_trajectory(campaign, number), controller, rng)
        path = campaign.path / SIMULATED / f"{number:04d}.{run}.parquet"
        write_log(path, log)
        tell(campaign, path, number=number, confirm=run, accept=CERTAIN, say=say)
    return confirmed(campaign, campaign.round(number))


def _check_answered(campaign: Campaign) -> None:
    held = campaign.state().held
    if held:
        raise UsageError(
            f"log {held[0].number} waits for the answer to whether the robot has changed",
            where=str(campaign.path),
            next_step=f"etude tell {campaign.path} --changed new (or forget, or same).",
        )
