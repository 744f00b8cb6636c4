"""The mean of several outputs at one input, as fast as Python allows: for a controller's tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.kernels import SquaredExponential

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointMean:
    """Means of m exact posteriors (dictionaries included) with one squared exponential kernel each.

    Choose it where one input at a time has to be answered, and no variance: `ExactPosterior.predict` spends
    most of such a call on checks, and would do so m times. All outputs share one array, already in units of
    the lengths; outputs with fewer points than others are filled up with points of weight zero.

    Attributes:
        points: (m, n, D) training inputs, centred, in lengths.
        exponents: (m, n) 2 log s0 - |u|²/2 of these.
        weights: (m, n) K_y^-1 y.
        rates: (m, D) 1/ℓ. shifts: (m, D) the centre in lengths.
        ceiling: (m, 1) 2 log s0, above which only rounding could lift an exponent.
    """

    points: Array
    exponents: Array
    weights: Array
    rates: Array
    shifts: Array
    ceiling: Array

    @classmethod
    def of(cls, posteriors: Sequence[ExactPosterior]) -> PointMean:
        """From one posterior per output.

        Raises:
            UsageError: no posterior, inputs of different widths, or another kernel than the squared
                exponential of all inputs with its amplitude.
        """
        widths = {posterior.X.shape[1] for posterior in posteriors}
        if len(widths) != 1:
            raise UsageError(f"posteriors must share their inputs, one at least; widths: {sorted(widths)}")
        D, n = widths.pop(), max(len(posterior.X) for posterior in posteriors)
        thetas = np.stack([_theta(posterior, D) for posterior in posteriors])
        rates = np.exp(-thetas[:, 1:])
        centres = np.stack([posterior.X.mean(axis=0) for posterior in posteriors])
        points, weights = np.zeros((len(posteriors), n, D)), np.zeros((len(posteriors), n))
        for j, posterior in enumerate(posteriors):
            points[j, : len(posterior.X)] = (posterior.X - centres[j]) * rates[j]
            weights[j, : len(posterior.X)] = posterior.alpha
        ceiling = 2.0 * thetas[:, :1]
        exponents = ceiling - 0.5 * np.einsum("mnd,mnd->mn", points, points)
        return cls(points, exponents, weights, rates, centres * rates, ceiling)

    def __call__(self, x: Array) -> Array:
        """Means (m,) at x (D,), thesis (2.5); NaN where x is not finite, UsageError for another shape."""
        if x.shape != self.rates.shape[1:]:
            raise UsageError(f"expected one input of shape {self.rates.shape[1:]}, got {x.shape}")
        u = x * self.rates - self.shifts
        # -|u - v|²/2 = u·v - |v|²/2 - |u|²/2: one matrix-vector product for each output
        K = np.matmul(self.points, u[:, :, None])[:, :, 0]
        K += self.exponents
        K -= 0.5 * np.einsum("md,md->m", u, u)[:, None]
        np.minimum(K, self.ceiling, out=K)
        np.exp(K, out=K)
        return np.asarray(np.einsum("mn,mn->m", K, self.weights))


def _theta(posterior: ExactPosterior, D: int) -> Array:
    if posterior.kernel != SquaredExponential(tuple(range(D))):
        raise UsageError(
            f"a point mean needs a squared exponential kernel of all {D} inputs, not {posterior.kernel}",
            next_step="Use the posterior's own mean.",
        )
    return posterior.theta
