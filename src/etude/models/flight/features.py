"""The feature map of a vehicle: one map from states to a model's inputs, planned and measured alike."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]
Acceleration = Literal["specific_force", "kinematic"]

SOURCES = {"specific_force": "specific_force", "kinematic": "acceleration"}


@dataclass(frozen=True)
class FlightFeatures:
    """x = [altitude, acceleration (3), rates (3), angular acceleration (3), velocity (3)].

    Thesis 5 has (h, a, omega, alpha) with a of the motion alone, which does not tell the attitude. The
    specific force does without it, and the velocity tells the drag.

    Attributes:
        altitude: whether the altitude is an input.
        acceleration: "specific_force", what an accelerometer reads; "kinematic", without gravity.
        body_velocity: whether the velocity is an input.
    """

    altitude: bool = True
    acceleration: Acceleration = "specific_force"
    body_velocity: bool = True

    def __post_init__(self) -> None:
        if self.acceleration not in SOURCES:
            raise UsageError(f"acceleration must be one of {', '.join(SOURCES)}, not {self.acceleration!r}")

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the quantities of `FlightStates` in the order of the columns."""
        first = ("altitude",) if self.altitude else ()
        last = ("velocity",) if self.body_velocity else ()
        return (*first, SOURCES[self.acceleration], "rates", "angular_acceleration", *last)

    @property
    def width(self) -> int:
        """D, the number of inputs: 9, 10, 12 or 13."""
        return sum(1 if part == "altitude" else 3 for part in self.parts)

    def transform(self, states: FlightStates) -> Array:
        """X (T, D). DataError if the states lack an input, with the option that does without it."""
        columns = []
        for name in self.parts:
            part = getattr(states, name)
            if part is None:
                raise DataError(f"the flight does not say its {name}", next_step=_WITHOUT[name])
            columns.append(part[:, None] if part.ndim == 1 else part)
        return np.concatenate(columns, axis=1)

    def pullback(self, states: FlightStates, G: Array) -> FlightStates:
        """Gradients of sum(G * transform(states)), G (T, D), in the shape of the states.

        Zero for a quantity that is no input, None for one that the states do not have.
        """
        if G.shape != (len(states), self.width):
            raise UsageError("G must be (samples, features)", where=f"G {G.shape}, D = {self.width}")
        gradients = {
            field.name: None if part is None else np.zeros(part.shape)
            for field in fields(states)
            for part in [getattr(states, field.name)]
        }
        place = 0
        for name in self.parts:
            width = 1 if name == "altitude" else 3
            block = G[:, place : place + width]
            gradients[name] = block[:, 0] if name == "altitude" else block
            place += width
        return FlightStates(**gradients)  # type: ignore[arg-type]  # the required three are never None


_WITHOUT = {
    "altitude": "Set altitude = false.",
    "velocity": "Set body_velocity = false.",
    "acceleration": 'Set acceleration = "specific_force".',
}
