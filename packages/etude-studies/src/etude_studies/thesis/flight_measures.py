"""Measures of the models of chapter 5 after each flight: on the tests, and of the data themselves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import cKDTree

from etude.models import LearnedModel
from etude.protocols import Mean
from etude.types import Array
from etude_studies.measured import Measured
from etude_studies.thesis.arm_lines import Linear
from etude_studies.thesis.arm_measures import Figure, honesty
from etude_studies.thesis.flight_rounds import Round, processes
from etude_studies.thesis.flight_settings import FlightSettings, flights_of
from etude_studies.thesis.flight_tests import FlightSet

PARTS: Mapping[str, tuple[str, ...]] = {
    "quadrotor": ("motor1", "motor2", "motor3", "motor4"),
    "pelican": ("roll", "pitch", "yaw", "thrust"),
}
"""Of the commands, in the order of the vehicle's file; the yaw command is a rate."""
POWERS = {
    "mae": 1,
    "mae_late": 1,
    "deviation": 1,
    "ahead_mae": 1,
    "variance": 2,
    "variance_noisy": 2,
    "ahead_variance": 2,
}
"""By which power of a command's unit these change with it; z², coverage and rank do not."""
MOST_ROWS = 2000
"""Predicted at once, to bound memory."""


def means_at(model: LearnedModel, X: Array) -> Array:
    """(T, 4) mean commands at X (T, D), thesis (2.5)."""
    blocks = np.array_split(X, max(1, -(-len(X) // MOST_ROWS)))
    columns = []
    for candidate, posterior in zip(model.candidates, processes(model), strict=True):
        offset, factor = candidate.units[:, 0]
        columns.append(offset + factor * np.concatenate([posterior.mean(block) for block in blocks]))
    return np.stack(columns, axis=1)


def variances_at(model: LearnedModel, X: Array) -> tuple[Array, Array]:
    """Latent and noisy variances (T, 4) of the commands at X (T, D), thesis (2.6).

    By a triangular system each, which is cheaper for few points than the inverse that predictions keep.
    """
    latent, noise = [], []
    for candidate, posterior in zip(model.candidates, processes(model), strict=True):
        factor = candidate.units[1, 0]
        explained = solve_triangular(
            posterior.L, posterior.kernel.value(posterior.theta, posterior.X, X), lower=True
        )
        prior = posterior.kernel.diagonal(posterior.theta, X)
        latent.append(factor**2 * np.maximum(prior - np.einsum("nt,nt->t", explained, explained), 0.0))
        noise.append(factor**2 * posterior.noise_variance)
    latent_variance = np.stack(latent, axis=1)
    return latent_variance, latent_variance + np.array(noise)


def own_figures(model: LearnedModel, test: FlightSet) -> Iterator[Figure]:
    """Of the processes on a set of tests, each (4,)."""
    X = model.inputs.of_log(test.samples.log)
    mean = means_at(model, X)
    yield from _errors(test, mean)
    latent, noisy = variances_at(model, X[test.judged])
    yield "deviation", np.sqrt(latent).mean(axis=0)
    for name, values in honesty(test.command[test.judged], mean[test.judged], latent, noisy):
        # a deviation that is the same everywhere, as far from all data, ranks nothing
        yield name, np.nan_to_num(values) if name == "spearman" else values


def lines(settings: FlightSettings, last: Round) -> dict[str, Mean | Linear]:
    """What else the same flights teach: linear regression, and physics as far as the vehicle is described.

    "identified" has the vehicle's coefficients (of set-points, weights of features), "nominal" knows mass,
    inertia and motors exactly but neither drag nor ground effect (5.2); of set-points there is none.
    """
    world = flights_of(settings.place).world
    physics = world.kind.physics(world.spec, settings.learning.config)
    models: dict[str, Mean | Linear] = {
        name: physics_of(last.samples) for name, physics_of in physics.items()
    }
    models["linear"] = Linear.of(last.model.inputs, last.samples.log, last.samples.command)
    return models


def line_figures(mean: Mean | Linear, test: FlightSet) -> Iterator[Figure]:
    """Of a line on a set of tests, each (4,)."""
    yield from _errors(test, mean.predict(test.samples.log))


def _errors(test: FlightSet, predicted: Array) -> Iterator[Figure]:
    error = np.abs(test.command - predicted)
    yield "mae", test.flight_mean(error)
    yield "mae_late", test.flight_mean(error, test.late)


def ahead_figures(model: LearnedModel, test: FlightSet) -> Iterator[Figure]:
    """Of a flight that the model is about to learn, each (4,)."""
    X = model.inputs.of_log(test.samples.log)
    yield "ahead_mae", test.flight_mean(np.abs(test.command - means_at(model, X)))
    yield "ahead_variance", variances_at(model, X[test.judged])[0].mean(axis=0)


def by_command(
    vehicle: str, unit: Array, k: int, test: str, line: str, figures: Iterator[Figure]
) -> Iterator[Measured]:
    """A figure of each command and their mean, for which commands of different units are divided by `unit`.

    Args:
        unit: (4,) deviations of the Pelican's commands over the tests; ones for motors, all in V.
    """
    for name, values in figures:
        for part, value in zip(PARTS[vehicle], values, strict=True):
            yield Measured(k, test, line, part, name, float(value))
        shared = values - np.log(unit) if name == "nlpd" else values / unit ** POWERS.get(name, 0)
        yield Measured(k, test, line, "mean", name, float(np.mean(shared)))


def hyperparameters(model: LearnedModel) -> Iterator[tuple[int, str, float]]:
    """Command, name and value: lengths in the inputs' units, deviations in the command's."""
    names = ["_".join(column[:2]) for column in model.inputs.columns]
    for candidate, posterior in zip(model.candidates, processes(model), strict=True):
        (command,), factor = candidate.commands, float(candidate.units[1, 0])
        for name, length in zip(names, np.exp(posterior.theta[1:]), strict=True):
            yield command, f"length_{name}", float(length)
        yield command, "signal_sd", factor * float(np.exp(posterior.theta[0]))
        yield command, "noise_sd", factor * float(np.sqrt(posterior.noise_variance))


def coverage_figures(data: Array, reference: Array, scale: Array) -> Iterator[tuple[str, float]]:
    """How far the reference states (r, D) are from the data (n, D), in units of `scale` (D,)."""
    distance = nearest(reference, data, scale)
    yield "gap95", float(np.quantile(distance, 0.95))
    yield "fill", float(distance.max())


def nearest(new: Array, training: Array, scale: Array) -> Array:
    """(T,) distance of each of `new` (T, D) to the nearest of `training` (n, D), in units of `scale` (D,)."""
    return np.asarray(cKDTree(training / scale).query(new / scale)[0])


def half_range(X: Array) -> Array:
    """(D,) of the columns of X (n, D); 1 of one that never changes."""
    halves = 0.5 * np.ptp(X, axis=0)
    return np.where(halves > 0.0, halves, 1.0)
