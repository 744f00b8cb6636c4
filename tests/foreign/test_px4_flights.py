"""What leaves for PX4 stays inside limits and margins in PX4's own cascade, from before it to after it."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path

import numpy as np
import pytest
from flights import RATE, Planned, asked, left, planned, proposed, robot_file, vehicle
from px4_cascade import Body, fly, padded

from etude.campaign import open_campaign
from etude.logs import tracked
from etude.types import Channel, Log
from etude_quadrotor import NED

FEW, MANY, BATCH = 2, 500, 25
ASKED = 30
"""Vehicles and rooms whose flights `etude ask` proposes."""
DRAG = (0.54, 0.54, 0.07)
"""1/s of the vehicle of the example, by axis: drag over velocity in the set-points of its campaign."""
EXAMPLES = Path(__file__).parents[2] / "examples" / "px4"
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
    flights = [planned(vehicle(seed), seed, ground=False) for seed in (2, 5)]
    assert left(flights, Body(hover=0.53, drag=0.2)) == []


def test_a_start_with_a_step_is_in_no_margin() -> None:
    """Set-points that begin in motion, as they used to: a step of metres a second."""
    starts = 0
    for seed in (1, 3):
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
    assert starts


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


def one_asked(seed: int, folder: Path) -> Planned:
    """The first flight for a vehicle of that seed: from hover, or from the ground and back."""
    robot = robot_file(vehicle(seed), folder / f"{seed}.toml")
    return asked(robot, folder / f"lab{seed}", seed, start="ground" if seed % 2 else "")


def test_what_ask_proposes_stays_inside(tmp_path: Path) -> None:
    assert left([one_asked(seed, tmp_path) for seed in (9,)]) == []


@pytest.mark.slow
def test_what_ask_proposes_stays_inside_for_many(tmp_path: Path) -> None:
    wrong = left([one_asked(seed, tmp_path) for seed in range(100, 100 + ASKED)])
    assert not wrong, f"{len(wrong)} of {ASKED}: {wrong}"


@pytest.mark.slow
def test_what_ask_proposes_after_a_log(tmp_path: Path) -> None:
    """A recording in PX4's format, then flights in its room, each from the ground or from hover.

    The set-points hold against the drag that was learned, so the vehicle here has it too.
    """
    pytest.importorskip("pyulog", reason="its log is read by the extra 'px4'")
    robot, log = EXAMPLES / "px4_quad.toml", EXAMPLES / "flight.ulg"
    flights = [
        asked(robot, tmp_path / f"lab{seed}", seed, start="ground" if seed % 2 else "", log=log)
        for seed in range(8)
    ]
    assert left(flights, Body(drag=DRAG)) == []


def drag_of(own: Planned) -> tuple[float, float, float]:
    """1/s by axis, that its set-points hold against; nothing where none was learned."""
    rows = list(csv.DictReader(io.StringIO(own.files["setpoints.csv"].decode())))
    if "drag_north" not in rows[0]:
        return (0.0, 0.0, 0.0)
    names = ("north", "east", "down")
    drag, velocity = (
        np.array([[float(row[prefix + axis]) for axis in names] for row in rows]) for prefix in ("drag_", "v")
    )
    north, east, down = (drag * velocity).sum(axis=0) / (velocity**2).sum(axis=0)
    return (north, east, down)


@pytest.mark.slow
def test_what_ask_proposes_after_its_own_flights(tmp_path: Path) -> None:
    """Margins are then those of logs: rotorpy's vehicle flew two proposals under PX4's cascade."""
    pytest.importorskip("rotorpy", reason="rotorpy has no wheel for this Python: pip install rotorpy")
    from flight_lab import learned_lab
    from rotorpy_vehicle import Cascade

    for seed in range(3):
        folder = tmp_path / str(seed)
        folder.mkdir()
        lab, _ = learned_lab(folder, 2, seed=seed, controller=Cascade, quick=True)
        own = proposed(open_campaign(lab), "ground")
        assert left([own], Body(drag=drag_of(own))) == []
