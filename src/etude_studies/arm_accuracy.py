"""How well every member of the model family predicts the simulated arm, and what it costs.

Logs of random motions under PD control alone, preprocessed as a campaign does by default; one trajectory is
held out. nMSE, mean standardised log loss and z² are means over the joints, on samples where that joint
moves. Times and memory are those of all joints' processes together; times are processor times of all threads,
which on one core are what it takes, however busy the machine is.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from etude.control.closed_loop import run_closed_loop
from etude.control.feedforward import no_feedforward
from etude.models.blocks import linear_regression
from etude.models.calibration import score, standardised_log_loss
from etude.models.dataset import Dataset, concatenate
from etude.models.inverse_dynamics import feature_map
from etude.models.model_config import ModelConfig
from etude.models.output_process import LARGEST_FLOOR
from etude.models.preprocess import build_dataset, preset
from etude.plants.registry import simulated_robot
from etude.robots.spec import RobotSpec
from etude_studies.model_cost import held_bytes, predict_seconds
from etude_studies.model_members import MEMBERS, Member
from etude_studies.model_table import FIGURES
from etude_studies.rows import Row, mean_rows
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.random import random_trajectory

Array = NDArray[np.float64]

ROBOT = "arm4"
TRAINING = 3
DURATION_S = 60.0
SEEDS, QUICK_SEEDS = 8, 2
FLOOR = 0.002
"""Noise floor as a part of the command limit, the default of `ModelConfig`."""


POINTS = 600
"""Inputs predicted at once: a trajectory as the design sees it, or a minute at 10 Hz."""
REPEATS_ONE, REPEATS_MANY = 50, 5


def member_rows(rng: np.random.Generator, *, quick: bool = False) -> list[Row]:
    """The rows of `FIGURES` for every member, with intervals over seeds; nMSE beside linear regression's."""
    robot = simulated_robot(ROBOT, engine="compiled")
    measured: dict[str, list[dict[str, float]]] = {name: [] for name in MEMBERS}
    linear: list[float] = []
    _compile_members(robot.spec.dof)
    seeds = rng.spawn(QUICK_SEEDS if quick else SEEDS)
    for own in _shown(seeds, quick=quick):
        train, test = arm_data(own)
        found = score(test.tau, linear_regression(train, test), None, ~test.stuck)
        linear.append(_mean(found.nmse))
        for name, member in MEMBERS.items():
            measured[name].append(_measure(member, train, test, robot.spec, own))
    return [row for name, found in measured.items() for row in _rows_of(name, found, linear)]


def _rows_of(name: str, found: list[dict[str, float]], linear: list[float]) -> list[Row]:
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
        rows += mean_rows(metric, [one[key] for one in found], figure.unit, reference, values)
    return rows


def _shown(seeds: list[np.random.Generator], *, quick: bool) -> Iterable[np.random.Generator]:
    """The seeds, with a bar on stderr where they take minutes."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(seeds, "all models, seed by seed", console=console, transient=True, disable=quick)


def arm_data(rng: np.random.Generator) -> tuple[Dataset, Dataset]:
    """Samples of `TRAINING` random motions, and of one more."""
    robot, family = simulated_robot(ROBOT, engine="compiled"), TrajectoryFamily(duration=DURATION_S)
    parts = []
    for number in range(TRAINING + 1):
        trajectory = random_trajectory(rng, robot.spec, family)
        log = run_closed_loop(robot, trajectory, no_feedforward(robot.spec), rng)
        parts.append(build_dataset(log, robot.spec, preset("default"), number))
    return concatenate(parts[:-1]), parts[-1]


def _compile_members(inputs: int) -> None:
    """Each member once on a few points: compilation on first use is not the time to fit."""
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(2 * inputs, inputs)), rng.normal(size=2 * inputs)
    for member in MEMBERS.values():
        member(X, y, 0.1, rng).predict(X)


def _measure(
    member: Member, train: Dataset, test: Dataset, spec: RobotSpec, rng: np.random.Generator
) -> dict[str, float]:
    """The figures of one seed."""
    features = feature_map(spec, ModelConfig())
    X, at = (features.transform(data.q, data.qd, data.qdd) for data in (train, test))
    mean, variance = np.empty_like(test.tau), np.empty_like(test.tau)
    trivial = np.empty((2, spec.dof))
    posteriors, seconds = [], 0.0
    for j in range(spec.dof):
        moving = ~train.stuck[:, j]
        tau = train.tau[moving, j]
        trivial[:, j] = tau.mean(), tau.var()
        floor = min(FLOOR * float(spec.command[j]), LARGEST_FLOOR * float(tau.std()))
        start = time.process_time()
        posteriors.append(member(X[moving], tau - trivial[0, j], floor, rng))
        seconds += time.process_time() - start
        predicted, latent = posteriors[-1].predict(at)
        mean[:, j], variance[:, j] = predicted + trivial[0, j], latent + posteriors[-1].noise_variance
    many = np.resize(at, (POINTS, X.shape[1]))
    return _described(test, mean, variance, trivial) | {
        "fit_s": seconds,
        "predict_1_us": 1e6 * predict_seconds(posteriors, at[:1], REPEATS_ONE),
        "predict_600_ms": 1e3 * predict_seconds(posteriors, many, REPEATS_MANY),
        "memory_mb": 1e-6 * held_bytes(posteriors),
    }


def _described(test: Dataset, mean: Array, variance: Array, trivial: Array) -> dict[str, float]:
    """How good predictions are; `trivial` (2, dof) is mean and variance of the training commands."""
    found = score(test.tau, mean, variance, ~test.stuck)
    loss = standardised_log_loss(test.tau, mean, variance, ~test.stuck, trivial)
    return {"nmse": _mean(found.nmse), "msll": _mean(loss), "z2": _mean(found.z2)}


def _mean(values: Array) -> float:
    """Over the joints that have a value; NaN if none has."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
