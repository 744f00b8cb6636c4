"""Training one inverse model of a vehicle, and predicting every flight from the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.calibration import contiguous_blocks, inflation
from etude.models.flight_config import LEAST_FLIGHTS, PHYSICS_KINDS, FlightKind, FlightModelConfig
from etude.models.flight_dataset import FlightDataset
from etude.models.flight_model import FlightModel
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import SquaredExponential
from etude.models.gp.shared_exact import (
    SharedPosterior,
    condition_shared,
    fit_shared,
    initial_shared,
    shared_weak_prior,
)
from etude.models.physics.flight_inverse import FlightPhysics, identify_vehicle, nominal_inverse
from etude.models.physics.flight_linear import identify_linear
from etude.models.selection import spread_points
from etude.models.student_t import fit_student
from etude.robots.vehicle import Vehicle

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK_S = 5.0
"""With a single flight, stretches of this length are held out instead of whole flights."""
CORRELATION_S = 0.5
"""Samples nearer than this share one vote in the identification."""
WITH_PROCESS: dict[FlightKind, FlightKind] = {"nominal": "nominal+gp", "identified": "identified+gp"}
LENGTH_FACTORS = (1.0, 3.0, 1.0 / 3.0, 10.0, 0.1)
"""Starts of a training: half ranges of the inputs as lengths, times these."""


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


def train_process(
    lesson: Lesson,
    kind: FlightKind,
    config: FlightModelConfig,
    physics: FlightPhysics,
    folds: dict[int, FlightPhysics],
    previous: FlightModel | None = None,
) -> tuple[FlightModel, HeldOut]:
    """A model of `kind` with its processes, and what they say of each flight without having seen it.

    Held-out targets of a residual are those of physics that have not seen the flight either: the processes
    are conditioned on all flights once, and predict each from the others in closed form.
    """
    data, kept = lesson.data, lesson.kept
    X = config.features().transform(data.states)
    residual = kind != "gp"
    target = data.command - physics.predict(data.states) if residual else data.command
    keeps = config.hyperparameters == "first_flight" and previous is not None and _fits(previous, config)
    if keeps:
        assert previous is not None
        offset, deviation = previous.offset, previous.deviation
        trained = [_process_of(process) for process in previous.processes]
    else:
        base = lesson.chosen if config.hyperparameters == "first_flight" else kept
        offset, deviation = _standard(target[base])
        Y = (target[lesson.chosen] - offset) / deviation
        trained = _trained(config, X[lesson.chosen], Y, previous)
    Y = (target[kept] - offset) / deviation
    columns = [np.arange(4)] if config.kernel == "shared" else [np.array([j]) for j in range(4)]
    processes = tuple(
        condition_shared(gp, X[kept], Y[:, own]) for gp, own in zip(trained, columns, strict=True)
    )
    held = _held_out(lesson, processes, offset, deviation, folds if residual else None)
    scale = held.scale() if config.calibrate else np.ones(4)
    many = len(data.flights) >= LEAST_FLIGHTS
    model = FlightModel(
        kind=kind,
        features=config.features(),
        processes=processes,
        offset=offset,
        deviation=deviation,
        scale=scale,
        calibrated=config.calibrate and many,
        physics=physics,
        physics_variance=physics_held_out(lesson, folds).variance[0],
        student=fit_student(held.error / np.sqrt(scale * held.variance)) if config.student_t else None,
    )
    return model, held


def _standard(target: Array) -> tuple[Array, Array]:
    """Mean and deviation (4,) of the outputs; one that never changes is as uncertain as the others."""
    deviation = target.std(axis=0)
    constant = deviation <= 1e-12 * (1.0 + np.abs(target).max(axis=0))
    fallback = float(deviation[~constant].max()) if not constant.all() else 1.0
    return target.mean(axis=0), np.where(constant, fallback, deviation)


def _trained(config: FlightModelConfig, X: Array, Y: Array, previous: FlightModel | None) -> list[ExactGP]:
    """Hyperparameters of one process for all columns of Y, or of one for each."""
    varying = np.flatnonzero(Y.std(axis=0) > 0.0)
    groups = [varying if len(varying) else np.arange(4)]
    if config.kernel == "separate":
        groups = [np.array([j]) for j in range(4)]
    known = previous.processes if previous is not None and _fits(previous, config) else [None] * len(groups)
    return [_fit(config, X, Y[:, own], start) for own, start in zip(groups, known, strict=True)]


def _fit(config: FlightModelConfig, X: Array, Y: Array, known: SharedPosterior | None) -> ExactGP:
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    start = initial_shared(kernel, X, Y, noise_floor=config.noise_floor)
    lengths = np.array([role == "length" for role in kernel.roles()] + [False])
    others = [start.parameters + np.log(f) * lengths for f in LENGTH_FACTORS[1 : config.starts]]
    if known is not None:
        others.append(_process_of(known, config.noise_floor).parameters)
    prior = shared_weak_prior(kernel, X, Y) if config.prior == "weak" else None
    return fit_shared(start, X, Y, steps=config.steps, prior=prior, others=others)


def _process_of(posterior: SharedPosterior, floor: float = 0.0) -> ExactGP:
    """The process with a posterior's hyperparameters: noise above `floor` is what training had found."""
    first, noise = posterior.outputs[0], posterior.noise_variance
    learned = max(noise - floor**2, 1e-4 * noise)
    return ExactGP(first.kernel, first.theta, 0.5 * float(np.log(learned)), floor)


def _fits(previous: FlightModel, config: FlightModelConfig) -> bool:
    return previous.features == config.features() and previous.shared == (config.kernel == "shared")


def _held_out(
    lesson: Lesson,
    processes: tuple[SharedPosterior, ...],
    offset: Array,
    deviation: Array,
    folds: dict[int, FlightPhysics] | None,
) -> HeldOut:
    data, fold = lesson.data.take(lesson.kept), lesson.fold[lesson.kept]
    error, variance = np.empty_like(data.command), np.empty_like(data.command)
    numbers = np.unique(fold)
    for number in numbers:
        own = np.flatnonzero(fold == number)
        mean = 0.0 if folds is None else folds[int(number)].predict(data.states)
        Y = (data.command - mean - offset) / deviation
        place = 0
        for process in processes:
            columns = slice(place, place + len(process.outputs))
            if len(numbers) == 1:  # one stretch alone: nothing is left to predict it from but the prior
                held, spread = np.zeros((len(own), 4)), np.full(len(own), process.signal_variance)
            else:
                held, spread = process.held_out(own, Y[:, columns])
            error[own, columns] = deviation[columns] * (Y[own, columns] - held)
            variance[own, columns] = np.outer(spread, deviation[columns] ** 2)
            place = columns.stop
    return HeldOut(error, variance, fold)


def train_flight_model(
    data: FlightDataset,
    vehicle: Vehicle | None,
    config: FlightModelConfig,
    rng: np.random.Generator,
    previous: FlightModel | None = None,
) -> FlightModel:
    """One model of the kind that `config` names.

    Args:
        vehicle: nominal body and motors; None, or commands not in V: physics by linear least squares.
        rng: draws the offsets of the thinning.
        previous: an earlier model; training starts at its hyperparameters too, or keeps them
            (hyperparameters = "first_flight").

    Raises:
        UsageError: kind "auto" (that is `train_flight_ladder`'s), or a nominal kind without a vehicle.
        DataError: no flight, or states without an input that `config` names.
    """
    if config.kind == "auto":
        raise UsageError("One model has one kind", where="kind = auto", next_step="Use train_flight_ladder.")
    own = lesson(data, vehicle, config, rng)
    base, folds = fitted_physics(own, config.kind)
    if config.kind not in PHYSICS_KINDS:
        return train_process(own, config.kind, config, base, folds, previous)[0]
    twin, _ = train_process(own, WITH_PROCESS[config.kind], config, base, folds, previous)
    return physics_alone(twin, config.kind, base, physics_held_out(own, folds), config)


def physics_alone(
    twin: FlightModel, kind: FlightKind, physics: FlightPhysics, held: HeldOut, config: FlightModelConfig
) -> FlightModel:
    """The rung that predicts by physics alone; its processes, for the design, are the twin's."""
    student = fit_student(held.error / np.sqrt(held.variance)) if config.student_t else None
    return replace(twin, kind=kind, physics=physics, physics_variance=held.variance[0], student=student)
