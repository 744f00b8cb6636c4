"""Confirmation motions: tracking errors without and with feedforward, and the expected tracking error."""

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
    """A run without feedforward: mean absolute values (k,), rad (m).

    Attributes:
        moving: tracking error of each axis while it moves.
        late: part of this error that a lag common to all axes causes: sampling, filters, delays.
        noise: of the encoder, which every error contains.
    """

    moving: Array
    late: Array
    noise: Array

    def expected(self, left: Sequence[float | None]) -> list[tuple[float, float] | None]:
        """Least and largest expected error of each axis while it moves, by the fractions of `left_over`.

        Feedforward cannot remove a lag. Friction that the model does not describe resembles a lag, so the lag
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
    """Times (T,) s."""
    return np.arange(0.0, trajectory.duration, STEP_S)


def moving(trajectory: Trajectory, t: Array, trained: Array) -> Mask:
    """Mask (T, k) of the times t (T,) s at which each joint moves as planned; trained (k,): top speeds in
    training.
    """
    top = np.abs(trajectory.motion(instants(trajectory), 2).orders[1]).max(axis=0)
    speed = np.abs(trajectory.motion(t, 2).orders[1])
    return np.asarray((speed > FRACTION * top) & (top > FRACTION * trained))


def trained_speeds(model: LearnedModel, rates: Channel) -> Array:
    """Top speed (k,) of each axis in training, from the channel of rates; 0 if the model does not use it."""
    speeds: Mapping[tuple[str, str], float] = {
        (channel, part): float(np.abs(model.ranges[:, i]).max())
        for i, (channel, part, _, op) in enumerate(model.inputs.columns)
        if not op
    }
    names = (rates.name, f"{rates.name}_des")
    return np.array([max(speeds.get((name, part), 0.0) for name in names) for part in rates.parts])


def left_over(model: LearnedModel, trajectory: Trajectory, trained: Array) -> list[float | None]:
    """Mean absolute command (k,) that the model leaves to the feedback, over the feedback's whole command
    without it.

    Both are means while the axis moves; None for an axis that hardly moves. The errors of linear feedback are
    proportional to this fraction. The model's calibrated variance counts with its noise, because the feedback
    also compensates what no input explains.
    """
    t = instants(trajectory)
    mean, variance = model.posterior(model.inputs.states(trajectory.motion(t, model.inputs.orders)))
    left = HALF_NORMAL * np.sqrt(variance)
    use = moving(trajectory, t, trained)
    needed = np.hypot(mean, left)
    return [
        # 1e-300: a joint that needs no command has none left
        float(left[mask, j].sum() / max(needed[mask, j].sum(), 1e-300)) if mask.sum() >= LEAST else None
        for j, mask in enumerate(use.T)
    ]


def errors(log: Log, path: str, trajectory: Trajectory, use: Mask) -> Array:
    """Mean absolute tracking error (k,) where `use` (T, k), rad (m); NaN where `use` is empty."""
    return _mean(log[path] - trajectory.motion(log.t, 1).orders[0], use)


def without_it(log: Log, path: str, trajectory: Trajectory, use: Mask, command: Array) -> Without:
    """Errors of a run without feedforward; command (T, k): the feedforward that it would have had.

    Second differences of the error give the noise, because the motion of a joint is much slower.
    """
    place, rate = trajectory.motion(log.t, 2).orders[:2]
    error = log[path] - place
    # white noise of variance 1 has second differences of variance 1 + 4 + 1
    noise = np.sqrt(np.mean(np.diff(error, 2, axis=0) ** 2, axis=0) / 6.0)
    late = shared_lag(error, rate, command, use) * rate
    return Without(_mean(error, use), _mean(late, use), HALF_NORMAL * noise)


def shared_lag(error: Array, rate: Array, command: Array, use: Mask) -> float:
    """Common lag (s) of the errors (T, k) behind the rates (T, k), beside their dependence on the command.

    Least squares give it for each axis where it moves. Friction that makes command and rate similar biases
    these values. So the least one counts, and none if two have opposite signs.
    """
    pairs = [
        (np.column_stack([rate[mask, j], command[mask, j]]), error[mask, j]) for j, mask in enumerate(use.T)
    ]
    lags = [float(np.linalg.lstsq(A, e, rcond=None)[0][0]) for A, e in pairs if len(e)]
    alike = bool(lags) and (min(lags) > 0.0 or max(lags) < 0.0)
    return min(lags, key=abs) if alike else 0.0


def _mean(values: Array, use: Mask) -> Array:
    counts = use.sum(axis=0)
    total = np.where(use, np.abs(values), 0.0).sum(axis=0)
    return np.asarray(total / np.where(counts, counts, np.nan))


def confirmed(campaign: Campaign, one: Round) -> dict[str, Any]:
    """Results of a confirmation motion, for `status` and the report; lists by axis, None if open.

    Keys: "without", "with": errors over the whole motion; "moving": error with feedforward while the axis
    moves; "forecast": least and largest expected value of "moving", None for an axis that hardly moves.
    Motions of earlier versions have neither of the last two.
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
    parts = (np.array(values, dtype=float) for values in (without.moving, without.late, without.noise))
    return Without(*parts).expected(asked.left_over)


def in_words(value: float | Sequence[float] | None) -> str:
    """A figure of `confirmed`, or both ends of its interval; "-" for None."""
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, int | float) else " .. ".join(f"{v:.2g}" for v in value)
