"""A criterion as a function of a flight's parameters, through flatness, with its exact gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from etude.design.criteria import Criterion, Output, evaluate, value_of
from etude.models.contracts import Posterior
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.flatness import Drag, FlatMotion, flat_motion
from etude.trajectories.flight.motion import FlightMotion, motion_rows
from etude.trajectories.flight.states import FlightStates

Array = NDArray[np.float64]


class StateFeatures(Protocol):
    """A map from states to model inputs, for planned and measured samples alike."""

    def transform(self, states: FlightStates) -> Array:
        """X (T, D)."""
        ...

    def pullback(self, states: FlightStates, G: Array) -> FlightStates:
        """Gradients of sum(G * transform(states)) in each field, G (T, D); None where there is none."""
        ...


class FlightDesignModel(Protocol):
    """What a design asks of an inverse model of a vehicle."""

    @property
    def features(self) -> StateFeatures: ...

    @property
    def posteriors(self) -> Sequence[Posterior]:
        """One Gaussian process per command, or one for all."""
        ...


@dataclass(frozen=True)
class FlightObjective:
    """value(parameters) to be maximised.

    Attributes:
        criterion: see `criteria`.
        outputs: the model's processes with their reference states.
        features: the model's feature map.
        family: which flights the parameters choose from.
        times: (T,) s, the planned samples.
        drag: (dx, dy, dz) 1/s that the plan's attitude counts with.
    """

    criterion: Criterion
    outputs: tuple[Output, ...]
    features: StateFeatures
    family: FlightFamily
    times: Array
    drag: Drag = (0.0, 0.0, 0.0)

    @cached_property
    def _rows(self) -> tuple[Array, ...]:
        return motion_rows(self.times, self.family.harmonics, self.family.frequency)

    @cached_property
    def _gains(self) -> Array:
        return np.ones((len(self.times), len(self.outputs)))

    def flat(self, parameters: Array) -> FlatMotion:
        """The flight at the planned samples. Singular ones are not refused here: the limits exclude them."""
        table = self.family.coefficients(parameters)
        motion = FlightMotion(self.times, *(row @ table for row in self._rows))
        return flat_motion(motion, self.drag, check=False)

    def inputs(self, parameters: Array) -> Array:
        """Model inputs X (T, D) along the flight."""
        return self.features.transform(self.flat(parameters).states)

    def value(self, parameters: Array) -> float:
        """The criterion alone."""
        return value_of(self.criterion, self.outputs, self.inputs(parameters), self._gains)

    def value_and_gradient(self, parameters: Array) -> tuple[float, Array]:
        """Value and gradient (P,): inputs -> states -> derivatives of position -> coefficients."""
        flat = self.flat(parameters)
        X = self.features.transform(flat.states)
        value, in_X, _ = evaluate(self.criterion, self.outputs, X, self._gains)
        pulled = flat.pullback(self.features.pullback(flat.states, in_X))
        table = sum(row.T @ part for row, part in zip(self._rows, pulled, strict=True))
        return value, self.family.pull(np.asarray(table))
