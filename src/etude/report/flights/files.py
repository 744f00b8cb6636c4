"""What a flying campaign's folder holds, read; and what its models say of what was flown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from etude.campaign.config_file import load_config
from etude.campaign.journal import Event
from etude.errors import DataError
from etude.models.flight.config import PHYSICS_KINDS
from etude.models.flight.preprocess import build_flight_dataset
from etude.report.record import Record
from etude.robots.flight_spec import FlightSpec

if TYPE_CHECKING:
    from etude.logs.flight.log import FlightLog
    from etude.models.flight.model import FlightModel
    from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Forecast:
    """A flight at the model's rate, beside what a model says of it.

    Attributes:
        t: (T,) s since the flight began.
        position: (T, 3) m, or None where the log has none.
        command, mean: (T, 4) measured and predicted.
        deviation: (T, 4) predicted, of the commands.
        spread: (T,) mean over the commands of what a process does not know, which varies along every flight.
    """

    t: Array
    position: Array | None
    command: Array
    mean: Array
    deviation: Array
    spread: Array


def flight_spec(record: Record) -> FlightSpec | None:
    return record.spec.flight if record.spec else None


def told_flight(record: Record, number: int) -> FlightLog | None:
    """The cleaned log of flight `number`."""
    from etude.logs.flight.parquet import read_flight_parquet

    return record.read(f"runs/{number:04d}.parquet", read_flight_parquet)


def tested_flight(record: Record, test: str, baseline: str | None) -> tuple[Event, FlightLog] | None:
    """The newest run of a test, of a baseline or with what was learned (None)."""
    from etude.logs.flight.parquet import read_flight_parquet

    return record.test_run(baseline, read_flight_parquet, test)


def flight_model(record: Record, number: int) -> FlightModel | None:
    """The model in use after round `number`."""
    from etude.models.flight.model_file import load_flight_model

    return record.read(f"models/{number:04d}", load_flight_model)


def forecast(record: Record, model: FlightModel, log: FlightLog) -> Forecast:
    """What `model` predicts for a flight.

    Raises:
        EtudeError: campaign.toml is unreadable or of another kind, or the log does not fit the model.
    """
    spec, (config, _) = flight_spec(record), load_config(record.folder)
    if spec is None or config.flight is None:
        raise DataError("the folder does not describe a vehicle", where=str(record.folder))
    data = build_flight_dataset(log, spec, config.flight.data)
    mean, variance = model.predict(data.states)
    places = None
    if log.position is not None:
        columns = [np.interp(data.t, log.t - log.t[0], column) for column in log.position.T]
        places = np.stack(columns, axis=1)
    deviation = np.sqrt(np.maximum(variance, 0.0))
    return Forecast(data.t, places, data.command, mean, deviation, _spread(model, data.states, deviation))


def _spread(model: FlightModel, states: FlightStates, deviation: Array) -> Array:
    """Mean deviation over the commands; of the processes where the physics state one for all motions."""
    if model.kind not in PHYSICS_KINDS:
        return np.asarray(deviation.mean(axis=1))
    X = model.features.transform(states)
    parts = [
        np.repeat((p.predict(X)[1] + p.noise_variance)[:, None], len(p.outputs), axis=1)
        for p in model.processes
    ]
    own = model.deviation * np.sqrt(model.scale * np.concatenate(parts, axis=1))
    return np.asarray(own.mean(axis=1))
