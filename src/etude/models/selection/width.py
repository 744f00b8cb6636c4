"""Widening of variances, so that intervals hold on unseen logs.

z2 of a log is the mean of its squared errors over predicted variances. Logs differ in it by e^1 and more, so
that few of them do not tell the next one's. Its logarithm is taken as normal,

    log z2 ~ N(log mean z2_g, s^2 (1 + 1 / G)),    s^2 = (nu s0^2 + sum (l_g - mean l)^2) / (nu - 1 + G),

with z2_g of G logs, each predicted from the others, l_g = log z2_g, and nu, s0 found across robots. Variances
are multiplied by the factor at which a normal error then lies within 1.96 deviations with probability .95.

Blocks of a single log tell little of the next: their z2 is raised by what the second log was found to add.
"""

from __future__ import annotations

import numpy as np

from etude.models.accuracy import NORMAL_95
from etude.types import Array, Index

LEAST_LOGS = 2
"""Logs from which one can be left out. Blocks of a single one say nothing of new motion."""
LEAST_ROWS = 4
"""Of a log that were predicted without it; fewer say nothing."""
PRIOR_LOGS, PRIOR_SPREAD = 4.0, 0.9
"""nu and s0 of the spread of log z2 from log to log."""
SECOND_LOG = 2.8
"""z2 of the next log over that of blocks of a single one, geometric mean across robots."""
COVERED = 0.95
"""Coverage of the predicted intervals."""
NARROWEST = 0.1
"""Least factor: errors that are nothing at all leave no variance."""
NODES = 40
"""Of the integral over log z2, exact beyond what float holds."""


def widths(error: Array, variance: Array, fold: Index, trajectories: int) -> Array:
    """(J,) factors on variances (n, J) of samples left out with errors (n, J); NaN where not predicted.

    fold: (n,) what each sample was left out with; blocks where there is a single trajectory.
    """
    factors = np.ones(error.shape[1])
    for j, (e, v) in enumerate(zip(error.T, variance.T, strict=True)):
        finite = np.isfinite(e) & np.isfinite(v)
        z2 = e[finite] ** 2 / v[finite]
        by_fold = [z2[fold[finite] == number] for number in np.unique(fold[finite])]
        means = np.array([np.mean(one) for one in by_fold if len(one) >= LEAST_ROWS])
        if len(means):
            factors[j] = max(_factor(np.maximum(means, np.finfo(float).tiny), trajectories), NARROWEST)
    return factors


def _factor(z2: Array, trajectories: int) -> float:
    """Of one command, by z2 (G,) of each log or block."""
    if trajectories < LEAST_LOGS:
        return SECOND_LOG * float(z2.mean()) * coverage_factor(PRIOR_SPREAD)
    logs, G = np.log(z2), len(z2)
    squares = float(np.sum((logs - logs.mean()) ** 2))
    spread = np.sqrt((PRIOR_LOGS * PRIOR_SPREAD**2 + squares) / (PRIOR_LOGS - 1.0 + G) * (1.0 + 1.0 / G))
    return float(z2.mean()) * coverage_factor(float(spread))


def coverage_factor(spread: float) -> float:
    """The factor on a variance at which intervals of 95 % hold, where log z2 ~ N(0, spread^2)."""
    from scipy.special import ndtr

    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / weights.sum()
    low, high = -2.0, 10.0 + 2.0 * spread**2
    for _ in range(60):  # halved so often that nothing is left of it
        middle = 0.5 * (low + high)
        inside = 2.0 * ndtr(NORMAL_95 * np.exp(0.5 * (middle - spread * nodes))) - 1.0
        low, high = (middle, high) if weights @ inside < COVERED else (low, middle)
    return float(np.exp(0.5 * (low + high)))
