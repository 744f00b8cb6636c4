"""Evidence of a change in one log against the model in use: its size, its onset, and the alarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from etude.abilities import SupportsVariations
from etude.models.change.change_detection import ALARM, detection_variances, evidence, first_alarm, scores
from etude.models.change.diagnosis import (
    Cause,
    ExpectedCommands,
    Size,
    alone,
    cause,
    frozen_sensor,
    rate_of,
    size_of,
)
from etude.models.change.payload_estimate import load_of
from etude.models.learned_model import LearnedModel
from etude.protocols import Mean
from etude.types import Array, Mask, Samples

MOST_ROWS = 200
"""Enough to name a cause by."""


@dataclass(frozen=True, eq=False)
class ChangeTest:
    """What became of the test.

    Attributes:
        evidence: (n,) after each sample, nats.
        alarm: the first sample with enough of it, or by which a sensor is certainly stuck; None if there is
            none.
        z2: mean square of the errors over their predicted deviations.
        cause: what has changed; "unknown" as long as there is no alarm.
        output: the command that holds nearly all of the errors, if one does.
        size: of what has changed, where the cause has one number.
        sizes: (B,) root mean squares of the errors over their deviations, `detection_variances`, in blocks of
            `drift_onset.BLOCK_S`.
    """

    evidence: Array
    alarm: int | None
    z2: float
    cause: Cause = "unknown"
    output: int | None = None
    size: Size | None = None
    sizes: Array = field(default_factory=lambda: np.zeros(0))


def change_test(model: LearnedModel, samples: Samples, body: Mean | None = None) -> ChangeTest:
    """The test of one log's samples, in the order of time, where they move.

    Args:
        body: what a model file says of the commands by itself.

    Raises:
        KeyError: the log lacks an input of the model.
    """
    mean, variance, noise = model.parted(samples.log)
    error, deviation = samples.command - mean, np.sqrt(detection_variances(variance, noise))
    use = samples.usable & samples.moving
    z = error / deviation
    worth = np.minimum(model.worth(), 1.0)
    cumulative = _evidence(scores(z, model.freedom), worth, model.different, use)
    z2 = float(np.mean(error[use] ** 2 / variance[use])) if use.any() else 0.0
    at, held = first_alarm(cumulative, ALARM), frozen_sensor(samples)
    quiet = ChangeTest(cumulative, at, z2, sizes=block_sizes(samples.t, np.where(use, z, np.nan)))
    if held is not None:
        first = held[1] if at is None else min(at, held[1])
        return replace(quiet, alarm=first, cause="stuck", output=held[0])
    if at is None:
        return quiet
    motion = _motion(model, samples)
    what: Cause = "unknown"
    size = None
    if motion is not None:
        rows = np.unique(np.linspace(0, len(samples) - 1, MOST_ROWS).astype(np.int64))
        static, velocity, acceleration = (part[rows] for part in motion)
        expected = _expected(model, samples.take(rows), mean[rows], body)
        motion_rows = static, velocity, acceleration
        what = cause(error[rows], deviation[rows], use[rows], motion_rows, expected)
        if what == "load" and not _is_load(model, samples, body):
            what = "unknown"
        size = size_of(what, error[rows], deviation[rows], use[rows], motion_rows, expected)
    return replace(quiet, cause=what, output=alone(error, deviation, use), size=size)


def _is_load(model: LearnedModel, samples: Samples, body: object) -> bool:
    """Whether the estimate of a load, which knows that warm drives err much as one does, finds it too; True
    without a model file.
    """
    return not isinstance(body, SupportsVariations) or load_of(model, samples, body).verdict == "load"


def _expected(model: LearnedModel, samples: Samples, mean: Array, body: Mean | None) -> ExpectedCommands:
    """What the model says of the commands, if positions were others."""
    log = samples.log
    channel = log.channels[log.channels["command"].acts_on]
    q = log[channel.name]

    def without(i: int, d: float) -> Array:
        return model.mean(log.put(channel, q - d * (np.arange(q.shape[1]) == i)))

    carried = body.links(log)[:, :, -1, 0] if isinstance(body, SupportsVariations) else None
    return ExpectedCommands(mean, np.ptp(q, axis=0), without, carried)


def _evidence(z: Array, worth: Array, different: float, use: Mask) -> Array:
    """(n,) of all outputs together, or of one alone where that is more: its odds are one in so many, and
    whatever happens in one of seven joints, six others speak against it. Together, outputs that err alike
    count once (different: `different_outputs`).
    """
    alone = [evidence(z[:, [j]], worth[[j]], use[:, [j]]) for j in range(z.shape[1])]
    return np.asarray(
        np.maximum(evidence(z, different * worth, use), np.max(alone, axis=0) - np.log(len(alone)))
    )


def _motion(model: LearnedModel, samples: Samples) -> tuple[Array, Array, Array] | None:
    """Static part, velocity and acceleration (n, J) each; None unless the commands do work on coordinates
    whose rates the samples have.
    """
    rate = rate_of(samples.log, samples.log.channels["command"].acts_on)
    second = rate_of(samples.log, rate)
    if not second or samples.log[rate].shape != samples.command.shape:
        return None
    return model.static(samples.log, fade=False), samples.log[rate], samples.log[second]


BLOCK_S = 10.0
"""s of motion that make one figure: errors within it are alike."""
LEAST_LOGS = 3
"""Fewer show no drift: within a log the motion changes as much as the robot."""
SMOOTHER = 0.7
"""Most that a ramp may leave of what a step leaves, to be believed."""

DriftOnset = Literal["at once", "little by little", "cannot tell"]


def drift_onset(sizes: Sequence[Array]) -> DriftOnset:
    """How a change came.

    Args:
        sizes: of each log, oldest first, (B,) root mean squares of the errors over their predicted deviations
            in blocks of `BLOCK_S`.
    """
    if len(sizes) < LEAST_LOGS:
        return "cannot tell"
    r = np.concatenate(sizes)
    i = np.arange(len(r), dtype=float)
    step = min(_rss(r, (i >= at).astype(float)) for at in range(1, len(r)))
    ramps = [_rss(r, np.maximum(i - at, 0.0), rising=True) for at in range(len(r) - 2)]
    return "little by little" if min(ramps) <= SMOOTHER * step else "at once"


def block_sizes(t: Array, z: Array) -> Array:
    """(B,) root mean squares of z (n, J), NaN where it says nothing, in blocks of `BLOCK_S` of t (n,) s."""
    finite = np.isfinite(z)
    has_values = finite.any(axis=1)
    squares = np.where(finite, z, 0.0) ** 2
    mean = squares.sum(axis=1) / np.maximum(finite.sum(axis=1), 1)
    block = ((t - t[0]) / BLOCK_S).astype(np.int64)[has_values] if len(t) else np.zeros(0, dtype=np.int64)
    return np.array([np.sqrt(mean[has_values][block == b].mean()) for b in np.unique(block)])


def _rss(r: Array, feature: Array, *, rising: bool = False) -> float:
    """Squares of r (n,) about a constant and so much of the feature; infinite where that falls."""
    columns = np.column_stack([np.ones_like(r), feature])
    weights = np.linalg.lstsq(columns, r, rcond=None)[0]
    return np.inf if rising and weights[1] <= 0.0 else float(np.sum((r - columns @ weights) ** 2))
