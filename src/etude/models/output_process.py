"""One output of the inverse dynamics: choice of points, hyperparameters, noise floor, calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.calibration import contiguous_blocks, inflation
from etude.models.contracts import Posterior
from etude.models.dataset import Dataset
from etude.models.gp.kernels import Kernel, SquaredExponential, structured_kernel
from etude.models.guided import GuidedPosterior
from etude.models.lesson import Lesson, Trained, is_held, on_schedule
from etude.models.model_config import FLOORS, ModelConfig
from etude.models.processes import PROCESSES
from etude.models.selection import spread_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LARGEST_FLOOR = 0.1
"""Limit of the noise floor as a part of the command's own deviation."""
BLOCK_S = 8.0
"""With a single trajectory, stretches of this length are held out instead of whole trajectories."""


@dataclass(frozen=True)
class OutputProcess:
    """A trained process of one output.

    Attributes:
        posterior: conditioned on the samples that its member takes; outputs are centred by `offset`.
        offset: mean of the target, command units.
        scale: factor on the predictive variance from held-out trajectories, >= 1.
    """

    posterior: Posterior
    offset: float
    scale: float


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
    chosen = spread_points(dataset, moving, config.fit_points, config.fit_spacing_s, rng)
    offset = float(target[kept].mean())
    largest = LARGEST_FLOOR * float(np.std(dataset.tau[moving, axis]))  # a joint may use little of its range
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
    floors = FLOORS if config.noise_floor == "auto" else (config.noise_floor,)
    if is_held(lesson, config.schedule):
        floors = floors[:1]  # the noise is held too
    best: tuple[float, OutputProcess] | None = None
    for floor in floors:
        own = on_schedule(replace(lesson, floor=min(floor * command, largest)), config.schedule)
        trained = PROCESSES[config.process](own)
        posterior = trained.condition(X[trained.taught], own.y[trained.taught])
        scale, density = 1.0, 0.0
        if config.calibrate or len(floors) > 1:
            held = _held_out(trained, posterior, own, _groups(dataset, trained.taught))
            scale = held.scale() if config.calibrate else 1.0
            density = held.density(scale)
        if best is None or density > best[0]:
            best = density, OutputProcess(_guided(posterior, trained), offset, scale)
    assert best is not None
    return best[1]


def _guided(posterior: Posterior, trained: Trained) -> Posterior:
    return posterior if trained.guide is None else GuidedPosterior(posterior, trained.guide)


def _kernel(config: ModelConfig, dof: int, width: int, axis: int) -> Kernel:
    if config.kernel == "structured":
        return structured_kernel(dof, axis, width // dof - 3)
    return SquaredExponential(tuple(range(width)))


def _groups(dataset: Dataset, taught: Index) -> Index:
    """What is held out together: trajectories, or stretches of a single one."""
    group = dataset.group[taught]
    if len(np.unique(group)) > 1:
        return group
    return contiguous_blocks(dataset.t[taught], group, BLOCK_S)


@dataclass(frozen=True)
class _HeldOut:
    """Samples, each predicted from the other trajectories; none where there was nothing to leave out.

    Attributes:
        error, variance: (m,) of y, noise included.
    """

    error: Array
    variance: Array

    def scale(self) -> float:
        return inflation(float(np.mean(self.error**2 / self.variance))) if len(self.error) else 1.0

    def density(self, scale: float) -> float:
        """Mean log density with the variances in use."""
        if not len(self.error):
            return 0.0
        used = scale * self.variance
        return -0.5 * float(np.mean(np.log(used) + self.error**2 / used))


def _held_out(trained: Trained, posterior: Posterior, lesson: Lesson, groups: Index) -> _HeldOut:
    """In closed form if the posterior keeps what it was taught, else by conditioning without each group.

    The second predicts the evenly spread samples alone: among them, none was picked for its error.
    """
    X, y = lesson.X[trained.taught], lesson.y[trained.taught]
    if len(np.unique(groups)) < 2:
        return _HeldOut(np.zeros(0), np.zeros(0))
    leave = getattr(posterior, "leave_group_out", None)
    if leave is not None and np.array_equal(getattr(posterior, "X", X[:0]), X):
        mean, variance = leave(groups)
        return _HeldOut(y - mean, variance)
    spread = np.isin(trained.taught, lesson.kept)
    errors, variances = [], []
    for number in np.unique(groups[spread]):
        other, own = groups != number, (groups == number) & spread
        without = trained.condition(X[other], y[other])
        mean, variance = without.predict(X[own])
        errors.append(y[own] - mean)
        variances.append(variance + without.noise_variance)
    return _HeldOut(np.concatenate(errors), np.concatenate(variances))
