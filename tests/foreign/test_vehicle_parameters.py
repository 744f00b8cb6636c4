"""Parameters from flights in a plant of others: off by little, and in their intervals as often as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rotorpy", reason="rotorpy is not installed: pip install 'rotorpy>=2.1'")

from measure_vehicle_parameters import (
    FRAMES,
    SEEDS,
    TARGETS,
    covered,
    flown,
    measured,
    off,
    to_and_fro,
    up_and_down,
)
from rotorpy_vehicle import fly


def worst(rows: list[dict], word: str) -> float:
    """Error of a quantity over rows that are measured; of the centre of mass in m, else relative."""
    own = [row for row in rows if row["parameter"].startswith(word) and row["value"] is not None]
    assert own, word
    return max(map(off, own))


@pytest.mark.slow
def test_two_flights_of_a_hexacopter_tell_hover_thrust_centre_and_drag() -> None:
    """With the thrust curve and the hover thrust that they tell it hovers at once."""
    frame = FRAMES["hexacopter"]
    rows = measured(frame, [own.log for own in flown(frame, 1, 2)])
    for word in ("hover thrust", "centre of mass", "rotor drag"):
        assert worst(rows, word) < TARGETS[word], word
    told = {row["parameter"]: row["value"] for row in rows}
    set_right = replace(frame, curve=min(told["thrust curve"], 1.0))
    hovering = np.tile([0.0, 0.0, 3.0, *[0.0] * 6], (150, 1))
    own, other = (
        fly(hovering, frame=set_right, hover=h) for h in (told["hover thrust with that curve"], 0.5)
    )
    sunk, jumped = (float(np.abs(flight.position[:, 2] - 3.0).max()) for flight in (own, other))
    assert sunk < 0.05 < jumped


@pytest.mark.slow
def test_a_flight_up_and_down_tells_the_motors_lag() -> None:
    for seed in SEEDS[:2]:
        rows = measured(
            FRAMES["quadrotor"], [own.log for own in flown(FRAMES["quadrotor"], seed, 2, [up_and_down()])]
        )
        (own,) = (row for row in rows if row["parameter"] == "motor time constant")
        assert own["value"] is not None
        assert off(own) < TARGETS["motor time constant"]


@pytest.mark.slow
def test_flights_to_and_fro_tell_the_drag_of_the_body() -> None:
    """Random flights of as many seconds err by up to 64 %."""
    frame = FRAMES["quadrotor"]
    rows = measured(frame, [own.log for own in flown(frame, SEEDS[0], 6, [to_and_fro()] * 3)])
    drags = [row for row in rows if row["parameter"].startswith("body drag")]
    assert all(row["value"] is not None for row in drags)
    assert worst(drags, "body drag") < 0.2


@pytest.mark.slow
def test_ten_campaigns_are_near_the_truth_and_covered() -> None:
    """Frames in turn; 100 intervals: with .95 each, fewer than 88 or more than 99 have a chance of some %."""
    rows = []
    for seed in SEEDS:
        frame = FRAMES[list(FRAMES)[seed % len(FRAMES)]]
        rows += measured(frame, [own.log for own in flown(frame, seed)])
    for word in ("hover thrust", "centre of mass", "rotor drag"):
        assert worst(rows, word) < TARGETS[word], word
    told = [row for row in rows if row["value"] is not None]
    assert len(told) > 0.7 * len(rows)
    assert 0.88 <= covered(told) <= 0.99
