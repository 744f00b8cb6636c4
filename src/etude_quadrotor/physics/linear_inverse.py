"""Linear inverse model of a vehicle with unknown motors: least squares on physical features.

For normalised set-points and for commands of thrust and attitude. Rotor speeds are proportional to the root
of thrust, and moments change a root by moment / (2 root). Both are features, weighted by the data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from etude._runtime.operators import Piece
from etude.errors import DataError
from etude.types import Array, Code, Column, Log, Mask
from etude_quadrotor.channels import STATES, hovering
from etude_quadrotor.vehicle import GRAVITY

OPTIONAL = ("altitude", "body_velocity", "body_acceleration")
LEAST_LIFT = 0.05
"""Parts of gravity: the root's feature stays smooth in free fall."""
HUGE = 1e300  # a column that never changes gets the weight zero


@dataclass(frozen=True)
class LinearInverse:
    """command = offset + ((features - centre) / spread) weights. A `protocols.Mean`.

    Attributes:
        uses: names of the optional channels among the features.
        centre, spread: (F,) of the features in the data.
        weights: (F, n). offset: (n,). Command units.
    """

    uses: tuple[str, ...]
    centre: Array
    spread: Array
    weights: Array
    offset: Array

    @property
    def columns(self) -> tuple[Column, ...]:
        """Channels of `uses`, which the inputs of a model need not contain."""
        used = (channel for channel in STATES if channel.name in self.uses)
        return tuple(
            (c.name, part, unit, "") for c in used for part, unit in zip(c.parts, c.units, strict=True)
        )

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """None that has a physical meaning."""
        return {}

    def arrays(self) -> Mapping[str, Array]:
        """Arrays of the model; `uses` as 0 or 1 for each of `OPTIONAL`."""
        uses = np.array([float(name in self.uses) for name in OPTIONAL])
        parameters = {name: getattr(self, name) for name in ("centre", "spread", "weights", "offset")}
        return {"uses": uses, **parameters}

    def predict(self, log: Log) -> Array:
        """Commands (T, n); DataError if the log lacks a quantity that the model was identified with."""
        return self.offset + (physical_features(log, self.uses) - self.centre) / self.spread @ self.weights

    def static(self, log: Log) -> Array:
        """Commands (T, n) that would hold the vehicle where it is."""
        return self.predict(hovering(log))

    def c(self, name: str) -> Code:
        """C99 of it."""
        from etude_quadrotor.c99 import features_code

        return features_code(name, self, LEAST_LIFT)

    def onnx(self) -> Piece:
        """In operators of ONNX."""
        from etude_quadrotor.onnx import features_piece

        return features_piece(self, LEAST_LIFT)


def physical_features(log: Log, uses: tuple[str, ...]) -> Array:
    """(T, F): specific force, root of lift, rates, products of rates, angular acceleration, those of `uses`.

    Raises:
        DataError: the log lacks a channel that `uses` names.
    """
    force, rates, alpha = log["specific_force"], log["rates"], log["angular_acceleration"]
    root = np.sqrt(np.maximum(force[:, 2] / GRAVITY, LEAST_LIFT))
    columns = [
        force,
        root[:, None],
        rates,
        rates[:, [1, 2, 0]] * rates[:, [2, 0, 1]],  # ω × J ω is linear in these
        alpha,
        alpha / root[:, None],
    ]
    for name in uses:
        if name not in log:
            raise DataError(
                f"the flight lacks its {name}, which the identified model needs",
                next_step="Use only flights that have it.",
            )
        columns.append(log[name])
    return np.concatenate(columns, axis=1)


def identify_linear(log: Log, weight: float = 0.2, use: Mask | None = None) -> LinearInverse:
    """Weights of all features that the states have, shrunk towards a constant command.

    Args:
        weight: of one sample against the prior. use: (T, n) informative commands; None: all.

    Raises:
        DataError: no sample, or NaN in states or command.
    """
    command, every = log["command"], np.ones(log["command"].shape, dtype=np.bool_)
    count = command.shape[1]
    use = every if use is None else use
    uses = tuple(name for name in OPTIONAL if name in log)
    features = physical_features(log, uses)
    if not len(features) or not use.any(axis=0).all():
        raise DataError("there is no sample to identify a model from", next_step="Ingest a flight first.")
    centre, spread = features.mean(axis=0), features.std(axis=0)
    # a constant column is not informative, whatever its later values
    spread = np.where(spread > 1e-9 * (1.0 + np.abs(centre)), spread, HUGE)
    offset = np.array([command[use[:, j], j].mean() for j in range(count)])
    scaled = (features - centre) / spread
    columns = [_weights(scaled[use[:, j]], command[use[:, j], j] - offset[j], weight) for j in range(count)]
    return LinearInverse(uses, centre, spread, np.column_stack(columns), offset)


Linearised = Callable[[Array], tuple[Array, Array]]

STEPS = 6  # of noise and weights in turn
LEAST_VARIANCE = 1e-12
"""Of the residual, as a part of the commands' mean square: below it the data agree to rounding."""


TOLD = 0.99
"""A posterior deviation above this part of the prior's means that the data are not informative."""


def map_fit(
    linearised: Linearised, command: Array, deviation: Array, weight: float, use: Mask | None = None
) -> tuple[Array, Array]:
    """Coefficients (P,) that maximise the posterior density, by Gauss-Newton steps from 0; their deviations.

    A deviation is infinite if the data are not informative.

    The residual's variance is estimated along the way; coefficients are N(0, deviation²).

    Args:
        linearised: coefficients (P,) -> predictions (n, m) and their derivative (n, m, P).
        command: (n, m) what is to be predicted.
        deviation: (P,) of the prior.
        weight: votes of one sample.
        use: (n, m) which commands say something; None: all.

    Raises:
        DataError: no sample, or values that are not finite.
    """
    theta, normal = np.zeros(len(deviation)), np.eye(len(deviation))
    every = use is None or bool(use.all())
    target = command if every else command[use]
    if not target.size:
        raise DataError("there is no sample to identify a model from", next_step="Ingest a flight first.")
    for _ in range(STEPS):
        predicted, jacobian = linearised(theta)
        if not every:
            predicted, jacobian = predicted[use], jacobian[use]
        residual = target - predicted
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            raise DataError(
                "states or commands contain NaN or infinite values", next_step="Repair the log first."
            )
        # 1e-300: commands that are all zero have a residual of zero too
        variance = max(float(np.mean(residual**2)), LEAST_VARIANCE * float(np.mean(target**2)), 1e-300)
        J = jacobian.reshape(-1, len(theta)) * deviation  # every coefficient in units of its prior deviation
        normal = weight / variance * (J.T @ J) + np.eye(len(theta))
        slope = weight / variance * (J.T @ residual.ravel()) - theta / deviation
        theta = theta + deviation * np.linalg.solve(normal, slope)
    left = deviation * np.sqrt(np.diag(np.linalg.inv(normal)))
    return theta, np.where(left > TOLD * deviation, np.inf, left)


def _weights(scaled: Array, y: Array, weight: float) -> Array:
    # a command that never changes has a narrow prior, and not one of width zero
    deviation = np.full(scaled.shape[1], max(float(y.std()), 1e-12))
    return map_fit(lambda w: ((scaled @ w)[:, None], scaled[:, None, :]), y[:, None], deviation, weight)[0]
