"""Change detection: Wald's sequential test of a log's prediction errors.

With z = (command - mean) / deviation of each output, the scores of an unchanged robot's errors are N(0, 1)
and those of a changed one N(0, kappa^2); the logarithm of their likelihood ratio is summed from sample to
sample, never below 0 (Page 1954). Errors of neighbouring samples are alike, so each counts `worth` of an
independent one.

Errors of an unchanged robot have heavy tails: near a reversal, or in a state that is new, a few of them are
ten deviations large. A normal distribution takes those few for another robot. So errors are held against
Student's t with the tails that held-out ones have, and `scores` are the normal deviates of the same odds.
"""

from __future__ import annotations

import numpy as np

from etude.models.student_t import fit_student
from etude.types import Array, Index, Mask

KAPPA2 = 4.0
"""Variance of a changed robot's scores over that of an unchanged one's: the deviation doubles."""
FREEDOM, MOST_FREEDOM = 5.0, 20.0
"""Degrees of freedom of Student's t where no errors were held out, and most that are believed of some."""
ALARM = 10.0
"""Evidence from which the robot has changed. Among n independent samples chance passes h with a probability
of about n exp(-h): 60 of them pass 10 in one run of 400."""
BLOCKS = 12
"""Parts of a trajectory that are long against the time in which errors are alike: 5 s of a minute."""
FARTHEST = 1e12
"""Deviations beyond which all errors are equally impossible."""


def student_freedom(z: Array) -> float:
    """Degrees of freedom of Student's t for errors over predicted deviations; NaN where not held out."""
    fitted = fit_student(z[np.isfinite(z)])
    return FREEDOM if fitted is None else min(MOST_FREEDOM, fitted.freedom)


def scores(z: Array, freedom: float) -> Array:
    """Normal deviates, of z's shape and signs, as improbable as these errors are for Student's t."""
    from scipy.special import ndtri, stdtr

    tail = stdtr(freedom, -np.minimum(np.abs(z), FARTHEST))
    return np.asarray(-np.sign(z) * ndtri(tail))


def detection_variances(variance: Array, noise: Array) -> Array:
    """(n, J) variances that errors are held against: of what the model does not know `KAPPA2` times its own.

    How far it errs where it knows little is hardly calibrated: no held-out motion went there. A deviation
    that is twice as large there is no other robot; where the model knows, and noise is left, it is one.

    Args:
        variance, noise: (n, J) predicted, and the part of it that is noise.
    """
    return np.asarray(variance + (KAPPA2 - 1.0) * np.maximum(variance - noise, 0.0))


def evidence(z: Array, worth: Array, use: Mask | None = None) -> Array:
    """(n,) evidence of a changed robot after each sample, nats; see `ALARM`.

    S <- max(0, S + sum_j g_j/2 (z_j^2 (1 - 1/kappa^2) - ln kappa^2)).

    Args:
        z: (n, J) scores of errors over predicted deviations, in the order of time.
        worth: (J,) g, independent samples that a sample is worth.
        use: (n, J) samples that say something; None: all.
    """
    gain = 0.5 * worth * (z**2 * (1.0 - 1.0 / KAPPA2) - np.log(KAPPA2))
    steps = np.where(np.ones_like(z, dtype=bool) if use is None else use, gain, 0.0).sum(axis=1)
    cumulative, total = np.empty(len(steps)), 0.0
    for i, step in enumerate(steps.tolist()):
        total = max(0.0, total + step)
        cumulative[i] = total
    return cumulative


def first_alarm(cumulative: Array, alarm: float) -> int | None:
    """The first sample at which the evidence is above `alarm`; None if it never is."""
    above = np.flatnonzero(cumulative > alarm)
    return int(above[0]) if len(above) else None


def independence(z: Array, freedom: float, t: Array, group: Index, use: Mask) -> Array:
    """(J,) independent samples that one sample is worth to `evidence`, from held-out errors.

    The evidence sums squares, so it is theirs that must be independent: errors that change their sign from
    sample to sample still come in bursts. Between blocks of a trajectory they are; a sample is worth the
    variance of squared scores over that of their sums in blocks, times the samples in it. One figure for all
    outputs, since one alone has few blocks. 1 where nothing was held out.

    Args:
        z: (n, J) errors over predicted deviations, NaN where not held out. freedom: their `student_freedom`.
        t, group: (n,) s, and the trajectory.
        use: (n, J) samples that say something, as for `evidence`; those of them that were not held out add
            nothing.
    """
    power = summed = 0.0
    finite = np.isfinite(z) & use
    for number in np.unique(group):
        inside = group == number
        block = _blocks(t[inside])
        for column, mask in zip(z[inside].T, finite[inside].T, strict=True):
            squared = scores(column[mask], freedom) ** 2
            centred = squared - squared.mean() if len(squared) else squared
            sums = np.bincount(block[mask], centred, BLOCKS)
            power += float(centred @ centred) * (1.0 - 1.0 / BLOCKS)  # what centring takes from the sums
            summed += float(sums @ sums)
    share = finite.sum() / max(int(use.sum()), 1)
    return np.full(z.shape[1], share * min(1.0, power / summed) if summed > 0.0 else 1.0)


def different_outputs(z: Array, freedom: float) -> float:
    """Share of the outputs that are different ones: 1 / J where all err alike, 1 where each errs by itself.

    J^2 / sum_jk rho_jk^2 of the J scores is the number of equal outputs whose sum of squares varies as much,
    since rho^2 correlates the squares of normal scores. Eight motors drive four degrees of freedom.

    Args:
        z: (n, J) errors over predicted deviations, NaN where not held out. freedom: their `student_freedom`.
    """
    finite = np.isfinite(z)
    values = np.where(finite, scores(np.where(finite, z, 0.0), freedom), 0.0)
    product = values.T @ values
    squares = np.diag(product)
    correlation = product**2 / np.maximum(np.outer(squares, squares), np.finfo(float).tiny)
    np.fill_diagonal(correlation, 1.0)
    return float(z.shape[1] / correlation.sum())


def _blocks(t: Array) -> Index:
    """(n,) the part of a trajectory, of equal duration, that each time is in."""
    part = (t - t.min()) / max(float(np.ptp(t)), np.finfo(float).tiny) * BLOCKS
    return np.asarray(np.minimum(part.astype(np.int64), BLOCKS - 1))
