"""Golden vectors: states in and beyond the range trained on, in order, with what the model says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.deploy.c99.plan import UNBOUNDED, WIDENED, Plan
from etude.deploy.states import log_of
from etude.models.trust import outside, trust
from etude.types import Array, Index

COUNT = 100
SEED = 20
SOURCE = "golden vectors"
BEYOND = 1.15
"""Half ranges that most of the states swing through; single ones go far beyond."""
LEAST = 0.1
"""Part of that with which the first swing: far from all points kernels have nothing to say."""
NOT_A_NUMBER, FAR, UNTRAINED, LIMITED = 1, 2, 4, 8


@dataclass(frozen=True, eq=False)
class Golden:
    """A sequence from a state that was just begun.

    Attributes:
        inputs: (T, N). mean, variance, instant, gravity: (T, J), commands within their limits; those of
            instants
            count each row by itself.
        flags: (T,) of the mean.
    """

    inputs: Array
    mean: Array
    variance: Array
    instant: Array
    gravity: Array
    flags: Index


def golden(
    plan: Plan, count: int = COUNT, seed: int = SEED, *, single: bool = False, fade: bool = True
) -> Golden:
    """Vectors of a plan: every state swings to and fro, so that what remembers directions is asked.

    Args:
        single: inputs that are numbers of float, as its caller has them. fade: as of `LearnedModel.predict`.
    """
    rng = np.random.default_rng(seed)
    middle = 0.5 * (plan.low + plan.high)
    half = 0.5 * (plan.high - plan.low)
    half = np.where(plan.high >= UNBOUNDED, 10.0, half)
    t = np.linspace(0.0, 1.0, count)[:, None]
    cycles = rng.uniform(1.0, 9.0, size=len(half))
    growing = BEYOND * np.linspace(LEAST, 1.0, count)[:, None]  # the first are near what was trained on
    states = middle + growing * half * np.sin(2.0 * np.pi * (cycles * t + rng.uniform(size=len(half))))
    states[::17] = middle + half * rng.uniform(-5.0, 5.0, size=states[::17].shape)
    if single:
        states = states.astype(np.float32).astype(float)
    return answered(plan, states, fade=fade)


def answered(plan: Plan, states: Array, *, fade: bool = True) -> Golden:
    """What the model says of states (T, N) in that order."""
    model, log = plan.model, log_of(plan.channels, states, SOURCE)
    found = model.predict(log, fade=fade)
    instant = model.predict(dict(log.values), fade=fade).mean
    gravity = model.static(log_of(plan.channels, np.where(plan.still, 0.0, states), SOURCE), fade=fade)
    flags = _flags(plan, states, found.unknown, fade)
    flags |= LIMITED * np.any((found.mean > plan.most) | (found.mean < plan.least), axis=1).astype(int)
    mean, alone, held = (np.clip(v, plan.least, plan.most) for v in (found.mean, instant, gravity))
    return Golden(states, mean, found.variance, alone, held, flags)


def _flags(plan: Plan, states: Array, unknown: Array, fade: bool) -> Index:
    """(T,) by what is unknown of commands; without fading by ranges, since nothing else is computed."""
    if fade:
        beyond = outside(unknown, plan.model.known)
        far = trust(unknown, plan.model.signal_deviation, plan.model.known) <= 0.0
    else:
        wide = WIDENED * (plan.high - plan.low)
        beyond = (states < plan.low) | (states > plan.high)
        far = (states < plan.low - wide) | (states > plan.high + wide)
    return np.asarray(UNTRAINED * beyond.any(axis=1).astype(int) | FAR * far.any(axis=1).astype(int))
