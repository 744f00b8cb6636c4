"""scikit-learn's exact Gaussian process. Needs numpy and scikit-learn alone: it runs in any environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

Array = Any

NOTE = ""


def objective(X: Array, y: Array) -> Callable[[Array], tuple[float, Array]]:
    """Negative log marginal likelihood and gradient (D + 2,) at (log s0, log ℓ_1 .. log ℓ_D, log sn)."""
    kernel = ConstantKernel() * RBF(np.ones(X.shape[1])) + WhiteKernel()
    process = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, y)
    powers = np.array([2.0, *np.ones(X.shape[1]), 2.0])  # its own are logarithms of variances

    def evaluate(parameters: Array) -> tuple[float, Array]:
        value, gradient = process.log_marginal_likelihood(
            powers * parameters, eval_gradient=True, clone_kernel=False
        )
        return -float(value), -powers * gradient

    return evaluate
