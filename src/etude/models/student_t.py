"""Student's t distribution for prediction errors: their tails are heavier than a normal's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.types import Array

FREEDOMS = (2.2, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0, 50.0, 200.0)  # denser where the tails differ most
STEPS = 30  # of expectation maximisation


@dataclass(frozen=True)
class StudentT:
    """The distribution of error / predicted deviation.

    Attributes:
        freedom: degrees of freedom; large for a normal distribution.
        scale: of the distribution; 1 where predicted deviations are right.
    """

    freedom: float
    scale: float

    def log_density(self, ratio: Array) -> Array:
        """log p of each ratio error / deviation."""
        from scipy.special import gammaln

        nu = self.freedom
        constant = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
        tail = 0.5 * (nu + 1.0) * np.log1p((ratio / self.scale) ** 2 / nu)
        return np.asarray(constant - np.log(self.scale) - tail)


def fit_student(ratio: Array) -> StudentT | None:
    """Maximum likelihood over `FREEDOMS`, the scale by expectation maximisation; None of no errors."""
    squared = np.ravel(ratio) ** 2
    if not len(squared) or not np.any(squared > 0.0):
        return None
    candidates = [StudentT(nu, _scale(squared, nu)) for nu in FREEDOMS]
    return max(candidates, key=lambda t: float(np.mean(t.log_density(np.ravel(ratio)))))


def _scale(squared: Array, nu: float) -> float:
    variance = float(np.mean(squared))
    for _ in range(STEPS):
        weights = (nu + 1.0) / (nu + squared / variance)
        variance = float(np.mean(weights * squared))
    return float(np.sqrt(variance))
