"""GPyTorch's exact Gaussian process. Needs numpy and GPyTorch alone: it runs in any environment.

Cholesky is forced: left alone, GPyTorch goes over to conjugate gradients and stochastic log determinants
above 800 points, which is another, inexact, computation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gpytorch
import numpy as np
import torch

Array = Any

NOTE = "Cholesky forced"


class _Process(gpytorch.models.ExactGP):  # type: ignore[misc, unused-ignore]
    def __init__(self, X: Any, y: Any) -> None:
        noise = gpytorch.likelihoods.GaussianLikelihood(noise_constraint=_logarithm())
        super().__init__(X, y, noise)
        smooth = gpytorch.kernels.RBFKernel(ard_num_dims=X.shape[1], lengthscale_constraint=_logarithm())
        self.mean = gpytorch.means.ZeroMean()
        self.kernel = gpytorch.kernels.ScaleKernel(smooth, outputscale_constraint=_logarithm())

    def forward(self, X: Any) -> Any:
        return gpytorch.distributions.MultivariateNormal(self.mean(X), self.kernel(X))


def objective(X: Array, y: Array) -> Callable[[Array], tuple[float, Array]]:
    """Negative log marginal likelihood and gradient (D + 2,) at (log s0, log ℓ_1 .. log ℓ_D, log sn)."""
    torch.set_num_threads(1)
    inputs, outputs = torch.from_numpy(X), torch.from_numpy(y)
    process = _Process(inputs, outputs).double()
    process.train()
    likelihood = gpytorch.mlls.ExactMarginalLogLikelihood(process.likelihood, process)
    tensors = [
        process.kernel.raw_outputscale,
        process.kernel.base_kernel.raw_lengthscale,
        process.likelihood.noise_covar.raw_noise,
    ]
    powers = np.array([2.0, *np.ones(X.shape[1]), 2.0])

    def evaluate(parameters: Array) -> tuple[float, Array]:
        parts = np.split(powers * parameters, [1, 1 + X.shape[1]])
        with torch.no_grad():
            for tensor, part in zip(tensors, parts):  # noqa: B905 (any Python)
                tensor.copy_(torch.from_numpy(part).reshape(tensor.shape))
        process.zero_grad()
        with _cholesky():
            value = -len(y) * likelihood(process(inputs), outputs)  # it divides by the number of samples
            value.backward()
        return value.item(), powers * np.concatenate([tensor.grad.numpy().ravel() for tensor in tensors])

    return evaluate


def _logarithm() -> Any:
    """Its own parameters are logarithms, as ours."""
    return gpytorch.constraints.Positive(transform=torch.exp, inv_transform=torch.log)


def _cholesky() -> Any:
    return gpytorch.settings.fast_computations(covar_root_decomposition=False, log_prob=False, solves=False)
