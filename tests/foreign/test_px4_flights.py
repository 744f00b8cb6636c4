"""What leaves for PX4 stays inside limits and margins in PX4's own cascade, from before it to after it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from flights import RATE, left, planned, vehicle
from px4_cascade import Body, fly, padded

from etude.deploy.exporters.offboard import NED
from etude.logs.tracked import tracked
from etude.types import Channel, Log

FEW, MANY, BATCH = 6, 500, 25
FIRST = 9000
"""Seeds from 1000 and from 5000 settled the limits of vertical speed and what is assumed of tracking."""


def test_no_flight_leaves_a_limit_or_its_margin() -> None:
    flights = [planned(vehicle(seed), seed, ground=seed % 2 == 1) for seed in range(FEW)]
    assert left(flights) == []


def test_the_first_row_and_the_last_are_at_rest_to_the_bit() -> None:
    own = planned(vehicle(1), 1, ground=False)
    assert not own.rows[0, 3:].any()
    assert not own.rows[-20:, 3:].any()
    assert np.ptp(own.rows[-20:, :3], axis=0).max() == 0.0
    assert np.linalg.norm(own.rows[:, 3:6], axis=1).max() > 0.3 * own.spec.speed, "it moves in between"


def test_it_holds_with_a_wrong_hover_thrust_and_drag() -> None:
    """6 % and 0.2 1/s that the autopilot does not know: its integral finds them while it waits and flies."""
    flights = [planned(vehicle(seed), seed, ground=False) for seed in (2, 4, 5)]
    assert left(flights, Body(hover=0.53, drag=0.2)) == []


def test_a_start_with_a_step_is_in_no_margin() -> None:
    """Set-points that begin in motion, as they used to: a step of metres a second."""
    starts = 0
    for seed in (1, 3, 4, 7):
        own = planned(vehicle(seed), seed, ground=False)
        flight = own.whole.pieces()[1][2]
        orders = flight.motion(np.arange(0.0, flight.duration, 1.0 / RATE), 3).orders @ NED.T
        flown = fly(padded([np.concatenate(list(orders), axis=1)], RATE, 0.0, 0.0), RATE)
        channel = Channel("position", ("x", "y", "z"), ("m", "m", "m"))
        log = Log(flown.t, {"position": channel}, {"position": flown.position[:, 0] @ NED.T})
        found = tracked(log, flight, "position")
        late = flown.t > 0.5 * flight.duration
        error = flown.position[:, 0] @ NED.T - flight.motion(flown.t, 1).orders[0]
        later = np.abs(error[late]).max(axis=0)
        assert (found.errors["fourier"][0] >= later - 1e-9).all(), "all of what is left later counts"
        if found.start is not None:
            starts += 1
            assert found.start.until < 0.45 * flight.duration
            assert found.errors["fourier"][1].max() < 0.7 * found.start.errors[1].max()
    assert starts >= 3


@pytest.mark.slow
def test_five_hundred_flights(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Resumable: batches that were flown stand in the file that ETUDE_FLIGHTS names."""
    path = Path(os.environ.get("ETUDE_FLIGHTS", tmp_path_factory.mktemp("flights") / "flown.json"))
    done = json.loads(path.read_text()) if path.exists() else {}
    for first in range(FIRST, FIRST + MANY, BATCH):
        if str(first) not in done:
            seeds = range(first, first + BATCH)
            done[str(first)] = left([planned(vehicle(s), s, ground=s % 2 == 1) for s in seeds])
            path.write_text(json.dumps(done))
    wrong = [text for own in done.values() for text in own]
    assert not wrong, f"{len(wrong)} of {MANY}: {wrong[:10]}"
