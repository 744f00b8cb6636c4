"""The tracking error that is to be expected with the feedforward: of a joint while it moves.

While a joint stands, friction holds whatever its command leaves over: the command that it needs is no number
but a range, of which the model rightly says that it does not know where in it the command lies. None of that
becomes a tracking error, so nothing is said of joints that stand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from etude.contracts import Array, Channel, Log, Mask, Trajectory
from etude.models.model import LearnedModel

FRACTION = 0.05
"""A joint moves above that part of its top speed, as in training (`ArmData.stick_fraction`); a joint whose
top speed is below that part of the one it was trained at hardly moves, and stands at all times."""
STEP_S, LEAST = 0.1, 10
"""s between the instants that are looked at; of fewer where a joint moves nothing is said."""
LEFT_OVER, TRAINED = "left_over", "trained_speeds"
"""Facts of the `asked` event: see `left_over` and `moving`."""
HALF_NORMAL = math.sqrt(2.0 / math.pi)
"""Mean absolute value of a normal number, in its deviations."""
SPREAD = 3.0
"""How far the error may lie from its forecast, in times: a feedback's errors are in proportion to slow
commands alone, and friction at a reversal is wrong for longer the slower it is. How often that is enough is
in docs/promote_watch.md."""


def instants(trajectory: Trajectory) -> Array:
    """(T,) s."""
    return np.arange(0.0, trajectory.duration, STEP_S)


def moving(trajectory: Trajectory, t: Array, trained: Array) -> Mask:
    """(T, k) where each joint moves by plan at t (T,) s; trained (k,): top speeds in training."""
    top = np.abs(trajectory.motion(instants(trajectory), 2).orders[1]).max(axis=0)
    speed = np.abs(trajectory.motion(t, 2).orders[1])
    return np.asarray((speed > FRACTION * top) & (top > FRACTION * trained))


def trained_speeds(model: LearnedModel, rates: Channel) -> Array:
    """(k,) top speed of each axis in training, by the channel of rates; 0 where the model looks at none."""
    known: Mapping[tuple[str, str], float] = {
        (channel, part): float(np.abs(model.ranges[:, i]).max())
        for i, (channel, part, _, op) in enumerate(model.inputs.columns)
        if not op
    }
    names = (rates.name, f"{rates.name}_des")
    return np.array([max(known.get((name, part), 0.0) for name in names) for part in rates.parts])


def left_over(model: LearnedModel, trajectory: Trajectory, trained: Array) -> list[float | None]:
    """(k,) mean absolute command that the model leaves to the feedback, over all that the feedback has to
    give without it; both while that axis moves, None where it hardly does.

    A linear feedback's errors are in proportion. The model's calibrated variance counts, that of its noise
    included: what no input explains is left to the feedback too.
    """
    t = instants(trajectory)
    mean, variance = model.predict(model.inputs.states(trajectory.motion(t, model.inputs.orders)))
    left = HALF_NORMAL * np.sqrt(variance)
    use = moving(trajectory, t, trained)
    needed = np.hypot(mean, left)
    return [
        float(left[own, j].sum() / max(needed[own, j].sum(), 1e-300)) if own.sum() >= LEAST else None
        for j, own in enumerate(use.T)
    ]


def errors(log: Log, path: str, trajectory: Trajectory, use: Mask) -> tuple[Array, Array]:
    """Mean absolute error (k,) where `use` (T, k), NaN of nothing, and that of the encoder's noise (k,).

    The noise is what second differences of the error hold: a joint's own motion is much slower.
    """
    error = log[path] - trajectory.motion(log.t, 1).orders[0]
    counts = use.sum(axis=0)
    found = np.where(use, np.abs(error), 0.0).sum(axis=0) / np.where(counts, counts, np.nan)
    noise = np.sqrt(np.mean(np.diff(error, 2, axis=0) ** 2, axis=0) / 6.0)
    return found, HALF_NORMAL * noise


def expected(part: float, without: float, noise: float) -> tuple[float, float]:
    """Least and most error of an axis while it moves, the encoder's noise in it: `part` (`left_over`) of that
    without the feedforward.
    """
    return math.hypot(part * without / SPREAD, noise), math.hypot(part * without * SPREAD, noise)
