"""Room for the distance from the plan that logs have shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from etude.campaign.create import create_campaign
from etude.campaign.margins import FACT, distance_from_plan, measured_margins
from etude.campaign.state import Round, State
from etude.contracts import Channel, Log
from etude.limits.library import AxisLimit


def log_of(error: np.ndarray) -> Log:
    t = np.linspace(-1.0, 11.0, len(error))
    plan = np.column_stack([np.sin(t), np.cos(t)])
    channels = {name: Channel(name, ("x", "y"), ("m", "m")) for name in ("position", "position_des")}
    return Log(t, channels, {"position": plan + error, "position_des": plan})


def told(*largest: list[float] | None) -> State:
    rounds = {
        i: Round(i, asked={}, told={} if size is None else {FACT: size}) for i, size in enumerate(largest, 1)
    }
    return State(rounds=rounds)


def test_the_largest_distance_counts_while_the_motion_lasts() -> None:
    error = np.zeros((121, 2))
    error[50], error[70], error[5], error[118] = (0.3, -0.1), (-0.2, 0.25), (9.0, 9.0), (9.0, 9.0)
    assert distance_from_plan(log_of(error), "position", 10.0) == pytest.approx([0.3, 0.25])
    assert distance_from_plan(log_of(error).without("position_des"), "position", 10.0) is None
    assert distance_from_plan(log_of(error), "q", 10.0) is None


def test_margins_are_the_largest_so_far_times_the_factor() -> None:
    table, confidence = measured_margins(told([0.2, 0.5], None, [0.4, 0.1]), "fourier", 1.5)["fourier"]
    np.testing.assert_allclose(table, [[0.6, 0.75]])
    assert confidence == pytest.approx(2.0 / 3.0)
    assert measured_margins(told(None), "fourier", 1.5) == {}
    assert measured_margins(told([0.2, 0.5]), "fourier", 0.0) == {}


def test_flights_keep_what_was_measured_where_it_is_more_than_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign, _ = create_campaign(tmp_path / "sky", "quadrotor")

    def box(*largest: list[float] | None) -> AxisLimit:
        monkeypatch.setattr(type(campaign), "state", lambda _: told(*largest))
        (found,) = [own for own in campaign.limits() if own.name == "position"]
        assert isinstance(found, AxisLimit)
        return found

    described = box().inner("fourier")
    np.testing.assert_allclose(described[2], [1.0, 1.0, 0.3])
    low, high, margin, confidence = box([2.0, 0.1, 0.4]).inner("fourier")
    np.testing.assert_allclose(margin, [3.0, 1.0, 0.6])
    np.testing.assert_allclose(high - low, [14.0, 18.0, 3.8])
    assert confidence == 0.5
    # half of the box is left for the flight, whatever was measured
    np.testing.assert_allclose(box([50.0, 0.1, 9.0]).inner("fourier")[2], [5.0, 1.0, 1.25])
    thesis, _ = create_campaign(tmp_path / "thesis", "quadrotor", "thesis")
    assert replace(thesis.config.trajectory).room_factor == 0.0
    np.testing.assert_allclose(
        next(own for own in thesis.limits() if own.name == "position").inner("fourier")[2], described[2]
    )
