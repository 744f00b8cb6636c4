"""One output of the inverse dynamics: choice of points, hyperparameters, noise floor, calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.models.calibration import contiguous_blocks, held_out_z2, inflation
from etude.models.dataset import Dataset
from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.gp.kernels import Kernel, SquaredExponential, structured_kernel
from etude.models.gp.training import fit, initial_gp
from etude.models.model_config import FLOORS, ModelConfig
from etude.models.selection import spread_points

Array = NDArray[np.float64]

LARGEST_FLOOR = 0.1
"""Limit of the noise floor as a part of the command's own deviation."""
BLOCK_S = 8.0
"""With a single trajectory, stretches of this length are held out instead of whole trajectories."""


@dataclass(frozen=True)
class OutputProcess:
    """A trained process of one output.

    Attributes:
        posterior: conditioned on the kept points; outputs are centred by `offset`.
        offset: mean of the target, command units.
        scale: factor on the predictive variance from held-out trajectories, >= 1.
    """

    posterior: ExactPosterior
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
    start: ExactPosterior | None,
) -> OutputProcess:
    """Trains the process of output `axis`.

    Args:
        dataset: gives mask, times and trajectories of the samples.
        X: (n, D) features. target: (n,) what the process has to explain, command units.
        command: the axis's command limit, the scale of the noise floor.
        start: an earlier posterior of this output, for a warm start.

    Raises:
        DataError: the axis moved at no sample.
    """
    moving = ~dataset.stuck[:, axis]
    if np.count_nonzero(moving) < 2:
        raise DataError("the axis hardly moves, so nothing of it can be learned", where=f"axis {axis}")
    kept = spread_points(dataset, moving, config.points, 0.0, rng)
    chosen = spread_points(dataset, moving, config.fit_points, config.fit_spacing_s, rng)
    offset = float(target[kept].mean())
    y = target - offset
    groups = _held_out_groups(dataset, kept)
    floors = FLOORS if config.noise_floor == "auto" else (config.noise_floor,)
    largest = LARGEST_FLOOR * float(np.std(dataset.tau[moving, axis]))  # a joint may use little of its range
    kernel = _kernel(config, dataset.dof, X.shape[1], axis)
    best: tuple[float, OutputProcess] | None = None
    for floor in floors:
        gp = fit(
            _start(kernel, X[chosen], y[chosen], min(floor * command, largest), start),
            X[chosen],
            y[chosen],
            method=config.method,
            steps=config.steps,
            prior="weak" if config.prior == "weak" else None,
        )
        posterior = gp.condition(X[kept], y[kept])
        scale = inflation(held_out_z2(posterior, groups)) if config.calibrate else 1.0
        density = _held_out_density(posterior, groups, scale)
        if best is None or density > best[0]:
            best = density, OutputProcess(posterior, offset, scale)
    assert best is not None
    return best[1]


def _kernel(config: ModelConfig, dof: int, width: int, axis: int) -> Kernel:
    if config.kernel == "structured":
        return structured_kernel(dof, axis, width // dof - 3)
    return SquaredExponential(tuple(range(width)))


def _start(kernel: Kernel, X: Array, y: Array, floor: float, start: ExactPosterior | None) -> ExactGP:
    """The process to train from: the earlier hyperparameters if they fit, else the data's scales."""
    gp = initial_gp(kernel, X, y, noise_floor=floor)
    if start is None or start.kernel != kernel:
        return gp
    learned = max(start.noise_variance - floor**2, 1e-4 * start.noise_variance)
    return gp.with_parameters(np.append(start.theta, 0.5 * np.log(learned)))


def _held_out_groups(dataset: Dataset, kept: NDArray[np.int64]) -> NDArray[np.int64]:
    group = dataset.group[kept]
    if len(np.unique(group)) > 1:
        return group
    return contiguous_blocks(dataset.t[kept], group, BLOCK_S)


def _held_out_density(posterior: ExactPosterior, groups: NDArray[np.int64], scale: float) -> float:
    """Mean log density of the points, each trajectory predicted from the others with the variances in use."""
    if len(np.unique(groups)) < 2:
        return 0.0
    mean, variance = posterior.leave_group_out(groups)
    used = scale * variance
    return -0.5 * float(np.mean(np.log(used) + (posterior.y - mean) ** 2 / used))
