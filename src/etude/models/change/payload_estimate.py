"""Payload estimate at the last link: mass and centre from a model's errors, with their uncertainty.

    command - predicted = links(states) [m, m c, I] + offset + error

The ten parameters are those of a rigid body in the link's frame, I near that of a ball about its centre; each
command may have an offset as large as its noise. What the model learned wrongly looks like a load too: how
much is seen on the logs that it was learned from, by physics identified without each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude.abilities import SupportsVariations
from etude.models.accuracy import NORMAL_95
from etude.models.change.change_detection import detection_variances
from etude.models.learned_model import LearnedModel
from etude.models.scatter import scattered
from etude.types import Array, Log, Samples

Verdict = Literal["load", "none", "cannot tell"]
SHOWN = 4.0
"""Deviations from which a mass is one: by chance in one of 16 000 runs."""
COARSE = 0.05
"""Of the mass that takes all of some command: a motion whose interval is wider cannot tell."""
REACH = 0.5
"""m: from the origin of the link to the centre of a load along an axis, more or less."""
ROUND = 0.1
"""m: radius of gyration that a load may have, more or less."""
FREE = 1e3
"""Prior deviation of what nothing is known of."""
STRETCH_S = 2.0
"""s of log whose errors are alike."""
LEAST = 1e-9
"""Of a command's reach, for each kg: below it is rounding."""
PASSES = 3
"""Of the centre, and of the inertia that goes with it."""


@dataclass(frozen=True, eq=False)
class Load:
    """What hangs at the last link, beyond what the model knows.

    Attributes:
        verdict: "none": a load that would matter is excluded; "cannot tell": it is not.
        mass: kg, less than 0 where something was put down; deviation of it.
        centre, centre_deviation: (3,) m in the frame of the link that the last axis moves.
        left: mean square of the errors that the load leaves, over the predicted variance.
    """

    verdict: Verdict
    mass: float
    deviation: float
    centre: Array
    centre_deviation: Array
    left: float

    @property
    def interval(self) -> tuple[float, float]:
        """kg, 95 %."""
        return self.mass - NORMAL_95 * self.deviation, self.mass + NORMAL_95 * self.deviation


def load_of(
    model: LearnedModel, samples: Samples, body: SupportsVariations, apparent: Array | None = None
) -> Load:
    """Of one log's samples, in the order of time.

    Args:
        apparent: (L, 10) loads that logs without one seem to have, as `apparent_loads`; None: not known.

    Raises:
        KeyError: the log lacks an input of the model.
    """
    mean, variance, noise = model.parted(samples.log)
    worth, deviation = np.minimum(model.worth(), 1.0), np.sqrt(detection_variances(variance, noise))
    offset = np.sqrt(noise.mean(axis=0))
    x, covariance, left = _regressed(samples.command - mean, deviation, offset, worth, samples, body)
    if apparent is not None and len(apparent):
        covariance[:10, :10] += apparent.T @ apparent / len(apparent)
    reach = np.array(samples.log.channels["command"].reach)
    return _load(x, covariance, left, whole_mass(samples.log, body, reach))


def apparent_loads(
    without: Mapping[int, Array], model: LearnedModel, samples: Samples, body: SupportsVariations
) -> Array:
    """(L, 10) loads that each log seems to carry, by physics that were identified without it.

    Args:
        without: by number of a group of the samples what physics without it say of all (n, J).
        samples: of the logs that the model was learned from, none of which carried anything.
    """
    loads, worth = [], np.minimum(model.worth(), 1.0)
    for number, mean in without.items():
        in_log = samples.group == number
        one = samples.take(in_log)
        error = one.command - mean[in_log]
        size = np.sqrt(np.mean(error**2, axis=0, where=one.usable & one.moving))
        if np.isfinite(size).all() and (size > 0.0).all():
            deviation = np.broadcast_to(size, error.shape)
            loads.append(_regressed(error, deviation, size, worth, one, body)[0][:10])
    return np.array(loads).reshape(-1, 10)


def load_forecast(
    model: LearnedModel,
    log: Log,
    gains: Array,
    body: SupportsVariations,
    mass: float,
    apparent: Array | None = None,
) -> Array:
    """(4, 4) covariance of mass and first moments, kg and kg m, that a motion would leave of a load.

    Args:
        log: states along the motion. gains: (n, J) roots of what its samples are worth.
        mass: kg, about that of the load. apparent: as of `load_of`.
    """
    _, variance, noise = model.parted(log)
    columns = _columns(log, body, gains / np.sqrt(detection_variances(variance, noise)))
    prior = _prior(np.sqrt(noise.mean(axis=0)), mass)
    covariance = np.linalg.inv(np.einsum("njp,njq->pq", columns, columns) + np.diag(prior**-2))[:4, :4]
    if apparent is not None and len(apparent):
        covariance = covariance + apparent[:, :4].T @ apparent[:, :4] / len(apparent)
    return np.asarray(covariance)


def _columns(log: Log, body: SupportsVariations, weight: Array) -> Array:
    """(n, J, 10 + J) commands for each parameter of a load and for each offset, times weight (n, J)."""
    n, J = weight.shape
    columns = np.zeros((n, J, 10 + J))
    columns[..., :10] = body.links(log)[:, :, -1]
    columns[..., 10:] = np.eye(J)
    return columns * weight[..., None]


def _prior(offset: Array, size: float) -> Array:
    """(10 + J,) deviations of a load of about `size` kg, and of each offset (J,)."""
    prior = np.concatenate([np.full(10, FREE), offset])
    prior[1:4], prior[4:10] = size * REACH, size * ROUND**2
    return prior


def _regressed(
    error: Array, deviation: Array, offset: Array, worth: Array, samples: Samples, body: SupportsVariations
) -> tuple[Array, Array, float]:
    """x (10 + J,), its covariance, and the mean square that is left, over the variance."""
    J = error.shape[1]
    use = samples.usable & samples.moving
    columns, z = _columns(samples.log, body, use / deviation), use * error / deviation
    H, g = np.einsum("j,njp,njq->pq", worth, columns, columns), np.einsum("j,njp,nj->p", worth, columns, z)
    prior, expected = np.concatenate([np.full(10, FREE), offset]), np.zeros(10 + J)
    for _ in range(PASSES):
        covariance = np.linalg.inv(H + np.diag(prior**-2))
        x = covariance @ (g + expected / prior**2)
        expected[4:10] = about_origin(float(x[0]), x[1:4])
        size = abs(float(x[0])) + float(np.sqrt(covariance[0, 0]))
        prior = _prior(offset, size)
    residual = z - columns @ x
    left = float(np.sum(worth * residual**2) / max(float(np.sum(worth * use)), 1.0))
    covariance = max(left, 1.0) * covariance
    stretch = np.floor((samples.t - samples.t[0]) / STRETCH_S).astype(np.int64)
    _, stretch = np.unique(stretch, return_inverse=True)
    scores = np.zeros((int(stretch.max()) + 1, 10 + J))
    np.add.at(scores, stretch, np.einsum("j,njp,nj->np", worth, columns, residual))
    return x, scattered(covariance, prior, scores, 1.0), left


def about_origin(mass: float, first: Array) -> Array:
    """(6,) inertia xx yy zz xy xz yz about the origin of a point mass with these first moments (3,)."""
    c = np.clip(first / mass, -REACH, REACH) if mass else np.zeros(3)
    full = mass * (c @ c * np.eye(3) - np.outer(c, c))
    return np.asarray(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])


def whole_mass(log: Log, body: SupportsVariations, reach: Array) -> float:
    """kg that would take all of some command (reach (J,)), somewhere on the way; 0 where no command holds the
    mass, since the link's origin lies on every axis.
    """
    most = float((np.abs(body.links(log)[:, :, -1, 0]).max(axis=0) / reach).max())
    return 1.0 / most if most > LEAST else 0.0


def _load(x: Array, covariance: Array, left: float, whole: float) -> Load:
    mass, deviation = float(x[0]), float(np.sqrt(covariance[0, 0]))
    if whole == 0.0:
        return Load("cannot tell", mass, deviation, np.zeros(3), np.full(3, np.inf), left)
    centre = x[1:4] / mass
    slopes = np.column_stack([-centre, np.eye(3)]) / mass
    spread = np.sqrt(np.diag(slopes @ covariance[:4, :4] @ slopes.T))
    verdict: Verdict = "load" if abs(mass) > SHOWN * deviation else "none"
    if verdict == "none" and NORMAL_95 * deviation > COARSE * whole:
        verdict = "cannot tell"
    return Load(verdict, mass, deviation, centre, np.asarray(spread), left)
