"""Spectral points and hyperparameters from data: draws, training, and guards against learning noise."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from etude.errors import NumericalError, UsageError
from etude.models.gp.exact import checked_data, checked_outputs, columns_of
from etude.models.gp.hyperparameters import (
    INITIAL_NOISE,
    Method,
    Prior,
    check_method,
    data_scales,
    joint_likelihood,
    optimise,
    weak_prior,
)
from etude.models.gp.kernels import SquaredExponential
from etude.models.gp.minimize import Objective
from etude.types import Array
from etude_sparse.sparse_spectrum import SparseSpectrumGP


def initial_sparse_spectrum(
    X: Array,
    y: Array,
    count: int,
    rng: np.random.Generator,
    *,
    draws: int = 100,
    learned: bool = False,
    noise_floor: float = 0.0,
) -> SparseSpectrumGP:
    """The process a training starts from, as the authors' code: the likeliest of `draws` sets of points.

    Lengths are the half ranges of X (n, D), s0² the variance of the centred y (n,), sn² a quarter of it; a
    column that never changes gets length 1, constant outputs s0 = 1. `count` is m.
    """
    X, y = checked_data(X, y)
    if count < 1:
        raise UsageError(f"at least one spectral point is needed, got {count}")
    half_range, scale = data_scales(X, y)
    theta = np.log(np.append(scale, half_range))
    noise = float(np.log(INITIAL_NOISE * scale))
    points = np.zeros((count, X.shape[1]))
    return redrawn(SparseSpectrumGP(points, theta, noise, noise_floor, learned), X, y, rng, draws=draws)


def redrawn(
    gp: SparseSpectrumGP, X: Array, y: Array, rng: np.random.Generator, *, draws: int = 100
) -> SparseSpectrumGP:
    """The same hyperparameters with new points: the likeliest of `draws` from N(0, I). UsageError if none.

    y is (n,), or (n, m) for outputs that share the points.
    For fixed points it also follows a training with others: hyperparameters kept, points drawn again.
    """
    if draws < 1:
        raise UsageError(f"at least one draw of the spectral points is needed, got {draws}")
    candidates = (replace(gp, points=rng.standard_normal(gp.points.shape)) for _ in range(draws))
    if draws == 1:
        return next(candidates)
    outputs = columns_of(y)
    return max(candidates, key=lambda candidate: sum(candidate.evidence(X, output) for output in outputs))


def fit_sparse_spectrum(
    gp: SparseSpectrumGP,
    X: Array,
    y: Array,
    *,
    method: Method = "lbfgs",
    steps: int = 25,
    prior: Prior | Literal["weak"] | None = "weak",
    point_prior: bool = True,
    held_out: tuple[Array, Array] | None = None,
    patience: int = 15,
) -> SparseSpectrumGP:
    """Train from the parameters of `gp` (a warm start; learned points included) on X (n, D), centred y (n,)
    or, for outputs that share all, (n, m).

    Learned points can memorise noise: 2m weights and m D frequencies face n samples. Below about n = 20 m the
    likelihood alone does not prevent it. Guards, to be combined: the points' own N(0, I) density
    (`point_prior`), a held-out trajectory, or fixed points.

    Args:
        method, steps: as `hyperparameters.fit`.
        prior: on theta and log_noise; "weak" for `weak_prior` of these data, or None.
        point_prior: maximum a posteriori for learned points, ω ~ N(0, ℓ^-2), with the lengths as they are:
            if they moved too, lengths and points would shrink together, the process the same, until nothing
            held the points. So find the lengths first, with fixed points. Without it and `prior`: maximum
            likelihood, over everything.
        held_out: inputs and outputs of another trajectory, centred by the same offset. The parameters that
            predicted it best (`held_out_error`) are returned, and training stops when `patience`
            improvements of the objective in a row have not improved that.

    Raises:
        DataError: unusable data. UsageError: unknown method, wrong lengths, patience below 1.
        NumericalError: the likelihood is not finite at the start.
    """
    X, y = checked_outputs(X, y)
    check_method(method)
    if patience < 1:
        raise UsageError(f"patience must be at least 1, got {patience}")
    if steps == 0:
        return gp
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    chosen = weak_prior(kernel, X, y) if prior == "weak" else prior
    objective = _objective(gp, X, y, chosen, point_prior and gp.learned)
    if held_out is None:
        return gp.with_parameters(optimise(objective, gp.parameters, method=method, steps=steps))
    watch = _Watch(gp, (X, y), checked_outputs(*held_out), patience)
    with suppress(_NoLongerBetter):
        optimise(watch.watched(objective), gp.parameters, method=method, steps=steps)
    return watch.best


def held_out_error(gp: SparseSpectrumGP, data: tuple[Array, Array], held_out: tuple[Array, Array]) -> float:
    """Mean squared error of the held-out outputs, predicted from the data.

    Not their density: a sparse spectrum's variance is calibrated afterwards. While points are learned the
    variance falls at once, so the density rejects a training that is about to halve the error.
    """
    (X, y), (X_out, y_out) = data, held_out
    pairs = zip(columns_of(y), columns_of(y_out), strict=True)
    return float(np.mean([(gp.condition(X, output).mean(X_out) - out) ** 2 for output, out in pairs]))


def _objective(gp: SparseSpectrumGP, X: Array, y: Array, prior: Prior | None, on_points: bool) -> Objective:
    """Negative log posterior density of the parameters; infinite where it cannot be computed."""
    count = len(gp.theta) + 1

    def objective(parameters: Array) -> tuple[float, Array]:
        try:
            value, gradient = joint_likelihood(gp.with_parameters(parameters), X, y)
        except NumericalError:
            return np.inf, np.zeros_like(parameters)
        if prior is not None:
            density, slope = prior.log_density(parameters[:count])
            value += density
            gradient[:count] += slope
        if on_points:
            value -= 0.5 * float(parameters[count:] @ parameters[count:])
            gradient[count:] -= parameters[count:]
            gradient[1 : count - 1] = 0.0  # the lengths stay: they are the unit of the points
        return -value, -gradient

    return objective


class _NoLongerBetter(Exception):
    """Ends a training whose held-out trajectory is predicted no better."""


@dataclass
class _Watch:
    """Scores the held-out trajectory wherever the objective falls, and remembers the best parameters."""

    best: SparseSpectrumGP
    data: tuple[Array, Array]
    held_out: tuple[Array, Array]
    patience: int
    error: float = np.inf
    least: float = np.inf
    failures: int = 0

    def watched(self, objective: Objective) -> Objective:
        """The objective, with an eye on the held-out trajectory."""

        def watched(parameters: Array) -> tuple[float, Array]:
            value, gradient = objective(parameters)
            if value < self.least:
                self.least = value
                self._score(self.best.with_parameters(parameters))
            return value, gradient

        return watched

    def _score(self, gp: SparseSpectrumGP) -> None:
        error = held_out_error(gp, self.data, self.held_out)
        if error < self.error:
            self.best, self.error, self.failures = gp, error, 0
            return
        self.failures += 1
        if self.failures >= self.patience:
            raise _NoLongerBetter
