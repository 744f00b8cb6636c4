"""What the stop rule sees, from facts given by hand: worst axis, calibrated, in parts of the limits."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.campaign import Campaign, Round, State
from etude.campaign.evaluate.status import expected_error
from etude.campaign.evaluate.stopping import POOLED, calibration_factor, seen_by_the_rule, stop_verdict
from etude.campaign.training import slow_motion
from etude.codes import NextStep, Notice, Stop, Warn
from journal_facts import trained

LIMITS = (20.0, 10.0)
"""Of hip and knee, N m."""


def state(*z2: list[float | None], **facts: Any) -> State:
    """A campaign whose logs were predicted with these z^2, an axis each; the newest has these facts."""
    common: dict[str, Any] = {
        "chosen": "gp",
        "robot_seconds": 60.0,
        "forecast_deviation": [1.0, 2.0],
        "latent_deviation": [0.3, 0.1],
        "noise_deviation": [0.1, 0.1],
    }
    rounds = {}
    for number, values in enumerate(z2, 1):
        models = {"gp": {"z2": values}, "linear": {"z2": [99.0, 99.0]}}
        rounds[number] = Round(number, trained=trained(**{**common, "models": models, **facts}), order=number)
    return State(rounds=rounds)


class Seen:
    """Model inputs of a log whose hip reached 0.3 rad/s and whose knee reached 2 rad/s."""

    columns = (("q", "hip", "rad", ""), ("qd", "hip", "rad/s", ""), ("qd", "knee", "rad/s", ""))

    def of_log(self, _: Any) -> np.ndarray:
        return np.linspace(-1.0, 1.0, 500)[:, None] * [0.1, 0.3, 2.0]


def test_slow_logs_are_named_and_claim_nothing_of_faster_motion() -> None:
    reference = np.linspace(-1.0, 1.0, 100)[:, None] * [1.0, 2.0, 2.0]
    samples = SimpleNamespace(log=None)
    (found,) = slow_motion(Seen(), samples, reference, ())
    assert (found.code, found.fields["axes"]) == (Warn.SLOW_MOTION, ("hip",))
    assert found.fields["part"] == pytest.approx(0.15, abs=0.005)
    assert slow_motion(Seen(), samples, reference, ["hip"]) == (), "one that stands has its own alert"
    assert slow_motion(Seen(), samples, reference * [1.0, 0.2, 1.0], ()) == ()


def test_a_forecast_of_slow_logs_stops_nothing_and_is_not_shown(campaign: Campaign) -> None:
    notice = Notice(Warn.SLOW_MOTION, {"axes": ("hip",), "part": 0.15}, NextStep.TELL_FASTER)
    good = {"forecast_deviation": [0.01, 0.01], "moved": 0.0, "latent_deviation": [9.0, 9.0]}
    for warnings, code in (([], Stop.TOLERANCE), ([notice.to_json()], Stop.DOUBTED)):
        evidence = seen_by_the_rule(campaign, state(*[[1.0, 1.0]] * 4, **good, warnings=warnings))
        config = replace(campaign.config.stop, command_tolerance=0.01)
        assert stop_verdict(evidence, config).notice.code == code
        assert (expected_error(state([1.0, 1.0]), evidence) is None) == bool(warnings)
    single = replace(trained(**good, chosen="gp"), logs=(1,))
    assert expected_error(State(rounds={1: Round(1, trained=single, order=1)}), evidence[:1]) is None


def test_the_campaign_has_these_limits(campaign: Campaign) -> None:
    assert tuple(campaign.spec.command) == LIMITS


@pytest.mark.parametrize(("deviation", "worst"), [([1.0, 2.0], 0.2), ([8.0, 0.1], 0.4), ([0.5, 0.5], 0.05)])
def test_the_forecast_is_the_worst_axis_in_parts_of_its_limit(
    campaign: Campaign, deviation: list[float], worst: float
) -> None:
    (found,) = seen_by_the_rule(campaign, state([1.0, 1.0], forecast_deviation=deviation))
    assert found.forecast == pytest.approx(worst)


@pytest.mark.parametrize(
    ("z2", "factor"),
    [
        ([[4.0, 4.0]], 4.0),
        ([[1.0, 7.0]], 4.0),
        ([[2.0, 2.0], [16.0, 16.0]], 9.0),
        # never better than the model says of itself
        ([[0.25, 0.25]], 1.0),
        ([[None, None]], 1.0),
    ],
)
def test_the_forecast_is_calibrated(campaign: Campaign, z2: list[list[float | None]], factor: float) -> None:
    found = seen_by_the_rule(campaign, state(*z2))[-1]
    assert found.forecast == pytest.approx(0.2 * math.sqrt(factor))


def test_the_calibration_is_of_the_last_logs_and_of_the_model_in_use() -> None:
    seen = state([100.0, 100.0], *[[2.0, 4.0]] * POOLED)
    assert calibration_factor(seen.trained) == pytest.approx(3.0)
    assert calibration_factor(state([None, 5.0]).trained) == 5.0
    assert calibration_factor(state([None, math.nan]).trained) is None
    assert calibration_factor(state([1.0, 1.0], predicted_by="linear").trained) == 99.0


@pytest.mark.parametrize(
    ("latent", "noise", "worst"),
    [([0.3, 0.1], [0.1, 0.1], 9.0), ([0.1, 0.2], [0.1, 0.4], 1.0), ([0.1, 0.4], [0.2, 0.1], 16.0)],
)
def test_the_noise_ratio_is_the_worst_axis_of_variances(
    campaign: Campaign, latent: list[float], noise: list[float], worst: float
) -> None:
    (found,) = seen_by_the_rule(campaign, state([9.0, 9.0], latent_deviation=latent, noise_deviation=noise))
    assert found.noise_ratio == pytest.approx(worst)


def test_without_noise_there_is_no_ratio(campaign: Campaign) -> None:
    assert seen_by_the_rule(campaign, state([1.0, 1.0], noise_deviation=None))[-1].noise_ratio is None
