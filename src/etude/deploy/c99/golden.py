"""Golden vectors: states in and beyond the range trained on, in order, with what the model says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Index
from etude.deploy.c99.plan import Plan
from etude.deploy.states import log_of
from etude.models.given import followed

COUNT = 100
SEED = 20
SOURCE = "golden vectors"
BEYOND = 1.15
"""Half ranges that most of the states swing through; single ones leave the range that they are clamped to."""
LEAST = 0.1
"""Part of that with which the first swing: far from all points kernels have nothing to say."""
NOT_A_NUMBER, CLAMPED, UNTRAINED, LIMITED = 1, 2, 4, 8


@dataclass(frozen=True, eq=False)
class Golden:
    """A sequence from a state that was just begun.

    Attributes:
        inputs: (T, N). mean, variance, faded, gravity: (T, J), commands within their limits.
        flags: (T,) of the mean.
    """

    inputs: Array
    mean: Array
    variance: Array
    faded: Array
    gravity: Array
    flags: Index


def golden(plan: Plan, count: int = COUNT, seed: int = SEED, *, single: bool = False) -> Golden:
    """Vectors of a plan: every state swings to and fro, so that what remembers directions is asked.

    Args:
        single: inputs that are numbers of float, as its caller has them.
    """
    rng = np.random.default_rng(seed)
    middle = 0.5 * (plan.trained_low + plan.trained_high)
    half = 0.5 * (plan.trained_high - plan.trained_low)
    half = np.where(plan.trained_high >= 1e6, 10.0, half)
    t = np.linspace(0.0, 1.0, count)[:, None]
    cycles = rng.uniform(1.0, 9.0, size=len(half))
    growing = BEYOND * np.linspace(LEAST, 1.0, count)[:, None]  # the first are near what was trained on
    states = middle + growing * half * np.sin(2.0 * np.pi * (cycles * t + rng.uniform(size=len(half))))
    states[::17] = middle + half * rng.uniform(-5.0, 5.0, size=states[::17].shape)
    if single:
        states = states.astype(np.float32).astype(float)
    return answered(plan, states)


def answered(plan: Plan, states: Array) -> Golden:
    """What the model says of states (T, N) in that order."""
    inside = np.clip(states, plan.low, plan.high)
    flags = UNTRAINED * np.any((states < plan.trained_low) | (states > plan.trained_high), axis=1).astype(int)
    flags |= CLAMPED * np.any(inside != states, axis=1).astype(int)
    log = followed(plan.model.inputs, log_of(plan.channels, inside, SOURCE))
    mean, variance = plan.model.predict(log)
    still = np.where(plan.still, 0.0, inside)
    gravity = plan.model.static(log_of(plan.channels, still, SOURCE))
    faded, _ = plan.model.faded(log)
    flags |= LIMITED * np.any((mean > plan.most) | (mean < plan.least), axis=1).astype(int)
    clipped = [np.clip(values, plan.least, plan.most) for values in (mean, faded, gravity)]
    return Golden(states, clipped[0], variance, clipped[1], clipped[2], flags)
