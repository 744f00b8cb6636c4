"""gpflash's exact Gaussian process (C++). Needs numpy and gpflash alone: it runs in any environment.

gpflash adds a nugget that bounds the condition number; the bound is set as high as it goes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gpflash
import numpy as np

Array = Any

NOTE = ""
ESTIMATED = -1.0
"""A noise variance below zero stands among the hyperparameters."""


def objective(X: Array, y: Array) -> Callable[[Array], tuple[float, Array]]:
    """Negative log marginal likelihood and gradient (D + 2,) at (log s0, log ℓ_1 .. log ℓ_D, log sn)."""
    data, options = gpflash.TrainingData(), gpflash.ModelOptions()
    data.X_ndim_ntrain_mat, data.f_train_vec, data.sig2_f_val = X.T, y, ESTIMATED
    options.kernel_id = gpflash.KernelId.SqExp
    options.has_mean_model_constant = False
    options.cond_max = gpflash.COND_MAX_LIMIT
    powers = np.array([2.0, *-np.ones(X.shape[1]), 2.0])  # s0², inverse lengths, sn²

    def evaluate(parameters: Array) -> tuple[float, Array]:
        hyperparameters = np.exp(powers * parameters)
        values = gpflash.HpVal()
        values.hp_sig2_k, values.hp_gamma_vec, values.hp_sig2_f_val = (
            hyperparameters[0],
            hyperparameters[1:-1],
            hyperparameters[-1],
        )
        result = gpflash.eval_mll(data, values, options, return_mll_gradient=True)
        slope = result.mll_hp_grad_struct
        gradient = [slope.d_mll_d_hp_sig2_k, *slope.d_mll_d_hp_gamma_vec, slope.d_mll_d_hp_sig2_f_val]
        return -result.mll, -powers * hyperparameters * np.array(gradient)

    return evaluate
