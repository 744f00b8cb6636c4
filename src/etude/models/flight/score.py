"""How well a model predicts flights that it has not seen: error, calibration and density of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.calibration import NORMAL_95
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.model import FlightModel

Array = NDArray[np.float64]

TRANSIENT_S = 5.0
"""A start from hover with a moving target dominates the error of a flight's first seconds."""


@dataclass(frozen=True)
class FlightScores:
    """Figures of each flight (F,), means over its samples and the four commands.

    Attributes:
        flight: number.
        mae: mean absolute error, command units. mae_after: the same after `TRANSIENT_S`.
        z2: mean of squared error over predicted variance; 1 is right, above 1 overconfident.
        coverage: part of the commands inside the predicted 95 % interval.
        nlpd: mean negative log density, normal, in natural units of the command's unit.
        nlpd_t: the same with the heavier tails of the held-out errors; NaN where none were fitted.
        deviation: mean predicted deviation, command units.
    """

    flight: NDArray[np.int64]
    mae: Array
    mae_after: Array
    z2: Array
    coverage: Array
    nlpd: Array
    nlpd_t: Array
    deviation: Array


def score_flights(model: FlightModel, data: FlightDataset) -> FlightScores:
    """Score of each flight in `data`. DataError without a sample."""
    if not len(data):
        raise DataError("there is no flight to score", next_step="Give at least one flight.")
    mean, variance = model.predict(data.states)
    error, deviation = data.command - mean, np.sqrt(variance)
    ratio = error / deviation
    density = -0.5 * ratio**2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)
    late = data.after(TRANSIENT_S)
    tailed = np.full_like(density, np.nan)
    if model.student is not None:
        tailed = model.student.log_density(ratio) - np.log(deviation)
    rows = []
    for number in data.flights:
        own = data.group == number
        rows.append(
            (
                np.abs(error[own]).mean(),
                np.abs(error[own & late]).mean() if (own & late).any() else np.nan,
                (ratio[own] ** 2).mean(),
                (np.abs(ratio[own]) <= NORMAL_95).mean(),
                -density[own].mean(),
                -tailed[own].mean(),
                deviation[own].mean(),
            )
        )
    return FlightScores(data.flights, *np.array(rows).T)
