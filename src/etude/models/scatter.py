"""Standard error of an estimate, from the scatter of its score."""

from __future__ import annotations

import numpy as np

from etude.types import Array


def scattered(posterior: Array, prior: Array, scores: Array, least: float) -> Array:
    """The covariance (p, p) of a maximum a posteriori estimate (White 1980; Liang and Zeger 1986).

    With H^-1 the posterior covariance, P_0 the prior one and s_b the score of stretch b of the samples it is
    H^-1 (P_0^-1 + sum_b s_b s_b') H^-1, and in no direction less than a part of H^-1: the scatter of few
    stretches is uncertain itself.

    Args:
        posterior: (p, p). prior: (p,) deviations. scores: (stretches, p) gradients of the log likelihood.
        least: that part.
    """
    scatter = posterior @ (scores.T @ scores + np.diag(prior**-2)) @ posterior
    # in units of the posterior's, direction by direction
    root = np.linalg.cholesky(posterior)
    inverse = np.linalg.inv(root)
    ratios, axes = np.linalg.eigh(inverse @ scatter @ inverse.T)
    return np.asarray(root @ (axes * np.maximum(ratios, least)) @ axes.T @ root.T)
