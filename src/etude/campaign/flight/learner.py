"""Learning flights: every model is scored on the flight it has not seen, then all are trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.flight.outlook import flight_outlook
from etude.campaign.folder import Campaign
from etude.campaign.learner import Learned
from etude.campaign.plain import numbers
from etude.campaign.state import State
from etude.logs.flight.parquet import read_flight_parquet
from etude.models.calibration import score
from etude.models.flight.config import FLIGHT_KINDS, FlightKind, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.drag import train_drag
from etude.models.flight.ladder import FlightLadder, train_flight_ladder
from etude.models.flight.model import FlightModel
from etude.models.flight.model_file import FILES, load_flight_model, save_flight_model
from etude.models.flight.preprocess import build_flight_dataset, common_lag, joined
from etude.models.physics.flight_linear import identify_linear

Array = NDArray[np.float64]
TRAIN_STREAM = 2
"""Separates the random numbers of training from those of asking and testing."""


def learn_flights(campaign: Campaign, state: State, number: int) -> Learned:
    """Scores the newest models on flight `number`, then trains on all flights told (see `Learner`)."""
    trained = state.trained
    before = load_flight_models(campaign.model_folder(trained[-1].number)) if trained else {}
    waiting = [r.number for r in state.pending if r.number < number]
    logs = [*(r.number for r in trained), *waiting, number]
    data, lag = told_flights(campaign, logs)
    flight, newest = campaign.config.flight, data.group == len(logs) - 1
    assert flight is not None
    config = flight.model.suited_to(data.states)
    # a model with an input that no longer every flight tells has nothing to say of the new one
    before = {kind: model for kind, model in before.items() if model.features == config.features()}
    scores: dict[str, Mapping[str, list[float | None]]] = {
        kind: _score(model, data.take(newest)) for kind, model in before.items()
    }
    if len(logs) > 1:
        scores["linear"] = _linear_score(data.take(~newest), data.take(newest))
    rng = np.random.default_rng([state.seed, number, TRAIN_STREAM])
    vehicle = None if campaign.spec.flight is None else campaign.spec.flight.vehicle
    ladder = train_flight_ladder(data, vehicle, config, rng, previous=before)
    files = _save(campaign.model_folder(number), ladder)
    told = [r.told for r in state.told if r.told and r.number in logs]
    facts: dict[str, Any] = {
        "logs": logs,
        "models": scores,
        "held_out_mae": {kind: ladder.error(kind) for kind in ladder.models},
        "predicted_by": trained[-1].trained["chosen"] if trained and trained[-1].trained else None,
        "chosen": ladder.chosen,
        "calibrated": ladder.model.calibrated,
        "robot_seconds": float(sum(t["robot_seconds"] for t in told)),
        "drag": drag_of(data),
        "lag_s": lag,
        "warnings": _without(flight.model, config),
        **flight_outlook(ladder.model, before.get(ladder.chosen), campaign, state, drag_of(data)),
    }
    return Learned(files, facts)


def told_flights(campaign: Campaign, numbers: Sequence[int]) -> tuple[FlightDataset, float]:
    """The samples of stored flights, groups in their order, and the lag in s that they were corrected by.

    A quantity that one flight lacks is left out of all. The lag is the vehicle's: all flights measure it.
    """
    flight, spec = campaign.config.flight, campaign.spec.flight
    assert flight is not None
    assert spec is not None
    logs = [read_flight_parquet(campaign.run_file(number)) for number in numbers]
    lag = common_lag(logs, spec, flight.data)
    config = replace(flight.data, lag_s=lag)
    return joined([build_flight_dataset(log, spec, config, group) for group, log in enumerate(logs)]), lag


def _without(asked: FlightModelConfig, used: FlightModelConfig) -> list[str]:
    """A sentence if inputs that were asked for are missing."""
    names = {"altitude": "altitude", "body_velocity": "velocity"}
    missing = [words for name, words in names.items() if getattr(asked, name) != getattr(used, name)]
    if not missing:
        return []
    return [f"Not every flight tells its {' and '.join(missing)}; the model does without."]


def drag_of(data: FlightDataset) -> list[float]:
    """Linear drag (dx, dy, 0) in 1/s that the flights show; zeros where they do not say their velocity."""
    if data.states.velocity is None:
        return [0.0, 0.0, 0.0]
    return list(train_drag(data, process=False).coefficients)


def load_flight_models(folder: Path) -> dict[FlightKind, FlightModel]:
    """Every model of the round, by kind."""
    places = {kind: folder / kind for kind in FLIGHT_KINDS}
    return {kind: load_flight_model(at) for kind, at in places.items() if (at / FILES.words).exists()}


def load_chosen(folder: Path) -> FlightModel:
    """The model in use."""
    return load_flight_model(folder)


def _save(folder: Path, ladder: FlightLadder) -> list[Path]:
    """Every model in a folder of its kind, the chosen one in `folder` itself as well, last."""
    places = [*((model, folder / kind) for kind, model in ladder.models.items()), (ladder.model, folder)]
    for model, place in places:
        save_flight_model(model, place)
    return [path for _, place in places for path in sorted(place.glob("flight_model.*"))]


def _score(model: FlightModel, data: FlightDataset) -> Mapping[str, list[float | None]]:
    return _plain(data, *model.predict(data.states))


def _linear_score(known: FlightDataset, new: FlightDataset) -> Mapping[str, list[float | None]]:
    """What every model has to beat, fitted to the same flights."""
    return _plain(new, identify_linear(known.states, known.command).predict(new.states), None)


def _plain(data: FlightDataset, mean: Array, variance: Array | None) -> Mapping[str, list[float | None]]:
    found = score(data.command, mean, variance, np.ones(data.command.shape, dtype=np.bool_))
    return {name: numbers(getattr(found, name)) for name in ("nmse", "z2", "coverage")}
