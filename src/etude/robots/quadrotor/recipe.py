"""From a recorded flight to the samples a model learns from: lag, rate and trimming."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.errors import UsageError
from etude.logs.derivatives import median_rate
from etude.logs.flight.lag import command_lag, without_lag
from etude.logs.flight.log import FlightLog
from etude.logs.flight.sampling import sampled_flight
from etude.models.flight.dataset import FlightDataset, flight_dataset
from etude.robots.flight_spec import FlightSpec
from etude.trajectories.flight.states import join_states

FAST = 2.0
"""Samples of the log per sample of the model from which a lag can be told: of slow flights, at 10 Hz, single
logs gave 0 to 200 ms for a vehicle that has 50."""


@dataclass(frozen=True)
class FlightDataConfig:
    """How a flight becomes a data set.

    Attributes:
        averaged: samples are means over their interval, so that noise does not fold in; False takes single
            samples (the thesis).
        lag_s: how far the motion lags behind the commands, s; "auto" measures it in logs at least
            `FAST` times the model's rate, and takes 0 where there is none.
        first_s, last_s: trimmed from both ends, s.
    """

    averaged: bool = True
    lag_s: float | Literal["auto"] = "auto"
    first_s: float = 0.0
    last_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("lag_s", "first_s", "last_s"):
            value = getattr(self, name)
            if value == "auto" and name == "lag_s":
                continue
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} must be a number of seconds, 0 or more, not {value!r}", where=name)


FLIGHT_DATA = {"default": FlightDataConfig(), "thesis": FlightDataConfig(averaged=False, lag_s=0.0)}


def build_flight_dataset(
    log: FlightLog, spec: FlightSpec, config: FlightDataConfig, group: int = 0
) -> FlightDataset:
    """The samples of one flight at the vehicle's model rate.

    Raises:
        DataError: nothing is left, NaN, or commands that say nothing (see `flight_dataset`).
    """
    lag = common_lag([log], spec, config)
    sampled = sampled_flight(without_lag(log, lag), spec.rate, averaged=config.averaged)
    return flight_dataset([sampled], spec, first_s=config.first_s, last_s=config.last_s, numbers=[group])


def common_lag(logs: Sequence[FlightLog], spec: FlightSpec, config: FlightDataConfig) -> float:
    """Seconds by which the vehicle lags behind its commands, from all its flights together."""
    if config.lag_s != "auto":
        return config.lag_s
    return command_lag(*(log for log in logs if median_rate(log.t) >= FAST * spec.rate))


def joined(parts: Sequence[FlightDataset]) -> FlightDataset:
    """Several flights as one data set; groups are kept as they are."""
    return FlightDataset(
        states=join_states([part.states for part in parts]),
        command=np.concatenate([part.command for part in parts]),
        group=np.concatenate([part.group for part in parts]),
        t=np.concatenate([part.t for part in parts]),
        command_unit=parts[0].command_unit,
    )
