"""What the kinds of one round learn from: choice of samples, physics, and what is held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.calibration import contiguous_blocks, inflation
from etude.models.flight.config import FlightKind, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.physics.flight_inverse import FlightPhysics, identify_vehicle, nominal_inverse
from etude.models.physics.flight_linear import identify_linear
from etude.models.selection import spread_points
from etude.robots.vehicle import Vehicle

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK_S = 5.0
"""With a single flight, stretches of this length are held out instead of whole flights."""
CORRELATION_S = 0.5
"""Samples nearer than this share one vote in the identification."""


@dataclass(frozen=True)
class HeldOut:
    """Samples, each predicted from the other flights (of a single one: from its other stretches).

    Attributes:
        error: (n, 4) command minus prediction, command units.
        variance: (n, 4) predicted, noise included, before calibration.
        group: (n,) what each sample was held out with.
    """

    error: Array
    variance: Array
    group: Index

    def mae(self) -> Array:
        """Mean absolute error of each group, over the commands, (groups,)."""
        return np.array([np.abs(self.error[self.group == g]).mean() for g in np.unique(self.group)])

    def scale(self) -> Array:
        """(4,) factors that make the variances cover the errors, never below 1."""
        return np.array([inflation(float(z2)) for z2 in np.mean(self.error**2 / self.variance, axis=0)])

    def density(self, scale: Array) -> float:
        """Mean log density, up to a constant, with the variances times `scale` (4,)."""
        used = scale * self.variance
        return -0.5 * float(np.mean(np.log(used) + self.error**2 / used))


@dataclass(frozen=True)
class Lesson:
    """What all kinds of one round learn from.

    Attributes:
        data: all flights. kept: positions that processes are conditioned on, and that are held out.
        chosen: positions that hyperparameters are fitted to.
        fold: (n,) number of what each sample is held out with.
        vehicle: whose motors explain the commands; None if nobody described it.
        trims: see `FlightModelConfig`.
    """

    data: FlightDataset
    kept: Index
    chosen: Index
    fold: Index
    vehicle: Vehicle | None
    trims: bool


def lesson(
    data: FlightDataset, vehicle: Vehicle | None, config: FlightModelConfig, rng: np.random.Generator
) -> Lesson:
    """The choice of samples. DataError without any."""
    if not len(data):
        raise DataError("there is no flight to learn from", next_step="Fly one and tell its log.")
    every = np.ones(len(data), dtype=np.bool_)
    first = data.group == data.group.min() if config.hyperparameters == "first_flight" else every
    kept = spread_points(data, every, config.points, 0.0, rng)
    chosen = spread_points(data, first, config.fit_points, config.fit_spacing_s, rng)
    single = len(data.flights) == 1
    fold = contiguous_blocks(data.t, data.group, BLOCK_S) if single else data.group
    return Lesson(data, kept, chosen, fold, vehicle if data.command_unit == "V" else None, config.trims)


def fitted_physics(lesson: Lesson, kind: FlightKind) -> tuple[FlightPhysics, dict[int, FlightPhysics]]:
    """The analytic model of a kind, and one for each fold that has not seen it.

    Kind "gp" gets the identified one, to be held against. UsageError: "nominal" without a vehicle.
    """
    numbers = [int(number) for number in np.unique(lesson.fold)]
    if kind.startswith("nominal"):
        if lesson.vehicle is None:
            raise UsageError(
                "there is no nominal model: the vehicle's motors are unknown, or commands are not in V",
                next_step="Describe the vehicle, or use kind = 'identified'.",
            )
        nominal = nominal_inverse(lesson.vehicle)
        return nominal, dict.fromkeys(numbers, nominal)
    every = np.ones(len(lesson.data), dtype=np.bool_)
    model = _identify(lesson, every)
    if len(numbers) == 1:
        return model, {numbers[0]: model}
    return model, {number: _identify(lesson, lesson.fold != number) for number in numbers}


def _identify(lesson: Lesson, use: NDArray[np.bool_]) -> FlightPhysics:
    data = lesson.data.take(use)
    steps = np.diff(data.t)[np.diff(data.group) == 0]
    weight = min(1.0, float(np.median(steps)) / CORRELATION_S) if len(steps) else 1.0
    if lesson.vehicle is None:
        return identify_linear(data.states, data.command, weight)
    return identify_vehicle(lesson.vehicle, data.states, data.command, weight, trims=lesson.trims)


def physics_held_out(lesson: Lesson, folds: dict[int, FlightPhysics]) -> HeldOut:
    """The kept samples, predicted by physics that have not seen their fold; one variance for each command."""
    data, fold = lesson.data.take(lesson.kept), lesson.fold[lesson.kept]
    error = np.empty_like(data.command)
    for number in np.unique(fold):
        own = fold == number
        error[own] = data.command[own] - folds[int(number)].predict(data.states.take(own))
    squared = np.maximum(np.mean(error**2, axis=0), np.finfo(float).tiny)
    return HeldOut(error, np.tile(squared, (len(error), 1)), fold)
