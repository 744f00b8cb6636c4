"""How far a model's deviations are believed: not so far that they refuse what the robot has done.

After little motion a model may say deviations, at reversals above all, with which the very motion that taught
it would leave the limits, though the robot has run it within them. What is wrong then is the deviation. Were
it counted in full, hardly any motion would be left, and those without content.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.limits.commands import LOOK, SELDOM, CommandLimit
from etude.protocols import Limit, Trajectory
from etude.types import Array

ROOM = 2.0 / 3.0
"""Part of the room beside the mean that deviations may use along a motion that was run: the next one is
another, whose deviations may be half as large again."""
NEAR = 0.9
"""Part of half a limit beyond which a mean proves nothing: there the robot may have been at its limit."""
LEAST = 0.25
"""Part of the deviations that always counts: with the usual factor of 4 about one of them."""


def after_run(limits: Sequence[Limit], ran: Trajectory) -> list[Limit]:
    """The limits, those of commands with the part of each deviation that the motion `ran` leaves credible."""
    return [_after(limit, ran) if isinstance(limit, CommandLimit) else limit for limit in limits]


def _after(limit: CommandLimit, ran: Trajectory) -> CommandLimit:
    if limit.deviation is None:
        return limit
    share = credible(limit, ran)
    short = [j for j in range(len(share)) if share[j] < 1.0]
    if not short:
        return limit
    parts = ", ".join(f"{limit.names[j]} {100.0 * share[j]:.0f} %" for j in short)
    sentence = (
        f"The {limit.quantity} in full: of the learned model's deviations there count {parts}. With all of "
        "them it would refuse the motion that the robot has run last: it knows too little yet."
    )
    return replace(limit, share=share, said=(*limit.said, sentence), _proofs={})


def credible(limit: CommandLimit, ran: Trajectory) -> Array:
    """(J,) largest parts, at most 1 and at least `LEAST`, of the deviations with which the motion is kept."""
    motion = limit.along(ran, LOOK)
    mean, spread = limit.mean(motion), limit.spread(motion, ran.duration, SELDOM)
    half = 0.5 * (limit.upper - limit.lower)
    off = np.abs(mean - 0.5 * (limit.upper + limit.lower))
    told = (off <= NEAR * half) & (spread > 0.0)
    with np.errstate(divide="ignore"):
        parts = np.where(told, ROOM * (half - off) / spread, np.inf)
    return np.asarray(np.clip(parts.min(axis=0), LEAST, 1.0))
