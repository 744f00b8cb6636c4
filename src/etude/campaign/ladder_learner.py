"""Learning with the model ladder: every model is scored on the log it has not seen, then all are trained."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.folder import Campaign
from etude.campaign.ladder_files import load_models, save_models
from etude.campaign.learner import Learned
from etude.campaign.outlook import outlook
from etude.campaign.plain import numbers
from etude.campaign.state import State
from etude.logs.parquet import read_parquet
from etude.models.blocks import COUNT, held_out_blocks, linear_regression, split_blocks
from etude.models.calibration import Score, score
from etude.models.dataset import Dataset, concatenate
from etude.models.ladder import Ladder, train_ladder
from etude.models.preprocess import build_dataset

Array = NDArray[np.float64]
TRAIN_STREAM = 2
"""Separates the random numbers of training from those of asking and testing."""


def learn_ladder(campaign: Campaign, state: State, number: int) -> Learned:
    """Scores the newest models on log `number`, then trains on all logs told (implements `Learner`)."""
    trained = state.trained
    before = load_models(campaign.model_folder(trained[-1].number)) if trained else {}
    new = _dataset(campaign, number)
    waiting = [r.number for r in state.pending if r.number < number]
    logs = [*(r.number for r in trained), *waiting, number]
    # the ladder takes the highest group for the newest, whatever the order in which logs arrive
    parts = [_grouped(campaign, n, order) for order, n in enumerate(logs)]
    rng = np.random.default_rng([state.seed, number, TRAIN_STREAM])
    ladder = train_ladder(concatenate(parts), campaign.spec, campaign.config.model, rng, previous=before)
    scores: dict[str, Score] = {**ladder.scores} if before else {}
    if len(parts) > 1:  # the least that every model has to beat, fitted to the same logs
        linear = linear_regression(concatenate(parts[:-1]), new)
        scores["linear"] = score(new.tau, linear, None, ~new.stuck)
    files = save_models(campaign.model_folder(number), ladder.models, ladder.chosen)
    told = [r.told for r in state.told if r.told and r.number in logs]
    facts: dict[str, Any] = {
        "logs": logs,
        "models": {kind: _plain(s) for kind, s in scores.items()},
        "predicted_by": trained[-1].trained["chosen"] if trained and trained[-1].trained else None,
        "chosen": ladder.chosen,
        "robot_seconds": float(sum(t["robot_seconds"] for t in told)),
        "warnings": list(ladder.model.warnings(campaign.spec.names)),
        **outlook(ladder.models[ladder.chosen], before.get(ladder.chosen), campaign, state),
    }
    this = state.rounds[number].told or {}
    if this.get("foreign"):
        facts["held_out"] = held_out(campaign, new, rng)
    return Learned(files, facts)


def held_out(campaign: Campaign, log: Dataset, rng: np.random.Generator) -> dict[str, Any]:
    """nMSE per axis on held-out blocks of one log, of each model and of linear regression."""
    train, test = split_blocks(log)
    ladder: Ladder = train_ladder(train, campaign.spec, campaign.config.model, rng)
    moving = ~test.stuck
    nmse: dict[str, list[float | None]] = {}
    for kind, model in ladder.models.items():
        nmse[kind] = _nmse(test.tau, model.predict(test.q, test.qd, test.qdd)[0], moving)
    nmse["linear regression"] = _nmse(test.tau, linear_regression(train, test), moving)
    return {"blocks": list(held_out_blocks()), "of": COUNT, "chosen": ladder.chosen, "nmse": nmse}


def _grouped(campaign: Campaign, number: int, group: int) -> Dataset:
    dataset = _dataset(campaign, number)
    return replace(dataset, group=np.full(len(dataset), group, dtype=np.int64))


def _dataset(campaign: Campaign, number: int) -> Dataset:
    log = read_parquet(campaign.run_file(number))
    return build_dataset(log, campaign.spec, campaign.config.data, group=number)


def _nmse(tau: Array, mean: Array, moving: NDArray[np.bool_]) -> list[float | None]:
    return numbers(score(tau, mean, None, moving).nmse)


def _plain(found: Score) -> dict[str, list[float | None]]:
    return {name: numbers(getattr(found, name)) for name in ("nmse", "z2", "coverage")}
