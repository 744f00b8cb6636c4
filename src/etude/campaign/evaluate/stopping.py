"""Stop rule: whether another trajectory is worth its robot time, by four rules and their evidence.

The evidence is the prequential score, the calibration factor, the expected command error, and the value of
the next trajectory. Training error and marginal likelihood are no evidence: the first always falls, and
hyperparameters change the second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude.campaign.record.alerts import LEAST_COVERAGE, campaign_alerts, coverages
from etude.campaign.record.config import StopConfig
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round, State
from etude.codes import Code, Notice, Phrase, Stop, Warn
from etude.models.config import LEAST_SEGMENTS

OVERCONFIDENT = 2.0
"""Calibration factor above which an expected command error is not trusted."""
STILL_CHANGING = 0.7
"""Largest change of a log length scale in one update for which the model counts as settled."""


@dataclass(frozen=True)
class LogOutcome:
    """Evidence after one log was learned.

    Attributes:
        number: of the trajectory.
        forecast: expected command error at the tasks, as a fraction of the command limit; largest over the
            axes.
        noise_ratio: remaining variance divided by noise variance, largest over the axes; None without noise.
        gain: fraction of the remaining variance that the next trajectory would remove; None without a design.
        gain_minutes: robot time of that trajectory with set-up, min.
        calibration: pooled z^2 of trajectories left out; 1 is right, None if unknown.
        moved: largest change of a logarithmic length scale in the last training; None for the first one.
        robot_minutes: recorded motion so far, min.
        coverage: fraction of an output's commands inside its 95 % intervals, on logs left out; smallest over
            the outputs, None if unknown.
        red: the red alerts. slow: the logs contain slow motion only, so the forecast is of no faster one.
        segments: learned so far. Fewer than `promote` needs to compare models call for another log.
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
    red: tuple[Notice, ...] = ()
    slow: bool = False
    segments: int = LEAST_SEGMENTS


RULES: Mapping[Code, str] = {
    Stop.TOLERANCE: "tolerance",
    Stop.NOISE: "noise",
    Stop.GAIN: "gain",
    Stop.BUDGET_LOGS: "budget",
    Stop.BUDGET_TIME: "budget",
}
"""The rule that has fired, by phrase."""
GOES_ON = (Stop.OPEN, Stop.LOGS_MISSING)
"""Phrases that call for another log whether or not the model may be used."""


@dataclass(frozen=True)
class Verdict:
    """Result of the stop rules, with the reason.

    Attributes:
        notice: result of the rules.
        harm: reason not to use the model despite the rules; None if there is none.
    """

    notice: Notice
    harm: Notice | None = None

    @property
    def rule(self) -> str:
        """Name of the rule: "tolerance", "noise", "gain" or "budget"; "" if no rule fired, or the model
        should not be used.

        The budget rule applies in both cases.
        """
        rule = RULES.get(self.notice.code, "")
        return rule if rule == "budget" or self.usable else ""

    @property
    def stop(self) -> bool:
        """Whether the campaign should stop."""
        return bool(self.rule)

    @property
    def usable(self) -> bool:
        """Whether no reason speaks against the use of the model."""
        return self.harm is None

    @property
    def reason(self) -> str:
        """One sentence."""
        if self.harm is None or self.notice.code in GOES_ON:
            return f"{self.notice.sentence}."
        return f"{self.notice.sentence}, but {self.harm.sentence}."

    def facts(self) -> dict[str, Any]:
        """JSON values for `--json`."""
        harm = None if self.harm is None else self.harm.facts()
        values = {"stop": self.stop, "rule": self.rule, "reason": self.reason, "usable": self.usable}
        return {**self.notice.to_json(), **values, "harm": harm}


def stop_verdict(evidence: Sequence[LogOutcome], config: StopConfig) -> Verdict:
    """The verdict after the last of `evidence` (oldest first); every rule but the budget must hold
    repeatedly.
    """
    harm = _harm(evidence[-1]) if evidence else None
    recent = evidence[-config.consecutive :]
    spent = _budget(evidence, config)
    if spent is not None:
        return Verdict(spent, harm)
    missing = config.consecutive - len(recent)
    if evidence and evidence[-1].segments < LEAST_SEGMENTS:
        missing = max(missing, 1)  # `promote` could not compare the model
    if missing > 0:
        return Verdict(Notice(Stop.LOGS_MISSING, {"logs": missing}), harm)
    return Verdict(_apply_rules(recent, config), harm)


def _apply_rules(recent: Sequence[LogOutcome], config: StopConfig) -> Notice:
    """Result of the rules on the logs that must agree."""
    tolerable, doubt = all(_tolerable(e, config) for e in recent), _doubt(recent[-1])
    forecast = {"forecast": recent[-1].forecast, "goal": config.command_tolerance}
    if tolerable and doubt is None:
        return Notice(Stop.TOLERANCE, forecast)
    if all(_in_noise(e, config) for e in recent):
        return Notice(Stop.NOISE, {"fraction": config.noise_fraction})
    if all(_not_worth_it(e, config) for e in recent):
        return Notice(Stop.GAIN, {"threshold": config.gain_per_minute})
    if tolerable:
        return Notice(Stop.DOUBTED, {**forecast, "doubt": doubt})
    return Notice(Stop.OPEN, {"open": _open_points(recent[-1], config)})


def _budget(evidence: Sequence[LogOutcome], config: StopConfig) -> Notice | None:
    if config.budget_trajectories and len(evidence) >= config.budget_trajectories:
        return Notice(Stop.BUDGET_LOGS, {"logs": config.budget_trajectories})
    minutes = evidence[-1].robot_minutes if evidence else 0.0
    if config.budget_minutes and minutes >= config.budget_minutes:
        return Notice(Stop.BUDGET_TIME, {"minutes": config.budget_minutes})
    return None


def _tolerable(e: LogOutcome, config: StopConfig) -> bool:
    return config.command_tolerance > 0 and e.forecast <= config.command_tolerance


def _in_noise(e: LogOutcome, config: StopConfig) -> bool:
    return config.noise_fraction > 0 and e.noise_ratio is not None and e.noise_ratio <= config.noise_fraction


def _not_worth_it(e: LogOutcome, config: StopConfig) -> bool:
    return (
        config.gain_per_minute > 0 and e.gain is not None and e.gain / e.gain_minutes < config.gain_per_minute
    )


def _harm(e: LogOutcome) -> Notice | None:
    """Reason not to use the model despite the rules; None if there is none."""
    if e.red:
        return e.red[0]
    if e.coverage is not None and e.coverage < LEAST_COVERAGE:
        return Notice(Phrase.LOW_COVERAGE, {"part": e.coverage})
    return None


def _doubt(e: LogOutcome) -> Notice | None:
    if e.calibration is not None and e.calibration > OVERCONFIDENT:
        return Notice(Phrase.LARGE_ERRORS, {"factor": e.calibration})
    if e.moved is not None and e.moved > STILL_CHANGING:
        return Notice(Phrase.UNSETTLED, {"factor": math.exp(e.moved)})
    if e.slow:
        return Notice(Phrase.SLOW_LOGS)
    return None


def _open_points(e: LogOutcome, config: StopConfig) -> tuple[Notice, ...]:
    parts = []
    if config.command_tolerance:
        fields = {"forecast": e.forecast, "goal": config.command_tolerance}
        parts.append(Notice(Phrase.OPEN_FORECAST, fields))
    if config.gain_per_minute and e.gain is not None:
        fields = {"rate": e.gain / e.gain_minutes, "threshold": config.gain_per_minute}
        parts.append(Notice(Phrase.OPEN_GAIN, fields))
    if config.gain_per_minute and e.gain is None:
        parts.append(Notice(Phrase.GAIN_UNKNOWN))
    return tuple(parts) or (Notice(Phrase.NO_RULE),)


POOLED = 3
"""Number of trajectories whose prequential z^2 are pooled in the calibration factor."""


def seen_by_the_rule(campaign: Campaign, state: State, next_gain: float | None = None) -> list[LogOutcome]:
    """Evidence of each learned log, in the order of learning.

    Args:
        campaign: gives limits and set-up time.
        state: the replayed facts.
        next_gain: expected gain of a trajectory that was designed but not yet proposed.
    """
    trained = state.trained
    gains = _gains_after(state)
    gains[len(trained)] = next_gain if next_gain is not None else gains.get(len(trained))
    minutes = (campaign.config.duration + campaign.config.stop.setup_s) / 60.0
    outcomes = [_evidence(campaign, trained[: i + 1], gains.get(i + 1), minutes) for i in range(len(trained))]
    alerts = campaign_alerts(state, campaign.command.parts, len(campaign.axes))
    red = tuple(notice for notice in alerts if notice.light == "red")
    return [*outcomes[:-1], replace(outcomes[-1], red=red)] if outcomes else []


def calibration_factor(trained: list[Round]) -> float | None:
    """Mean z^2 over all axes on logs left out of the training; None if unknown.

    Trainings of earlier versions give it over the last `POOLED` logs, each predicted before it was learned.
    """
    newest = trained[-1].trained if trained else None
    if newest is not None and newest.new_motion is not None:
        factors = [z2 for z2 in newest.new_motion.used.z2 if z2 is not None and math.isfinite(z2)]
        return float(np.mean(factors)) if factors else None
    values = [
        value
        for facts in (r.trained for r in trained[-POOLED:])
        if facts
        for value in facts.score_in_use().z2
        if value is not None and math.isfinite(value)
    ]
    return float(np.mean(values)) if values else None


def _gains_after(state: State) -> dict[int, float | None]:
    """Expected gain of the trajectory proposed after k learned logs, by k."""
    facts = [r.asked for r in state.rounds.values() if r.asked]
    return {a.learned: a.gain for a in facts if a.gain is not None}


def _evidence(campaign: Campaign, trained: list[Round], gain: float | None, minutes: float) -> LogOutcome:
    facts = trained[-1].trained
    assert facts is not None
    calibration = calibration_factor(trained)
    deviation = np.array(facts.forecast_deviation) * math.sqrt(max(calibration or 1.0, 1.0))
    noise = facts.noise_deviation
    # a model without noise has an infinite ratio
    ratio = None if noise is None else (np.array(facts.latent_deviation) / np.maximum(noise, 1e-300)) ** 2
    return LogOutcome(
        number=trained[-1].number,
        forecast=float(np.max(deviation / campaign.kind.limit(campaign.spec))),
        noise_ratio=None if ratio is None else float(np.max(ratio)),
        gain=gain,
        gain_minutes=minutes,
        calibration=calibration,
        moved=facts.moved,
        robot_minutes=facts.robot_seconds / 60.0,
        coverage=min((c for c in coverages(trained[-1]) if c is not None), default=None),
        slow=any(one.code == Warn.SLOW_MOTION for one in facts.warnings),
        segments=sum(len(r.ingested.segments) if r.ingested else 1 for r in trained),
    )
