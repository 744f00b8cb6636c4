"""Intended flights: a named set, at whose states the model's variance matters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.design.flight.objective import StateFeatures
from etude.errors import UsageError
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible_set import FeasibleSet
from etude.trajectories.flight.flatness import Drag, flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import uniform_parameters
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]

FLIGHTS = 20
"""Uniform flights that stand in for intended ones."""


@dataclass(frozen=True)
class IntendedFlights:
    """What the model is for.

    Attributes:
        name: for people and reports.
        flights: each counts alike.
    """

    name: str
    flights: tuple[FourierTrajectory, ...]

    def __post_init__(self) -> None:
        if not self.flights:
            raise UsageError(f"the set of intended flights '{self.name}' is empty")


def uniform_intended(
    rng: np.random.Generator, feasible: FeasibleSet, family: FlightFamily, count: int = FLIGHTS
) -> IntendedFlights:
    """The set to fall back on: flights drawn uniformly from all feasible ones."""
    points = uniform_parameters(rng, feasible, count)
    return IntendedFlights("uniform feasible flights", tuple(family.trajectory(point) for point in points))


def flight_reference(
    rng: np.random.Generator,
    features: StateFeatures,
    intended: IntendedFlights,
    count: int,
    drag: Drag = (0.0, 0.0, 0.0),
) -> Array:
    """About `count` model inputs (r, D), evenly over the flights and, from a random start, over time.

    Raises:
        UnsafeTrajectoryError: an intended flight with a singular attitude.
    """
    each = max(1, round(count / len(intended.flights)))
    inputs = []
    for flight in intended.flights:
        t = flight.duration * (np.arange(each) + rng.uniform()) / each
        inputs.append(features.transform(flat_motion(motion_of(flight, t), drag).states))
    return np.concatenate(inputs)
