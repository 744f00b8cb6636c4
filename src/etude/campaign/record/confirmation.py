"""Confirmation motions: tracking errors of their runs without and with feedforward, and the forecast."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.campaign.record.events import Asked, Confirmed
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round
from etude.protocols import Trajectory
from etude.types import Array, Channel, Log, Mask

if TYPE_CHECKING:
    from etude.models.learned_model import LearnedModel

FEEDFORWARD = "feedforward.csv"
"""The same table as trajectory.csv, with a column for each command."""
RUNS = ("without", "with")
SHOWN = {
    "without": "without",
    "with": "with",
    "moving": "with, while it moves",
    "forecast": "the same, forecast",
}
"""What of `confirmed` is shown to people, and what it is called."""
SPREAD = 3.0
"""How far the error may lie from its forecast, in times: a feedback's errors are in proportion to slow
commands alone, and friction at a reversal is wrong for longer the slower it is. How often that is enough is
in docs/results/monitoring.md."""
FRACTION = 0.05
"""A joint moves above that part of its top speed, as in training (`ArmData.stick_fraction`); a joint whose
top speed is below that part of the one it was trained at hardly moves, and stands at all times."""
STEP_S, LEAST = 0.1, 10
"""s between the instants that are looked at; of fewer where a joint moves nothing is said."""
HALF_NORMAL = math.sqrt(2.0 / math.pi)
"""Mean absolute value of a normal number, in its deviations."""


@dataclass(frozen=True)
class Without:
    """A run without the feedforward, mean absolute values (k,).

    Attributes:
        moving: error of each axis while it moves.
        late: what of it a lag of all axes would be, of sampling, filters or delays.
        noise: of the encoder, which is in all errors.
    """

    moving: Array
    late: Array
    noise: Array

    def expected(self, left: Sequence[float | None]) -> list[tuple[float, float] | None]:
        """Least and most error of each axis while it moves, of the parts that are `left_over`.

        No feedforward takes a lag away. Friction that the model does not know may look like one, so it
        counts in the upper end alone.
        """
        rows = zip(left, self.moving, self.late, self.noise, strict=True)
        return [
            None
            if part is None or np.isnan(error)
            else (math.hypot(part * error / SPREAD, noise), math.hypot(part * error * SPREAD, late, noise))
            for part, error, late, noise in rows
        ]


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
    mean, variance = model.posterior(model.inputs.states(trajectory.motion(t, model.inputs.orders)))
    left = HALF_NORMAL * np.sqrt(variance)
    use = moving(trajectory, t, trained)
    needed = np.hypot(mean, left)
    return [
        # 1e-300: a joint that needs no command has none left
        float(left[own, j].sum() / max(needed[own, j].sum(), 1e-300)) if own.sum() >= LEAST else None
        for j, own in enumerate(use.T)
    ]


def errors(log: Log, path: str, trajectory: Trajectory, use: Mask) -> Array:
    """(k,) mean absolute tracking error where `use` (T, k), NaN of nothing."""
    return _mean(log[path] - trajectory.motion(log.t, 1).orders[0], use)


def without_it(log: Log, path: str, trajectory: Trajectory, use: Mask, command: Array) -> Without:
    """Of a run without the feedforward, whose command (T, k) it would have been.

    Noise is what second differences of the error hold: a joint's own motion is much slower.
    """
    place, rate = trajectory.motion(log.t, 2).orders[:2]
    error = log[path] - place
    # white noise of variance 1 has second differences of variance 1 + 4 + 1
    noise = np.sqrt(np.mean(np.diff(error, 2, axis=0) ** 2, axis=0) / 6.0)
    late = shared_lag(error, rate, command, use) * rate
    return Without(_mean(error, use), _mean(late, use), HALF_NORMAL * noise)


def shared_lag(error: Array, rate: Array, command: Array, use: Mask) -> float:
    """s that errors (T, k) follow the rates (T, k) by in every axis, beside what they follow the command by.

    Of each axis by least squares where it moves. They are biased wherever friction makes command and rate
    alike, so the least of them counts, and none where two differ in sign.
    """
    pairs = [(np.column_stack([rate[own, j], command[own, j]]), error[own, j]) for j, own in enumerate(use.T)]
    found = [float(np.linalg.lstsq(A, e, rcond=None)[0][0]) for A, e in pairs if len(e)]
    alike = bool(found) and (min(found) > 0.0 or max(found) < 0.0)
    return min(found, key=abs) if alike else 0.0


def _mean(values: Array, use: Mask) -> Array:
    counts = use.sum(axis=0)
    total = np.where(use, np.abs(values), 0.0).sum(axis=0)
    return np.asarray(total / np.where(counts, counts, np.nan))


def confirmed(campaign: Campaign, one: Round) -> dict[str, Any]:
    """What is known of a motion that confirms, for `status` and the report; lists per axis, None if open.

    "without", "with": errors over the whole motion; "moving": that with, while the axis moves; "forecast": of
    the same, least and most, None of an axis that hardly moves. Motions of earlier versions have neither.
    """
    asked, runs = one.asked, one.runs
    without, fed = runs.get("without"), runs.get("with")
    units = next((list(run.units) for run in runs.values()), None)
    return {
        "number": one.number,
        "axes": list(campaign.axes),
        "units": units,
        "without": without.error if without else None,
        "with": fed.error if fed else None,
        "moving": fed.moving if fed else None,
        "forecast": _forecast(asked, without) or None,
        "left_over": asked.left_over if asked else None,
        "model_sha256": asked.model_sha256 if asked else None,
    }


def _forecast(asked: Asked | None, without: Confirmed | None) -> list[tuple[float, float] | None]:
    if asked is None or asked.left_over is None or without is None or without.late is None:
        return []
    parts = (np.array(own, dtype=float) for own in (without.moving, without.late, without.noise))
    return Without(*parts).expected(asked.left_over)


def in_words(value: float | Sequence[float] | None) -> str:
    """A figure of `confirmed`, or the two that it lies between; "-" for None."""
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, int | float) else " .. ".join(f"{v:.2g}" for v in value)
