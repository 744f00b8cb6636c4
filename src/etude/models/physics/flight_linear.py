"""Inverse model of a vehicle whose motors nobody described: linear least squares on physical features.

For normalised set-points and for commands that are thrust and attitude. Rotor speeds go with the root of
thrust, and moments change a root by moment / (2 root): both columns are there, the data weigh them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.physics.map_fit import map_fit
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]

OPTIONAL = ("altitude", "velocity", "acceleration")
LEAST_LIFT = 0.05
"""Parts of gravity: the root's feature stays smooth in free fall."""
HUGE = 1e300


@dataclass(frozen=True)
class LinearInverse:
    """command = offset + ((features - centre) / spread) weights.

    Attributes:
        uses: names of the optional quantities among the features.
        centre, spread: (F,) of the features in the data.
        weights: (F, 4). offset: (4,). Command units.
    """

    uses: tuple[str, ...]
    centre: Array
    spread: Array
    weights: Array
    offset: Array

    def predict(self, states: FlightStates) -> Array:
        """Commands (T, 4); DataError if the states lack a quantity that the model was identified with."""
        return self.offset + (physical_features(states, self.uses) - self.centre) / self.spread @ self.weights


def physical_features(states: FlightStates, uses: tuple[str, ...]) -> Array:
    """(T, F): specific force, root of lift, rates, products of rates, angular acceleration, those of `uses`.

    Raises:
        DataError: a quantity that `uses` names is None.
    """
    rates, alpha = states.rates, states.angular_acceleration
    root = np.sqrt(np.maximum(states.specific_force[:, 2] / GRAVITY, LEAST_LIFT))
    columns = [
        states.specific_force,
        root[:, None],
        rates,
        rates[:, [1, 2, 0]] * rates[:, [2, 0, 1]],  # ω × J ω is linear in these
        alpha,
        alpha / root[:, None],
    ]
    for name in uses:
        part = getattr(states, name)
        if part is None:
            raise DataError(
                f"the states have no {name}, which the model was identified with",
                next_step="Use flights that all have it.",
            )
        columns.append(part[:, None] if part.ndim == 1 else part)
    return np.concatenate(columns, axis=1)


def identify_linear(states: FlightStates, command: Array, weight: float = 0.2) -> LinearInverse:
    """Weights of all features that the states have, shrunk towards a constant command.

    Raises:
        DataError: no sample, or NaN in states or command.
    """
    uses = tuple(name for name in OPTIONAL if getattr(states, name) is not None)
    features = physical_features(states, uses)
    if not len(features):
        raise DataError("there is no sample to identify a model from", next_step="Tell a flight first.")
    centre, spread = features.mean(axis=0), features.std(axis=0)
    # a constant column says nothing, whatever it is later
    spread = np.where(spread > 1e-9 * (1.0 + np.abs(centre)), spread, HUGE)
    offset = command.mean(axis=0)
    scaled = (features - centre) / spread
    weights = np.column_stack([_weights(scaled, command[:, j] - offset[j], weight) for j in range(4)])
    return LinearInverse(uses, centre, spread, weights, offset)


def _weights(scaled: Array, y: Array, weight: float) -> Array:
    deviation = np.full(scaled.shape[1], max(float(y.std()), 1e-12))
    return map_fit(lambda w: ((scaled @ w)[:, None], scaled[:, None, :]), y[:, None], deviation, weight)
