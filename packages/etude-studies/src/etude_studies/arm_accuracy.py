"""Accuracy and cost of every member of the model family on the simulated arm.

Logs of random motions under PD control alone, preprocessed as a campaign does by default; one trajectory is
held out. nMSE, mean standardised log loss and z² are means over the joints, on samples where that joint
moves. Times and memory are those of all joints' processes together; times are processor times of all threads,
which on one core are what it takes, however busy the machine is.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from etude.models import LARGEST_FLOOR, LinearPhysics, ModelConfig, prediction_score
from etude.protocols import Inputs
from etude.types import Array, Samples
from etude_studies.model_cost import held_bytes, predict_seconds
from etude_studies.model_members import MEMBERS, Member
from etude_studies.model_table import FIGURES
from etude_studies.rows import Row, mean_rows
from etude_studies.world import World, one_period

ROBOT = "arm4"
TRAINING = 3
DURATION_S = 60.0
SEEDS, QUICK_SEEDS = 8, 2
ALONE = ModelConfig(candidates=("default",))
"""Members are compared on one covariance, so they look at nothing that other candidates alone look at."""
FLOOR = 0.002
"""Noise floor as a part of the command limit, the default of `ModelConfig`."""


POINTS = 600
"""Inputs predicted at once: a trajectory as the design sees it, or a minute at 10 Hz."""
REPEATS_ONE, REPEATS_MANY = 50, 5


def member_rows(rng: np.random.Generator, *, quick: bool = False) -> list[Row]:
    """The rows of `FIGURES` for every member, with intervals over seeds; nMSE beside linear regression's."""
    world = World.of(ROBOT)
    measured: dict[str, list[dict[str, float]]] = {name: [] for name in MEMBERS}
    linear: list[float] = []
    seeds = rng.spawn(QUICK_SEEDS if quick else SEEDS)
    for seed_rng in _shown(seeds, quick=quick):
        train, test = arm_data(world, seed_rng)
        inputs = world.inputs(ALONE)
        _compile_members(len(inputs.columns))
        linear.append(_mean(prediction_score(test, LinearPhysics(inputs)(train).predict(test.log)).nmse))
        for name, member in MEMBERS.items():
            measured[name].append(
                _measure(member, train, test, inputs, world.kind.limit(world.spec), seed_rng)
            )
    return [row for name, figures in measured.items() for row in _rows_of(name, figures, linear)]


def _rows_of(name: str, figures: list[dict[str, float]], linear: list[float]) -> list[Row]:
    outputs = "processor time, 4 outputs, mean and variance"
    beside: dict[str, tuple[str, list[float]]] = {
        "nmse": (f"linear regression, {len(linear)} seeds", linear),
        "msll": ("normal distribution of the training commands", [0.0]),
        "z2": ("calibrated", [1.0]),
        "fit_s": ("processor time, 4 outputs, training included", []),
        "predict_1_us": (outputs, []),
        "predict_600_ms": (outputs, []),
        "memory_mb": ("arrays of 4 posteriors after a prediction", []),
    }
    rows = []
    for key, figure in FIGURES.items():
        reference, values = beside[key]
        metric = figure.metric.format(name)
        rows += mean_rows(metric, [one[key] for one in figures], figure.unit, reference, values)
    return rows


def _shown(seeds: list[np.random.Generator], *, quick: bool) -> Iterable[np.random.Generator]:
    """The seeds, with a bar on stderr where they take minutes."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(seeds, "all models, seed by seed", console=console, transient=True, disable=quick)


def arm_data(world: World, rng: np.random.Generator) -> tuple[Samples, Samples]:
    """Samples of `TRAINING` random motions, and of one more."""
    motions = (world.motion(rng, **one_period(DURATION_S)) for _ in range(TRAINING + 1))
    samples = world.samples(*(world.robot.run(motion, None, rng) for motion in motions))
    return samples.take(samples.group < TRAINING), samples.take(samples.group == TRAINING)


def _compile_members(inputs: int) -> None:
    """Each member once on a few points: compilation on first use is not the time to fit."""
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(2 * inputs, inputs)), rng.normal(size=2 * inputs)
    for member in MEMBERS.values():
        member(X, y, 0.1, rng).predict(X)


def _measure(
    member: Member, train: Samples, test: Samples, inputs: Inputs, limit: Array, rng: np.random.Generator
) -> dict[str, float]:
    """The figures of one seed."""
    X, at = (inputs.of_log(samples.log) for samples in (train, test))
    mean, variance = np.empty_like(test.command), np.empty_like(test.command)
    posteriors, seconds = [], 0.0
    for j, largest in enumerate(limit.tolist()):
        use = (train.usable & train.moving)[:, j]
        command = train.command[use, j]
        offset, floor = command.mean(), min(FLOOR * largest, LARGEST_FLOOR * float(command.std()))
        start = time.process_time()
        posteriors.append(member(X[use], command - offset, floor, rng))
        seconds += time.process_time() - start
        predicted, latent = posteriors[-1].predict(at)
        mean[:, j], variance[:, j] = predicted + offset, latent + posteriors[-1].noise_variance
    moving = replace(train, usable=train.usable & train.moving)
    score, many = prediction_score(test, mean, variance, moving), np.resize(at, (POINTS, X.shape[1]))
    return {name: _mean(getattr(score, name)) for name in ("nmse", "msll", "z2")} | {
        "fit_s": seconds,
        "predict_1_us": 1e6 * predict_seconds(posteriors, at[:1], REPEATS_ONE),
        "predict_600_ms": 1e3 * predict_seconds(posteriors, many, REPEATS_MANY),
        "memory_mb": 1e-6 * held_bytes(posteriors),
    }


def _mean(values: Array) -> float:
    """Over the joints that have a value; NaN if none has."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")
