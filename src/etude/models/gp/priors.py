"""Weak priors on hyperparameters: independent normals on their logarithms (log-normal on the values)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.models.gp.kernels import Kernel
from etude.types import Array

LENGTH_DEVIATION = 1.5
AMPLITUDE_DEVIATION = 1.0
SLOPE_DEVIATION = 1.5
NOISE_DEVIATION = 1.5
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
