"""Payload estimate at the last link: mass and centre from a model's errors, with their uncertainty.

    command - predicted = links(states) [m, m c, I] + offset + drift of friction + drift of gain + error

The ten parameters are those of a rigid body in the link's frame, I near that of a ball about its centre; each
command may have an offset as large as its noise. A drive that is warmer than when the model learned has other
friction and a weaker motor: both have priors for each joint, and what they may explain is no load. What the
model learned wrongly looks like a load too: how much is seen on the logs that it was learned from, by physics
identified without each of them.
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
FRICTION = 0.25
"""Prior deviation of a joint's friction from the learned one, as a fraction of it: a cold or a warm gear box
(Bittencourt and Gunnarsson 2012 measured more from 30 to 80 degrees). Another one grows with the speed."""
GAIN = 0.015
"""Prior deviation of a joint's torque constant: magnets of neodymium lose 0.11 % of their flux per kelvin, so
it is about 14 K."""
DRIFTS = 4
"""Drifts of each command: an offset, two of the friction, a gain."""
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
        left: mean square of the errors that the load leaves, over the predicted variance; or of the drifts of
            all drives over their prior variances, where that is more.
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
    offset, friction = np.sqrt(noise.mean(axis=0)), _friction(model, samples.log)
    x, covariance, left = _regressed(mean, friction, deviation, offset, worth, samples, body)
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
    loads, worth, friction = [], np.minimum(model.worth(), 1.0), _friction(model, samples.log)
    for number, mean in without.items():
        in_log = samples.group == number
        one = samples.take(in_log)
        error = one.command - mean[in_log]
        size = np.sqrt(np.mean(error**2, axis=0, where=one.usable & one.moving))
        if np.isfinite(size).all() and (size > 0.0).all():
            deviation = np.broadcast_to(size, error.shape)
            x, _, _ = _regressed(mean[in_log], friction[in_log], deviation, size, worth, one, body)
            loads.append(x[:10])
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
    mean, variance, noise = model.parted(log)
    weight = gains / np.sqrt(detection_variances(variance, noise))
    columns = _columns(body.links(log)[:, :, -1], mean, _friction(model, log), weight)
    prior = _prior(np.sqrt(noise.mean(axis=0)), mass)
    covariance = np.linalg.inv(columns.T @ columns + np.diag(prior**-2))[:4, :4]
    if apparent is not None and len(apparent):
        covariance = covariance + apparent[:, :4].T @ apparent[:, :4] / len(apparent)
    return np.asarray(covariance)


def _friction(model: LearnedModel, log: Log) -> Array:
    """(n, J) the part of the predicted commands that changes its sign with velocities. Inertia, gravity and
    Coriolis forces do not.
    """
    channels, backwards = log.channels, log
    for name, channel in channels.items():
        of = channels.get(channel.derivative_of)
        # memories of friction have no unit: they are the way that a joint turned
        if (of is not None and not of.derivative_of) or set(channel.units) == {"1"}:
            backwards = backwards.put(channel, -log[name])
    return np.asarray(0.5 * (model.mean(log) - model.mean(backwards)))


def _columns(links: Array, command: Array, friction: Array, weight: Array) -> Array:
    """(n J, 10 + DRIFTS J) commands for each parameter of a load and for each drift, times weight (n, J).

    Args:
        links: (n, J, 10) commands for each parameter. command, friction: (n, J) that drift by a fraction.
    """
    n, J = weight.shape
    size = np.abs(friction)
    faster = friction * size / np.maximum(size.max(axis=0), np.finfo(float).tiny)
    drifts = np.stack([np.ones((n, J)), friction, faster, command], axis=1)
    own = np.einsum("nkj,ji->njki", drifts, np.eye(J)).reshape(n, J, DRIFTS * J)
    return np.asarray((np.concatenate([links, own], axis=2) * weight[..., None]).reshape(n * J, -1))


def _prior(offset: Array, size: float) -> Array:
    """(10 + DRIFTS J,) deviations of a load of about `size` kg, and of each drift; offset (J,)."""
    load = np.full(10, FREE)
    load[1:4], load[4:10] = size * REACH, size * ROUND**2
    drifts = np.repeat([FRICTION, FRICTION, GAIN], len(offset))
    return np.concatenate([load, offset, drifts])


def _regressed(
    mean: Array,
    friction: Array,
    deviation: Array,
    offset: Array,
    worth: Array,
    samples: Samples,
    body: SupportsVariations,
) -> tuple[Array, Array, float]:
    """x (10 + DRIFTS J,), its covariance, and `Load.left`."""
    J = mean.shape[1]
    use = samples.usable & samples.moving
    links, weight = body.links(samples.log)[:, :, -1], use * np.sqrt(worth) / deviation
    z = (weight * (samples.command - mean)).ravel()
    x, prior = np.zeros(10 + DRIFTS * J), _prior(offset, FREE)
    for _ in range(PASSES):
        columns = _columns(links, mean + links @ x[:10], friction, weight)
        expected = np.zeros(len(x))
        expected[4:10] = about_origin(float(x[0]), x[1:4])
        covariance = np.linalg.inv(columns.T @ columns + np.diag(prior**-2))
        x = covariance @ (columns.T @ z + expected / prior**2)
        prior = _prior(offset, abs(float(x[0])) + float(np.sqrt(covariance[0, 0])))
    residual = z - columns @ x
    left = float(np.sum(residual**2) / max(float(np.sum(worth * use)), 1.0))
    stretch = np.floor((samples.t - samples.t[0]) / STRETCH_S).astype(np.int64)
    _, stretch = np.unique(stretch, return_inverse=True)
    scores = np.zeros((int(stretch.max()) + 1, len(x)))
    np.add.at(scores, np.repeat(stretch, J), columns * residual[:, None])
    scaled = np.asarray(max(left, 1.0) * covariance, dtype=np.float64)
    drifts = ((x / prior)[10 + J :] ** 2).reshape(DRIFTS - 1, J).mean(axis=1)
    return x, scattered(scaled, prior, scores, 1.0), max(left, float(drifts.max()))


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
