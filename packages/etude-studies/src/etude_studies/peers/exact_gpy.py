"""GPy's exact Gaussian process. Needs numpy and GPy alone: it runs in any environment.

GPy adds 1e-8 to the noise variance; the agreement row shows what that does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import GPy
import numpy as np

Array = Any

NOTE = ""


def objective(X: Array, y: Array) -> Callable[[Array], tuple[float, Array]]:
    """Negative log marginal likelihood and gradient (D + 2,) at (log s0, log ℓ_1 .. log ℓ_D, log sn)."""
    kernel = GPy.kern.RBF(X.shape[1], ARD=True)
    model = GPy.models.GPRegression(X, y[:, None], kernel)
    powers = np.array([2.0, *np.ones(X.shape[1]), 2.0])

    def evaluate(parameters: Array) -> tuple[float, Array]:
        hyperparameters = np.exp(powers * parameters)  # s0², lengths, sn²
        model[:] = hyperparameters  # computes everything once
        return -float(model.log_likelihood()), -powers * hyperparameters * model.gradient

    return evaluate
