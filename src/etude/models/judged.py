"""One log against the model in use: the evidence of a changed robot, when it was enough, and of what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Samples
from etude.models.cause import Cause, Expected, alone, cause
from etude.models.changed import ALARM, evidence, first_alarm, scores
from etude.models.model import LearnedModel
from etude.models.stuck import stuck

STEP = 1e-4
"""Of a position's range in the log, by which it is moved to see how the commands change with it."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of the test.

    Attributes:
        evidence: (n,) after each sample, nats.
        alarm: the first sample with enough of it, or by which a sensor is certainly stuck; None if there is
            none.
        z2: mean square of the errors over their predicted deviations.
        cause: what has changed; "unknown" as long as there is no alarm.
        output: the command that holds nearly all of the errors, if one does.
    """

    evidence: Array
    alarm: int | None
    z2: float
    cause: Cause = "unknown"
    output: int | None = None


def judged(model: LearnedModel, samples: Samples) -> Judged:
    """The test of one log's samples, in the order of time, where they move.

    Raises:
        KeyError: the log lacks an input of the model.
    """
    mean, variance = model.predict(samples.log)
    error, deviation = samples.command - mean, np.sqrt(variance)
    use = samples.usable & samples.moving
    z = error / deviation
    found = evidence(scores(z, model.freedom), np.minimum(model.worth(), 1.0), use)
    z2 = float(np.mean(z[use] ** 2)) if use.any() else 0.0
    at, held = first_alarm(found, ALARM), stuck(samples)
    if held is not None:
        return Judged(found, held[1] if at is None else min(at, held[1]), z2, "stuck", held[0])
    if at is None:
        return Judged(found, None, z2)
    motion = _motion(model, samples)
    what: Cause = "unknown"
    if motion is not None:
        what = cause(error, deviation, use, motion, Expected(mean, _bends(model, samples)))
    return Judged(found, at, z2, what, alone(error, deviation, use))


def _bends(model: LearnedModel, samples: Samples) -> Array:
    """(k, n, J) how each command changes with each position."""
    log, found = samples.log, []
    channel = log.channels[log.channels["command"].acts_on]
    q = log[channel.name]
    for i, span in enumerate(np.ptp(q, axis=0).tolist()):
        step = np.zeros_like(q)
        step[:, i] = STEP * span
        if span > 0.0:
            ends = (model.mean(log.put(channel, q + sign * step)) for sign in (1.0, -1.0))
            found.append(np.subtract(*ends) / (2.0 * STEP * span))
    return np.stack(found) if found else np.zeros((0, *samples.command.shape))


def _motion(model: LearnedModel, samples: Samples) -> tuple[Array, Array, Array] | None:
    """Static part, velocity and acceleration (n, J) each; None unless the commands do work on coordinates
    whose rates the samples have.
    """
    rate = _rate_of(samples, samples.log.channels["command"].acts_on)
    second = _rate_of(samples, rate)
    if not second or samples.log[rate].shape != samples.command.shape:
        return None
    return model.static(samples.log), samples.log[rate], samples.log[second]


def _rate_of(samples: Samples, name: str) -> str:
    """The channel that is the rate of that one; "" if there is none."""
    found = (n for n, c in samples.log.channels.items() if name and c.derivative_of == name)
    return next(found, "")
