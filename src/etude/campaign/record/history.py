"""What the stop rule sees, read from committed facts."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from etude.campaign.evaluate.stopping import Evidence
from etude.campaign.record.alerts import bad_news, coverages
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import Round, State

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
        for value in facts["models"].get(facts.get("predicted_by") or facts["chosen"], {}).get("z2") or []
        if value is not None and math.isfinite(value)
    ]
    return float(np.mean(values)) if values else None


def _gains_after(state: State) -> dict[int, float | None]:
    """Forecast gain of the trajectory asked for after k logs were learned, by k."""
    asked = [r.asked for r in state.rounds.values() if r.asked]
    return {a["learned"]: a["gain"] for a in asked if a.get("gain") is not None}


def _evidence(campaign: Campaign, trained: list[Round], gain: float | None, minutes: float) -> Evidence:
    facts: dict[str, Any] = trained[-1].trained or {}
    calibration = calibration_factor(trained)
    deviation = np.array(facts["forecast_deviation"]) * math.sqrt(max(calibration or 1.0, 1.0))
    noise = facts.get("noise_deviation")
    ratio = None if noise is None else (np.array(facts["latent_deviation"]) / np.maximum(noise, 1e-300)) ** 2
    return Evidence(
        number=trained[-1].number,
        forecast=float(np.max(deviation / campaign.kind.limit(campaign.spec))),
        noise_ratio=None if ratio is None else float(np.max(ratio)),
        gain=gain,
        gain_minutes=minutes,
        calibration=calibration,
        moved=facts.get("moved"),
        robot_minutes=float(facts["robot_seconds"]) / 60.0,
        coverage=min((c for c in coverages(trained[-1]) if c is not None), default=None),
    )
