"""One output of the inverse dynamics: choice of points, hyperparameters, noise floor, calibration, guard."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.contracts import Posterior
from etude.models.dataset import Dataset
from etude.models.gp.kernels import Kernel, SquaredExponential, structured_kernel
from etude.models.guard import Role, is_worse, linear_errors, linear_fit, linear_inputs, residual_errors
from etude.models.guided import GuidedPosterior
from etude.models.held_out import HeldOut, held_out_groups, hold_out, predict_without
from etude.models.lesson import Lesson, Trained, is_held, on_schedule
from etude.models.model_config import FLOORS, ModelConfig
from etude.models.processes import PROCESSES
from etude.models.selection import spread_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LARGEST_FLOOR = 0.1
"""Limit of the noise floor as a part of the command's own deviation."""
LEAST_FIT = 100
"""Samples for the hyperparameters of the structured kernel at least; it has some 80 of these for six joints.
Where logs are too short for `fit_spacing_s`, samples are taken nearer to each other."""


@dataclass(frozen=True)
class OutputProcess:
    """A trained process of one output.

    Attributes:
        posterior: conditioned on the samples that its member takes; outputs are centred by `offset`.
        offset: mean of the target, command units.
        scale: factor on the predictive variance from held-out trajectories, >= 1.
        role: what the guard made of it. weights: (3 dof + 1,) of the linear part, zero for "process".
        process_error, linear_error: held-out mean squared errors of the process alone and of linear
            regression; NaN where nothing could be held out.
    """

    posterior: Posterior
    offset: float
    scale: float
    role: Role
    weights: Array
    process_error: float = np.nan
    linear_error: float = np.nan


@dataclass(frozen=True)
class _Attempt:
    """A process with the noise floor that predicts best, and how it predicts what it has not seen."""

    trained: Trained
    posterior: Posterior
    held: HeldOut
    scale: float
    density: float


def train_output(
    dataset: Dataset,
    X: Array,
    target: Array,
    axis: int,
    command: float,
    config: ModelConfig,
    rng: np.random.Generator,
    start: Posterior | None,
) -> OutputProcess:
    """Trains the process of output `axis`.

    Args:
        dataset: gives mask, times and trajectories of the samples.
        X: (n, D) features. target: (n,) what the process has to explain, command units.
        command: the axis's command limit, the scale of the noise floor.
        start: an earlier posterior of this output; `config.schedule` says what becomes of it.

    Raises:
        DataError: the axis moved at no sample.
    """
    moving = ~dataset.stuck[:, axis]
    if np.count_nonzero(moving) < 2:
        raise DataError("the axis hardly moves, so nothing of it can be learned", where=f"axis {axis}")
    kept = spread_points(dataset, moving, config.points, 0.0, rng)
    spacing = config.fit_spacing_s
    if config.kernel == "structured":
        spacing = min(spacing, _seconds(dataset) / LEAST_FIT)
    chosen = spread_points(dataset, moving, config.fit_points, spacing, rng)
    offset = float(target[kept].mean())
    lesson = Lesson(
        X=X,
        y=target - offset,
        group=dataset.group,
        moving=np.flatnonzero(moving),
        kept=kept,
        chosen=chosen,
        kernel=_kernel(config, dataset.dof, X.shape[1], axis),
        floor=0.0,
        start=start,
        points=config.points,
        basis=config.basis,
        steps=config.steps,
        method=config.method,
        prior="weak" if config.prior == "weak" else None,
        rng=rng,
    )
    largest = LARGEST_FLOOR * float(np.std(dataset.tau[moving, axis]))  # a joint may use little of its range
    wanted = FLOORS if config.noise_floor == "auto" else (config.noise_floor,)
    if is_held(lesson, config.schedule):
        wanted = wanted[:1]  # the noise is held too
    floors = tuple(min(floor * command, largest) for floor in wanted)
    groups = held_out_groups(dataset)
    first = _attempt(lesson, floors, groups, config)
    plain = OutputProcess(first.posterior, offset, first.scale, "process", np.zeros(3 * dataset.dof + 1))
    if not config.guard or not len(first.held.rows):
        return plain
    return _guarded(plain, first.held, replace(lesson, y=target), floors, groups, config, dataset, axis)


def _attempt(lesson: Lesson, floors: tuple[float, ...], groups: Index, config: ModelConfig) -> _Attempt:
    attempts = []
    for floor in floors:
        own = on_schedule(replace(lesson, floor=floor), config.schedule)
        trained = PROCESSES[config.process](own)
        posterior = trained.condition(own.X[trained.taught], own.y[trained.taught])
        held, scale = HeldOut.none(), 1.0
        if config.calibrate or config.guard or len(floors) > 1:
            held = hold_out(trained, posterior, own, groups)
            scale = held.scale() if config.calibrate else 1.0
        attempts.append(_Attempt(trained, _guided(posterior, trained), held, scale, held.density(scale)))
    return max(attempts, key=lambda attempt: attempt.density)


def _guarded(
    plain: OutputProcess,
    held: HeldOut,
    lesson: Lesson,
    floors: tuple[float, ...],
    groups: Index,
    config: ModelConfig,
    dataset: Dataset,
    axis: int,
) -> OutputProcess:
    """The process itself, unless linear regression predicts better; `lesson.y` is the whole target."""
    L, tau = linear_inputs(dataset.q, dataset.qd, dataset.qdd), dataset.tau[:, axis]
    fair = linear_errors(L, tau, groups, held.rows)
    known = replace(plain, process_error=float(np.mean(held.error**2)), linear_error=float(np.mean(fair**2)))
    if not is_worse(held.error, fair, tau):
        return known
    if len(np.unique(dataset.group)) < 2:
        return replace(known, role="unsure")
    weights = linear_fit(L, lesson.y)
    second = _attempt(replace(lesson, y=lesson.y - L @ weights), floors, groups, config)

    def learn(residual: Array, number: int, at: Index) -> tuple[Array, Array]:
        return predict_without(second.trained, lesson.X, residual, groups, number, at)

    rows = second.held.rows
    error, variance = residual_errors(learn, L, lesson.y, groups, rows)
    scale = HeldOut(rows, error, variance).scale() if config.calibrate else 1.0
    found = replace(known, posterior=second.posterior, offset=0.0, scale=scale)
    if is_worse(error, linear_errors(L, tau, groups, rows), tau):
        return replace(found, role="linear", weights=linear_fit(L, tau))
    return replace(found, role="linear+process", weights=weights)


def _seconds(dataset: Dataset) -> float:
    """How long all trajectories last together, pauses included."""
    return float(sum(np.ptp(dataset.t[dataset.group == number]) for number in np.unique(dataset.group)))


def _guided(posterior: Posterior, trained: Trained) -> Posterior:
    return posterior if trained.guide is None else GuidedPosterior(posterior, trained.guide)


def _kernel(config: ModelConfig, dof: int, width: int, axis: int) -> Kernel:
    if config.kernel == "structured":
        return structured_kernel(dof, axis, width // dof - 3)
    return SquaredExponential(tuple(range(width)))
