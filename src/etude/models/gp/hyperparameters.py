"""Hyperparameters from data: maximum likelihood or a posteriori under weak priors on logarithms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from etude._runtime.scipy_parts import minimise
from etude.errors import NumericalError, UsageError
from etude.models.gp.exact import ExactGP, checked_data, checked_outputs, columns_of
from etude.models.gp.kernels import Kernel
from etude.models.gp.minimize import Objective, minimize
from etude.threads import threads_for
from etude.types import Array

Method = Literal["lbfgs", "minimize", "descent"]

REACH = np.log(1e6)
"""Training moves no hyperparameter further than this factor (as a logarithm) from its start."""
RATE = 3e-4
"""Of "descent": what the gradient of the log posterior density, in all parameters, is multiplied by."""
INITIAL_NOISE = 0.5
"""First noise deviation as a fraction of the outputs' (sn² = var / 4, as the SSGP reference code)."""


LENGTH_DEVIATION = 1.5  # of logarithms: a factor of 4.5 either way is likely
AMPLITUDE_DEVIATION = 1.0  # of logarithms: a factor of 2.7
SLOPE_DEVIATION = 1.5  # of logarithms, as for lengths
NOISE_DEVIATION = 1.5  # of logarithms, as for lengths
LEAST_VARIATION = 1e-3
"""Half range of an input that varies, as a fraction of its size."""
NOISE_FRACTION = 0.1
"""Centre of the noise prior as a fraction of the outputs' deviation."""


@dataclass(frozen=True)
class Prior:
    """Normal densities of mean `centre` (P + 1,) and deviation `width` (P + 1,), in natural logarithms.

    The order is that of `ExactGP.parameters`: the kernel's theta, then log_noise. An infinite width leaves a
    parameter free.
    """

    centre: Array
    width: Array

    def __post_init__(self) -> None:
        if np.shape(self.centre) != np.shape(self.width) or np.ndim(self.centre) != 1:
            raise UsageError(f"prior centre {np.shape(self.centre)} and width {np.shape(self.width)} differ")
        if not np.all(np.asarray(self.width) > 0.0):
            raise UsageError("prior widths must be positive")

    def log_density(self, parameters: Array) -> tuple[float, Array]:
        """log p up to a constant, and its gradient (P + 1,)."""
        if parameters.shape != self.centre.shape:
            raise UsageError(f"the prior covers {len(self.centre)} parameters, got {parameters.shape}")
        z = (parameters - self.centre) / self.width
        return -0.5 * float(z @ z), -z / self.width


def weak_prior(kernel: Kernel, X: Array, y: Array) -> Prior:
    """The product's prior, scaled to the data: inputs X (n, D) and centred outputs y (n,) or (n, m).

    Lengths around the half range of their input (one deviation is a factor of 4.5 either way), amplitudes
    around the outputs' own deviation (2.7), noise around a tenth of it (4.5). The amplitude term keeps a sum
    of kernels trainable on few points: without it amplitudes of e^12 cancel each other and gradients drown.
    """
    half_range, scale = data_scales(X, y)
    centre = np.append(kernel.initial(half_range, scale), np.log(NOISE_FRACTION * scale))
    widths = {"length": LENGTH_DEVIATION, "amplitude": AMPLITUDE_DEVIATION, "slope": SLOPE_DEVIATION}
    return Prior(centre, np.array([*(widths[role] for role in kernel.roles()), NOISE_DEVIATION]))


def data_scales(X: Array, y: Array) -> tuple[Array, float]:
    """Half range (D,) of each input and deviation of the centred outputs; 1 where the data do not vary.

    y (n,), or (n, m) for the deviation of all its columns. What saturates, as the friction input of a joint
    that turns one way, does not vary by its last digits: a length of 1e-12 claims any force when it turns
    back.
    """
    half_range = 0.5 * (X.max(axis=0) - X.min(axis=0))
    y = y.T.ravel()
    scale = float(np.sqrt(np.mean(y * y)))
    varies = half_range > LEAST_VARIATION * np.abs(X).max(axis=0)
    return np.where(varies, half_range, 1.0), scale if scale > 0.0 else 1.0


def initial_theta(kernel: Kernel, X: Array, y: Array) -> Array:
    """Start of a training (P,): half ranges of X (n, D) as lengths, amplitudes from the centred y.

    y is (n,) or, for one kernel of several outputs, (n, m). A column that never changes gets length 1,
    constant outputs amplitude 1.
    """
    X, y = checked_outputs(X, y)
    return kernel.initial(*data_scales(X, y))


def initial_gp(kernel: Kernel, X: Array, y: Array, *, noise_floor: float = 0.0) -> ExactGP:
    """The process a training starts from: `initial_theta`, and noise of half the outputs' deviation."""
    X, y = checked_outputs(X, y)
    _, scale = data_scales(X, y)
    return ExactGP(kernel, initial_theta(kernel, X, y), float(np.log(INITIAL_NOISE * scale)), noise_floor)


def fit(
    gp: ExactGP,
    X: Array,
    y: Array,
    *,
    method: Method = "lbfgs",
    steps: int = 25,
    prior: Prior | Literal["weak"] | None = "weak",
) -> ExactGP:
    """Train from the hyperparameters of `gp` (a warm start) on X (n, D) and centred y (n,).

    Args:
        method: "lbfgs" (SciPy, `steps` iterations), "minimize" (GPML semantics: `steps` line searches,
            or function evaluations if negative) or "descent" (`steps` steps of fixed rate).
        steps: 0 returns `gp` unchanged.
        prior: "weak" for `weak_prior` of these data, a Prior, or None for maximum likelihood.

    Raises:
        DataError: unusable X or y. UsageError: unknown method, a prior of the wrong length, negative steps
            other than of "minimize". NumericalError: the likelihood is not finite at the start.
    """
    X, y = checked_data(X, y)
    check_method(method)
    if steps == 0:
        return gp
    chosen = weak_prior(gp.kernel, X, y) if prior == "weak" else prior
    objective = negative_posterior(lambda p: gp.with_parameters(p).log_marginal_likelihood(X, y), chosen)
    with threads_for(len(X)):
        return gp.with_parameters(optimise(objective, gp.parameters, method=method, steps=steps))


def optimise(objective: Objective, start: Array, *, method: Method, steps: int) -> Array:
    """The best parameters (P,) found from `start`, by a number of steps as `fit` counts them.

    "lbfgs" moves no parameter by more than `REACH`, so each must be a logarithm or of order 1.

    Raises:
        UsageError: unknown method, negative steps other than of "minimize". NumericalError: not finite at
            the start.
    """
    check_method(method)
    if method == "minimize":
        return minimize(objective, start, steps).x
    if steps < 0:
        raise UsageError("negative steps count function evaluations and need method 'minimize'")
    return (_descent if method == "descent" else _lbfgs)(objective, start, steps)


class Likely(Protocol):
    """A process before any data."""

    def log_marginal_likelihood(self, X: Array, y: Array) -> tuple[float, Array]: ...


def joint_likelihood(gp: Likely, X: Array, Y: Array) -> tuple[float, Array]:
    """log p(Y | X) and its gradient, of outputs Y (n,), or (n, m) that are alike but for chance."""
    pairs = [gp.log_marginal_likelihood(X, y) for y in columns_of(Y)]
    value, gradient = pairs[0]
    for other, slope in pairs[1:]:
        value, gradient = value + other, gradient + slope
    return value, gradient


def check_method(method: str) -> None:
    """UsageError if there is no such training method."""
    if method not in get_args(Method):
        names = ", ".join(get_args(Method))
        raise UsageError(f"unknown training method {method!r}", next_step=f"Use one of: {names}.")


def negative_posterior(likelihood: Objective, prior: Prior | None) -> Objective:
    """Negative log posterior density of parameters; infinite where the likelihood cannot be computed."""

    def objective(parameters: Array) -> tuple[float, Array]:
        try:
            value, gradient = likelihood(parameters)
        except NumericalError:
            return np.inf, np.zeros_like(parameters)
        if prior is not None:
            density, slope = prior.log_density(parameters)
            value, gradient = value + density, gradient + slope
        return -value, -gradient

    return objective


def _descent(objective: Objective, start: Array, steps: int) -> Array:
    """Where `steps` steps of RATE times the gradient lead; it ends where the objective cannot be computed."""
    value, gradient = objective(start)
    _require_finite(value)
    here = start
    for _ in range(steps):
        there = here - RATE * gradient
        value, gradient = objective(there)
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            break
        here = there
    return here


def _require_finite(value: float) -> None:
    if not np.isfinite(value):
        raise NumericalError("the likelihood is not finite at the start", next_step="Choose another start.")


def _lbfgs(objective: Objective, start: Array, steps: int) -> Array:
    first = objective(start)
    _require_finite(first[0])
    best = (first[0], start)

    def remembered(parameters: Array) -> tuple[float, Array]:
        nonlocal best
        # the search begins where the objective was just computed
        value, gradient = first if np.array_equal(parameters, start) else objective(parameters)
        if value < best[0]:
            best = (value, parameters.copy())
        # worse than all values so far, but finite: the line search turns back by itself
        return (value, gradient) if np.isfinite(value) else (abs(best[0]) * 1e3 + 1e10, gradient)

    bounds = [(p - REACH, p + REACH) for p in start]
    # a step of L-BFGS takes one or two evaluations; twenty end a search that has lost its way
    minimise(remembered, start, steps=steps, evaluations=20 * steps, bounds=bounds)
    return best[1]
