"""When another trajectory is not worth its robot time: four rules, their evidence, and when not to trust
them.

Prequential score, calibration factor, forecast error and value of the next trajectory are the evidence.
Training error and marginal likelihood are not: the one always falls, hyperparameters change the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.campaign.record.alerts import LEAST_COVERAGE, bad_news, coverages
from etude.campaign.record.config import StopConfig
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round, State

OVERCONFIDENT = 2.0
"""Calibration factor above which a forecast error is not believed."""
STILL_CHANGING = 0.7
"""Largest move of a logarithmic length scale in one update for which the model counts as settled."""


@dataclass(frozen=True)
class Evidence:
    """What is known after one log was learned.

    Attributes:
        number: of the trajectory.
        forecast: forecast command error where the tasks are, over the command limit, largest over the axes.
        noise_ratio: variance left over noise variance, largest over the axes; None for a model without noise.
        gain: fraction of the variance left that the next trajectory would remove; None if not designed.
        gain_minutes: robot time of that next trajectory, set-up included, min.
        calibration: pooled held-out z^2 of the last trajectories; 1 is right, None while unknown.
        moved: largest move of a logarithmic length scale in the last training; None for the first one.
        robot_minutes: recorded motion so far, min.
        coverage: part of an output's commands inside its 95 % intervals, least over the outputs, of the
            newest log that was predicted before it was learned; None while unknown.
        red: sentences of the checks that are red.
    """

    number: int
    forecast: float
    noise_ratio: float | None
    gain: float | None
    gain_minutes: float
    calibration: float | None
    moved: float | None
    robot_minutes: float
    coverage: float | None = None
    red: tuple[str, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Whether to stop, and why.

    Attributes:
        stop: another trajectory is not worth it.
        rule: "tolerance", "noise", "gain", "budget" or "" if none fired.
        reason: one sentence.
        usable: nothing says that the model should not be used.
    """

    stop: bool
    rule: str
    reason: str
    usable: bool = True


def judge(evidence: Sequence[Evidence], config: StopConfig) -> Verdict:
    """The verdict after the last of `evidence` (oldest first); all rules but the budget must repeat."""
    harm = _harm(evidence[-1]) if evidence else ""
    spent = _budget(evidence, config)
    if spent:
        return Verdict(True, "budget", f"{spent[:-1]}, but {harm}." if harm else spent, not harm)
    recent = evidence[-config.consecutive :]
    if len(recent) < config.consecutive:
        missing = config.consecutive - len(recent)
        reason = f"{missing} more log{'s' * (missing > 1)} before a rule can fire."
        return Verdict(False, "", reason, not harm)
    fired = _fired(recent, config)
    if harm and (fired.stop or not fired.reason.startswith("No rule")):
        return Verdict(False, "", f"{fired.reason.rstrip('.')}, but {harm}.", usable=False)
    return replace(fired, usable=not harm)


def _fired(recent: Sequence[Evidence], config: StopConfig) -> Verdict:
    """What the rules say by themselves, of as many logs as must agree."""
    tolerable, doubt = all(_tolerable(e, config) for e in recent), _doubt(recent[-1])
    if tolerable and not doubt:
        return Verdict(True, "tolerance", f"The forecast error is {_tolerance(recent[-1], config)}.")
    if all(_in_noise(e, config) for e in recent):
        limit = f"{config.noise_fraction:g} of the noise variance"
        return Verdict(True, "noise", f"The variance left is below {limit} on every axis.")
    if all(_not_worth_it(e, config) for e in recent):
        limit = f"{100 * config.gain_per_minute:g} % of the variance left per minute of robot time"
        return Verdict(True, "gain", f"The next trajectory would remove less than {limit}.")
    if tolerable:
        return Verdict(False, "", f"The forecast error is {_tolerance(recent[-1], config)}, but {doubt}.")
    return Verdict(False, "", f"No rule has fired: {_open_points(recent[-1], config)}.")


def _budget(evidence: Sequence[Evidence], config: StopConfig) -> str:
    if config.budget_trajectories and len(evidence) >= config.budget_trajectories:
        return f"The budget of {config.budget_trajectories} logs is used up."
    minutes = evidence[-1].robot_minutes if evidence else 0.0
    if config.budget_minutes and minutes >= config.budget_minutes:
        return f"The budget of {config.budget_minutes:g} min of motion is used up."
    return ""


def _tolerable(e: Evidence, config: StopConfig) -> bool:
    return config.command_tolerance > 0 and e.forecast <= config.command_tolerance


def _in_noise(e: Evidence, config: StopConfig) -> bool:
    return config.noise_fraction > 0 and e.noise_ratio is not None and e.noise_ratio <= config.noise_fraction


def _not_worth_it(e: Evidence, config: StopConfig) -> bool:
    return (
        config.gain_per_minute > 0 and e.gain is not None and e.gain / e.gain_minutes < config.gain_per_minute
    )


def _harm(e: Evidence) -> str:
    """Why the model should not be used, whatever a rule says."""
    if e.red:
        return e.red[0]
    if e.coverage is not None and e.coverage < LEAST_COVERAGE:
        return f"its 95 % intervals held only {100 * e.coverage:.0f} % of an output's commands"
    return ""


def _doubt(e: Evidence) -> str:
    if e.calibration is not None and e.calibration > OVERCONFIDENT:
        return f"held-out errors are {e.calibration:.1f} times the predicted variance, so it is not believed"
    if e.moved is not None and e.moved > STILL_CHANGING:
        factor = math.exp(e.moved)
        return f"the last log changed a length scale by a factor {factor:.1f}, so the model is not settled"
    return ""


def _tolerance(e: Evidence, config: StopConfig) -> str:
    return f"{100 * e.forecast:.2g} % of the command limit, within {100 * config.command_tolerance:g} %"


def _open_points(e: Evidence, config: StopConfig) -> str:
    parts = []
    if config.command_tolerance:
        limit = 100 * config.command_tolerance
        parts.append(f"forecast error {100 * e.forecast:.2g} % of the command limit (goal {limit:g} %)")
    if config.gain_per_minute and e.gain is not None:
        rate = 100 * e.gain / e.gain_minutes
        parts.append(
            f"{rate:.2g} % of the variance left per minute (threshold {100 * config.gain_per_minute:g} %)"
        )
    if config.gain_per_minute and e.gain is None:
        parts.append("what the next one would add is known once it is designed")
    return "; ".join(parts) or "no rule but the budget is switched on"


POOLED = 3
"""Trajectories whose prequential z^2 make the calibration factor."""


def seen_by_the_rule(campaign: Campaign, state: State, next_gain: float | None = None) -> list[Evidence]:
    """One Evidence for each learned log, in the order of learning.

    Args:
        campaign: gives limits and set-up time.
        state: the replayed facts.
        next_gain: forecast gain of a trajectory that was just designed and is not asked for yet.
    """
    trained = state.trained
    gains = _gains_after(state)
    gains[len(trained)] = next_gain if next_gain is not None else gains.get(len(trained))
    minutes = (campaign.config.duration + campaign.config.stop.setup_s) / 60.0
    found = [_evidence(campaign, trained[: i + 1], gains.get(i + 1), minutes) for i in range(len(trained))]
    news = bad_news(state, campaign.command.parts, len(campaign.axes))
    red = tuple(finding.sentence for finding in news if finding.light == "red")
    return [*found[:-1], replace(found[-1], red=red)] if found else []


def calibration_factor(trained: list[Round]) -> float | None:
    """Mean held-out z^2 of the model in use over the last `POOLED` logs and all axes; None while unknown."""
    values = [
        value
        for facts in (r.trained for r in trained[-POOLED:])
        if facts
        for value in facts.score_in_use().z2
        if value is not None and math.isfinite(value)
    ]
    return float(np.mean(values)) if values else None


def _gains_after(state: State) -> dict[int, float | None]:
    """Forecast gain of the trajectory asked for after k logs were learned, by k."""
    asked = [r.asked for r in state.rounds.values() if r.asked]
    return {a.learned: a.gain for a in asked if a.gain is not None}


def _evidence(campaign: Campaign, trained: list[Round], gain: float | None, minutes: float) -> Evidence:
    facts = trained[-1].trained
    assert facts is not None
    calibration = calibration_factor(trained)
    deviation = np.array(facts.forecast_deviation) * math.sqrt(max(calibration or 1.0, 1.0))
    noise = facts.noise_deviation
    ratio = None if noise is None else (np.array(facts.latent_deviation) / np.maximum(noise, 1e-300)) ** 2
    return Evidence(
        number=trained[-1].number,
        forecast=float(np.max(deviation / campaign.kind.limit(campaign.spec))),
        noise_ratio=None if ratio is None else float(np.max(ratio)),
        gain=gain,
        gain_minutes=minutes,
        calibration=calibration,
        moved=facts.moved,
        robot_minutes=facts.robot_seconds / 60.0,
        coverage=min((c for c in coverages(trained[-1]) if c is not None), default=None),
    )
