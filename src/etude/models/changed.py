"""Is this log of the robot that the model knows? Wald's sequential test of its errors, and what has changed.

With z = (command - mean) / deviation of each output, the errors of an unchanged robot are N(0, 1) and those
of a changed one N(0, kappa^2); the logarithm of their likelihood ratio is summed from sample to sample, never
below 0 (Page 1954). Errors of neighbouring samples are alike, so each counts `worth` of an independent one.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from etude.contracts import Array, Mask

KAPPA2 = 4.0
"""Variance of a changed robot's errors over that of an unchanged one's: the deviation doubles."""
ALARM = 100.0
"""Evidence from which the robot has changed; docs/decisions/0025 has what unchanged and changed ones reach.
Of a single log nothing is said: what a new motion teaches its model looks like another robot."""
NAMED, AHEAD = 0.5, 0.5
"""Least share of the errors' variation that names a cause; of what the next leaves, it has to leave less."""
VARYING, CONSTANT = 1.5, 0.6
"""Mean square of z about its mean above which errors vary beyond chance; least share of a constant."""

Cause = Literal["load", "friction", "offset", "unknown"]


def evidence(z: Array, worth: Array, use: Mask | None = None, scale: Array | float = 1.0) -> Array:
    """(n,) evidence of a changed robot after each sample, nats; see `ALARM`.

    S <- max(0, S + sum_j g_j/2 (z_j^2/c_j (1 - 1/kappa^2) - ln kappa^2)).

    Args:
        z: (n, J) errors over predicted deviations, in the order of time.
        worth: (J,) g, independent samples that a sample is worth.
        use: (n, J) samples that say something; None: all.
        scale: (J,) c, mean of z^2 on held-out motion of the same robot; 1 where variances are calibrated.
    """
    gain = 0.5 * worth * (z**2 / scale * (1.0 - 1.0 / KAPPA2) - np.log(KAPPA2))
    steps = np.where(np.ones_like(z, dtype=bool) if use is None else use, gain, 0.0).sum(axis=1)
    found, total = np.empty(len(steps)), 0.0
    for i, step in enumerate(steps.tolist()):
        total = max(0.0, total + step)
        found[i] = total
    return found


def first_alarm(found: Array, alarm: float) -> int | None:
    """The first sample at which the evidence is above `alarm`; None if it never is."""
    above = np.flatnonzero(found > alarm)
    return int(above[0]) if len(above) else None


def cause(error: Array, deviation: Array, use: Mask, motion: tuple[Array, Array, Array]) -> Cause:
    """What the errors (n, J) of a changed robot follow most, or "unknown" where two are alike.

    A load changes what gravity and inertia take: the errors follow the static parts and the accelerations.
    Friction follows the sign of the velocity and the velocity. An offset is constant, and so is a load's
    gravity in poses that are much alike: where the errors hardly vary the two cannot be told apart.

    Args:
        deviation: (n, J) predicted, by which outputs are weighed.
        use: (n, J) samples that say something.
        motion: static part (n, J), velocity (n, J) and acceleration (n, J).
    """
    static, velocity, acceleration = motion
    body = np.column_stack([static, acceleration])
    total, varying, count, load, friction = 0.0, 0.0, 0, 0.0, 0.0
    for j, own in enumerate(use.T):
        if own.sum() < 3 * (body.shape[1] + 1):
            continue
        z = error[own, j] / deviation[own, j]
        rest = z - z.mean()
        top = max(float(np.abs(velocity[own, j]).max()), 1e-300)
        rub = np.column_stack([np.tanh(velocity[own, j] / (0.05 * top)), velocity[own, j]])
        total, varying, count = total + float(z @ z), varying + float(rest @ rest), count + len(z)
        friction += _explained(rest, rub)
        load += _explained(rest, body[own])
    if not count:
        return "unknown"
    if varying > VARYING * count and max(load, friction) >= NAMED * varying:
        left = varying - np.array([load, friction])
        if left.min() <= AHEAD * left.max():
            return "load" if load > friction else "friction"
    return "offset" if total - varying >= CONSTANT * total else "unknown"


def _explained(error: Array, features: Array) -> float:
    """Squares of a centred error (n,) that features (n, p) explain, less what as many random ones would."""
    columns = features - features.mean(axis=0)
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if not columns.shape[1]:
        return 0.0
    basis = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    Q = basis[0][:, basis[1] > 1e-8 * basis[1][0]]
    by_chance = Q.shape[1] / len(error) * float(error @ error)
    found: float = float(np.sum((Q.T @ error) ** 2)) - by_chance
    return max(0.0, found)
