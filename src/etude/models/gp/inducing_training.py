"""Training of inducing inputs and hyperparameters, and the initial inducing inputs."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import NumericalError, UsageError
from etude.models.gp.exact import checked_data, checked_outputs
from etude.models.gp.hyperparameters import (
    Method,
    Prior,
    check_method,
    data_scales,
    initial_gp,
    joint_likelihood,
    optimise,
    weak_prior,
)
from etude.models.gp.inducing import Form, InducingGP
from etude.models.gp.kernels import Kernel
from etude.models.gp.minimize import Objective
from etude.threads import threads_for
from etude.types import Array

EXPLAINED = 1e-8
"""A sample whose prior variance is explained by the chosen ones up to this part adds nothing to them."""


def greedy_points(kernel: Kernel, theta: Array, X: Array, count: int) -> NDArray[np.int64]:
    """Rows of X (n, D) that explain it best: each next one is where the variance left is largest.

    A pivoted Cholesky factorisation of k(X, X) stopped after `count` pivots, O(n count²); Burt, Rasmussen and
    van der Wilk 2020. Fewer rows come back when there are fewer that differ: repeated points explain each
    other.
    """
    if count < 1:
        raise UsageError(f"at least one inducing input is needed, got {count}")
    diagonal = kernel.diagonal(theta, X)
    left, rows = diagonal.copy(), np.zeros((min(count, len(X)), len(X)))
    chosen: list[int] = []
    for i in range(len(rows)):
        pivot = int(np.argmax(left))
        if left[pivot] <= EXPLAINED * diagonal.mean():
            break
        row = kernel.value(theta, X[pivot : pivot + 1], X)[0] - rows[:i, pivot] @ rows[:i]
        rows[i] = row / np.sqrt(left[pivot])
        left = np.maximum(left - rows[i] ** 2, 0.0)
        left[pivot] = 0.0
        chosen.append(pivot)
    return np.array(chosen or [0], dtype=np.int64)


def initial_inducing(
    kernel: Kernel, X: Array, y: Array, count: int, *, form: Form = "vfe", noise_floor: float = 0.0
) -> InducingGP:
    """The model a training starts from: `initial_gp`, and up to `count` inducing inputs among the samples."""
    X, y = checked_data(X, y)
    gp = initial_gp(kernel, X, y, noise_floor=noise_floor)
    with threads_for(count):
        Z = X[greedy_points(kernel, gp.theta, X, count)]
    return InducingGP(kernel, gp.theta, gp.log_noise, Z, form, noise_floor)


def fit_inducing(
    gp: InducingGP,
    X: Array,
    y: Array,
    *,
    method: Method = "lbfgs",
    steps: int = 25,
    prior: Prior | Literal["weak"] | None = "weak",
    learn_inputs: bool = True,
) -> InducingGP:
    """Train hyperparameters, and the inducing inputs unless disabled, from those of `gp` (a warm start).

    As `hyperparameters.fit`, with FITC's likelihood or VFE's bound. Inducing inputs move in units of the half
    range of each input, so that inputs in any unit train alike; a prior covers the hyperparameters alone.

    Raises:
        DataError: unusable X (n, D) or y (n,), or (n, m) for outputs that share all. UsageError: unknown
        method, a prior of the wrong length. NumericalError: the objective is not finite at the start.
    """
    X, y = checked_outputs(X, y)
    check_method(method)
    if steps == 0:
        return gp
    chosen = weak_prior(gp.kernel, X, y) if prior == "weak" else prior
    shared = gp.kernel.size + 1
    unit = np.concatenate([np.ones(shared), np.tile(data_scales(X, y)[0], len(gp.Z))])
    unit = unit if learn_inputs else unit[:shared]
    objective = _objective(gp, X, y, chosen, unit)
    with threads_for(len(gp.Z)):
        start = gp.parameters[: len(unit)] / unit
        return _with_parameters(gp, optimise(objective, start, method=method, steps=steps) * unit)


def _with_parameters(gp: InducingGP, leading: Array) -> InducingGP:
    """The model with its first parameters replaced."""
    return gp.with_parameters(np.concatenate([leading, gp.parameters[len(leading) :]]))


def _objective(gp: InducingGP, X: Array, y: Array, prior: Prior | None, unit: Array) -> Objective:
    """Minus likelihood or bound, minus log prior, of parameters / unit; infinite where not computable."""
    shared = gp.kernel.size + 1

    def objective(scaled: Array) -> tuple[float, Array]:
        parameters = scaled * unit
        try:
            value, gradient = joint_likelihood(_with_parameters(gp, parameters), X, y)
        except NumericalError:
            return np.inf, np.zeros_like(scaled)
        gradient = gradient[: len(unit)]
        if prior is not None:
            density, slope = prior.log_density(parameters[:shared])
            value += density
            gradient[:shared] += slope
        return -value, -gradient * unit

    return objective
