"""Training one inverse model of a vehicle, and predicting every flight from the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models.flight.config import LEAST_FLIGHTS, PHYSICS_KINDS, FlightKind, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.lesson import HeldOut, Lesson, fitted_physics, lesson, physics_held_out
from etude.models.flight.model import FlightModel
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import SquaredExponential
from etude.models.gp.shared_exact import (
    SharedPosterior,
    condition_shared,
    fit_shared,
    initial_shared,
    shared_weak_prior,
)
from etude.models.physics.flight_inverse import FlightPhysics
from etude.models.student_t import fit_student
from etude.robots.vehicle import Vehicle

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WITH_PROCESS: dict[FlightKind, FlightKind] = {"nominal": "nominal+gp", "identified": "identified+gp"}
LENGTH_FACTORS = (1.0, 3.0, 1.0 / 3.0, 10.0, 0.1)
"""Starts of a training: half ranges of the inputs as lengths, times these."""


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
    data = lesson.data
    X = config.features().transform(data.states)
    residual = kind != "gp"
    target = data.command - physics.predict(data.states) if residual else data.command
    best: tuple[float, Array, _Trained, HeldOut] | None = None
    for trained in _candidates(lesson, config, X, target, previous):
        held = _held_out(lesson, trained, folds if residual else None)
        scale = held.scale() if config.calibrate else np.ones(4)
        density = held.density(scale)
        if best is None or density > best[0]:
            best = density, scale, trained, held
    assert best is not None
    _, scale, trained, held = best
    model = FlightModel(
        kind=kind,
        features=config.features(),
        processes=trained.processes,
        offset=trained.offset,
        deviation=trained.deviation,
        scale=scale,
        calibrated=config.calibrate and len(data.flights) >= LEAST_FLIGHTS,
        physics=physics,
        physics_variance=physics_held_out(lesson, folds).variance[0],
        student=fit_student(held.error / np.sqrt(scale * held.variance)) if config.student_t else None,
    )
    return model, held


@dataclass(frozen=True)
class _Trained:
    """Processes of standardised outputs: command = offset + deviation * output, (4,) each."""

    offset: Array
    deviation: Array
    processes: tuple[SharedPosterior, ...]


def _candidates(
    lesson: Lesson, config: FlightModelConfig, X: Array, target: Array, previous: FlightModel | None
) -> Iterator[_Trained]:
    """Processes with each noise floor that is to be tried, or as the first flight taught them."""
    known = previous if previous is not None and _fits(previous, config) else None
    kept, chosen = lesson.kept, lesson.chosen
    columns = [slice(0, 4)] if config.kernel == "shared" else [slice(j, j + 1) for j in range(4)]

    def conditioned(offset: Array, deviation: Array, trained: list[ExactGP]) -> _Trained:
        Y = (target[kept] - offset) / deviation
        pairs = zip(trained, columns, strict=True)
        processes = tuple(condition_shared(gp, X[kept], Y[:, own]) for gp, own in pairs)
        return _Trained(offset, deviation, processes)

    first = config.hyperparameters == "first_flight"
    if first and known is not None:
        yield conditioned(known.offset, known.deviation, [_process_of(p) for p in known.processes])
        return
    offset, deviation = _standard(target[chosen if first else kept])
    Y = (target[chosen] - offset) / deviation
    outputs = [_telling(Y[:, own]) for own in columns]
    starts: list[ExactGP | None] = [None] * len(columns)
    if known is not None:
        starts = [_process_of(process) for process in known.processes]
    for place, floor in enumerate(config.floors):
        trained = [
            _fit(config, floor, X[chosen], y, start, follow=place > 0)
            for y, start in zip(outputs, starts, strict=True)
        ]
        yield conditioned(offset, deviation, trained)
        starts = [*trained]


def _standard(target: Array) -> tuple[Array, Array]:
    """Mean and deviation (4,) of the outputs; one that never changes is as uncertain as the others."""
    deviation = target.std(axis=0)
    constant = deviation <= 1e-12 * (1.0 + np.abs(target).max(axis=0))
    fallback = float(deviation[~constant].max()) if not constant.all() else 1.0
    return target.mean(axis=0), np.where(constant, fallback, deviation)


def _telling(Y: Array) -> Array:
    """The columns that vary, or the first: a constant output says nothing about lengths."""
    varying = np.flatnonzero(Y.std(axis=0) > 0.0)
    return Y[:, varying] if len(varying) else Y[:, :1]


def _fit(
    config: FlightModelConfig, floor: float, X: Array, Y: Array, known: ExactGP | None, *, follow: bool
) -> ExactGP:
    """Hyperparameters for all columns of Y, from the data's scales and `known`, or from `known` alone."""
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    start = initial_shared(kernel, X, Y, noise_floor=floor)
    prior = shared_weak_prior(kernel, X, Y) if config.prior == "weak" else None
    lengths = np.array([role == "length" for role in kernel.roles()] + [False])
    others = [start.parameters + np.log(f) * lengths for f in LENGTH_FACTORS[1 : config.starts]]
    if known is not None:
        others.append(_above(known, floor).parameters)
    if follow:
        start, others = start.with_parameters(others[-1]), []
    return fit_shared(start, X, Y, steps=config.steps, prior=prior, others=others)


def _above(gp: ExactGP, floor: float) -> ExactGP:
    """The same process with another noise floor: what training had found above it stays learned noise."""
    noise = gp.noise_variance
    return replace(gp, log_noise=0.5 * float(np.log(max(noise - floor**2, 1e-4 * noise))), noise_floor=floor)


def _process_of(posterior: SharedPosterior) -> ExactGP:
    """The process with a posterior's hyperparameters."""
    first = posterior.outputs[0]
    return ExactGP(first.kernel, first.theta, 0.5 * float(np.log(posterior.noise_variance)))


def _fits(previous: FlightModel, config: FlightModelConfig) -> bool:
    return previous.features == config.features() and previous.shared == (config.kernel == "shared")


def _held_out(lesson: Lesson, trained: _Trained, folds: dict[int, FlightPhysics] | None) -> HeldOut:
    data, fold = lesson.data.take(lesson.kept), lesson.fold[lesson.kept]
    offset, deviation = trained.offset, trained.deviation
    error, variance = np.empty_like(data.command), np.empty_like(data.command)
    numbers = np.unique(fold)
    for number in numbers:
        own = np.flatnonzero(fold == number)
        mean = 0.0 if folds is None else folds[int(number)].predict(data.states)
        Y = (data.command - mean - offset) / deviation
        place = 0
        for process in trained.processes:
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
