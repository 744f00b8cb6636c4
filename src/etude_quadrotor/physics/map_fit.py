"""Least squares with a prior in physical scale, for models that are nearly linear in their coefficients."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Linearised = Callable[[Array], tuple[Array, Array]]

STEPS = 6
LEAST_VARIANCE = 1e-12
"""Of the residual, as a part of the commands' mean square: below it the data agree to rounding."""


TOLD = 0.99
"""A posterior deviation above this part of the prior's says that the data do not tell."""


def map_fit(
    linearised: Linearised, command: Array, deviation: Array, weight: float, use: Mask | None = None
) -> tuple[Array, Array]:
    """Coefficients (P,) that maximise the posterior density, by Gauss-Newton steps from 0; their deviations.

    A deviation is infinite where the data do not tell.

    The residual's variance is estimated along the way; coefficients are N(0, deviation²).

    Args:
        linearised: coefficients (P,) -> predictions (n, m) and their derivative (n, m, P).
        command: (n, m) what is to be predicted.
        deviation: (P,) of the prior.
        weight: votes of one sample.
        use: (n, m) which commands say something; None: all.

    Raises:
        DataError: no sample, or values that are not finite.
    """
    theta, normal = np.zeros(len(deviation)), np.eye(len(deviation))
    every = use is None or bool(use.all())
    said = command if every else command[use]
    if not said.size:
        raise DataError("there is no sample to identify a model from", next_step="Tell a flight first.")
    for _ in range(STEPS):
        predicted, jacobian = linearised(theta)
        if not every:
            predicted, jacobian = predicted[use], jacobian[use]
        residual = said - predicted
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            raise DataError(
                "states or commands contain NaN or infinite values", next_step="Repair the log first."
            )
        variance = max(float(np.mean(residual**2)), LEAST_VARIANCE * float(np.mean(said**2)), 1e-300)
        J = jacobian.reshape(-1, len(theta)) * deviation  # every coefficient in units of its prior deviation
        normal = weight / variance * (J.T @ J) + np.eye(len(theta))
        slope = weight / variance * (J.T @ residual.ravel()) - theta / deviation
        theta = theta + deviation * np.linalg.solve(normal, slope)
    left = deviation * np.sqrt(np.diag(np.linalg.inv(normal)))
    return theta, np.where(left > TOLD * deviation, np.inf, left)
