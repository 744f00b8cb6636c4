"""The stop rule, by its own words: which rule fires, when, and when it must not be believed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.campaign.evaluate.stopping import LogOutcome, stop_verdict
from etude.campaign.record.config import StopConfig
from etude.codes import Stop
from etude.errors import UsageError

CONFIG = StopConfig(command_tolerance=0.02)
OPEN = LogOutcome(1, 0.2, 5.0, 0.5, 1.5, 1.0, 0.1, 1.0)
"""Worth going on in every respect."""


def series(*changes: dict[str, object]) -> list[LogOutcome]:
    return [replace(OPEN, number=i + 1, **change) for i, change in enumerate(changes)]  # type: ignore[arg-type]


RULES = [
    ("tolerance", {"forecast": 0.01}),
    ("noise", {"noise_ratio": 0.05}),
    ("gain", {"gain": 0.05}),
]


@pytest.mark.parametrize(("rule", "change"), RULES)
def test_a_rule_fires_after_two_in_a_row(rule: str, change: dict[str, object]) -> None:
    assert not stop_verdict(series(change), CONFIG).stop
    assert not stop_verdict(series(change, {}), CONFIG).stop
    assert not stop_verdict(series({}, change), CONFIG).stop
    assert not stop_verdict(series(change, {}, change), CONFIG).stop
    verdict = stop_verdict(series({}, change, change), CONFIG)
    assert (verdict.stop, verdict.rule) == (True, rule)
    assert stop_verdict(series(change), replace(CONFIG, consecutive=1)).rule == rule


@pytest.mark.parametrize(("rule", "change"), RULES)
def test_no_rule_fires_before_promote_can_decide(rule: str, change: dict[str, object]) -> None:
    """From four held-out segments on, and a rule that fired is the end of a run."""
    few = series({**change, "segments": 1}, {**change, "segments": 3})
    assert stop_verdict(few, CONFIG).reason == "1 more log before a stop rule applies."
    enough = series(*({**change, "segments": n} for n in (1, 3, 4)))
    assert stop_verdict(enough, CONFIG).rule == rule
    assert stop_verdict(few, replace(CONFIG, budget_trajectories=2)).rule == "budget"


@pytest.mark.parametrize(("rule", "change"), RULES)
def test_a_rule_can_be_switched_off(rule: str, change: dict[str, object]) -> None:
    off = StopConfig(command_tolerance=0, noise_fraction=0, gain_per_minute=0, budget_trajectories=0)
    assert not stop_verdict(series(change, change, change), off).stop


def test_the_budget_fires_at_once() -> None:
    assert stop_verdict(series({}, {}), replace(CONFIG, budget_trajectories=2)).rule == "budget"
    assert stop_verdict(series({"robot_minutes": 3.0}), replace(CONFIG, budget_minutes=3.0)).rule == "budget"
    assert not stop_verdict([], CONFIG).stop


@pytest.mark.parametrize(
    ("doubt", "words"), [({"calibration": 2.5}, "2.5 times"), ({"moved": 0.8}, "factor 2.2")]
)
def test_a_tolerance_is_not_believed_of_a_doubtful_model(doubt: dict[str, object], words: str) -> None:
    verdict = stop_verdict(series({"forecast": 0.01}, {"forecast": 0.01, **doubt}), CONFIG)
    assert not verdict.stop
    assert verdict.notice.code == Stop.DOUBTED
    assert words in verdict.reason
    assert stop_verdict(series({"noise_ratio": 0.0}, {"noise_ratio": 0.0, **doubt}), CONFIG).rule == "noise"


def test_unknown_evidence_never_stops() -> None:
    unknown = {"noise_ratio": None, "gain": None, "calibration": None, "moved": None}
    assert not stop_verdict(series(unknown, unknown), CONFIG).stop


@given(st.floats(0, 1), st.floats(0, 10), st.floats(0, 1), st.floats(0.1, 10))
def test_better_evidence_never_revokes_a_stop(
    forecast: float, noise: float, gain: float, calibration: float
) -> None:
    e = {"forecast": forecast, "noise_ratio": noise, "gain": gain, "calibration": calibration}
    better = {
        "forecast": forecast / 2,
        "noise_ratio": noise / 2,
        "gain": gain / 2,
        "calibration": calibration / 2,
    }
    if stop_verdict(series(e, e), CONFIG).stop:
        assert stop_verdict(series(better, better), CONFIG).stop


def test_impossible_rules_are_refused() -> None:
    with pytest.raises(UsageError, match="gain_per_minute"):
        StopConfig(gain_per_minute=-0.1)
