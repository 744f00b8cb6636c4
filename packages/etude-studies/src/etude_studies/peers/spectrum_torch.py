"""A sparse spectrum process by torch's autograd. Needs numpy and torch alone: it runs in any environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

Array = Any

NOTE = "reverse mode of the same formula"


def objective(X: Array, y: Array) -> Callable[[Array], tuple[float, Array]]:
    """Negative log marginal likelihood and gradient at (log s0, log ℓ_1 .. log ℓ_D, log sn, points by row).

    The number m of spectral points (m, D) is read off the length of the parameters, D + 2 + m D.
    """
    torch.set_num_threads(1)
    inputs, outputs = torch.from_numpy(X), torch.from_numpy(y)

    def evaluate(parameters: Array) -> tuple[float, Array]:
        tensor = torch.tensor(parameters, dtype=torch.float64, requires_grad=True)
        value = _negative_log_likelihood(inputs, outputs, tensor)
        value.backward()
        return value.item(), tensor.grad.numpy()

    return evaluate


def _negative_log_likelihood(X: Any, y: Any, parameters: Any) -> Any:
    """Thesis 2.4: [yᵀy - bᵀA^-1 b]/(2 sn²) + log|A|/2 - m log(m sn²/s0²) + n/2 log(2π sn²)."""
    n, D = X.shape
    points = parameters[D + 2 :].reshape(-1, D)
    m = len(points)
    variance, noise = torch.exp(2.0 * parameters[0]), torch.exp(2.0 * parameters[D + 1])
    phases = X @ (points / torch.exp(parameters[1 : D + 1])).T
    P = torch.cat([torch.cos(phases), torch.sin(phases)], dim=1)
    ridge = m * noise / variance
    L = torch.linalg.cholesky(P.T @ P + ridge * torch.eye(2 * m, dtype=P.dtype))
    half = torch.linalg.solve_triangular(L, (P.T @ y)[:, None], upper=False)
    squares = y @ y - (half * half).sum()
    half_log_det = torch.log(L.diagonal()).sum() - m * torch.log(ridge)
    return 0.5 * squares / noise + half_log_det + 0.5 * n * torch.log(2.0 * np.pi * noise)
