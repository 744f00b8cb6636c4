"""The study of flights' margins: what its tables count, and how a flight is measured."""

from __future__ import annotations

import numpy as np

from etude.trajectories import FourierTrajectory
from etude.types import Channel, Log
from etude_studies.flight_margins import FLIGHTS, MANNERS, ROBOTS, _away, summary


def campaign(manner: str, seed: int, part: float, error: float) -> dict[str, object]:
    flight = {"of margin": part, "away": part, "extent": 5.0, "speed": 1.0, "errors": {"uniform": error}}
    return {"robot": ROBOTS[0], "onset": manner, "seed": seed, "flights": [flight] * FLIGHTS}


def test_the_tables_count_flights_beyond_their_margin_and_pair_seeds() -> None:
    rows = [campaign(MANNERS[0], s, part, 0.2) for s, part in ((1, 0.5), (2, 1.5), (3, 1.01))]
    rows += [campaign(MANNERS[1], s, 0.1, 0.1) for s in (1, 2)]
    lines = summary(rows).splitlines()
    assert len(lines) == 1 + 2 * FLIGHTS + FLIGHTS
    assert lines[1].split()[-5:] == ["3", "2", "1.50", "1.01", "5.0"]
    assert lines[5].split()[-5:] == ["2", "0", "0.10", "0.10", "5.0"]
    assert lines[-1].endswith("uniform: 0.100 m, 0.200 m, ratio 0.50 (0.50 .. 0.50), 2 seeds")


def test_a_distance_is_held_against_the_margin_of_its_axis() -> None:
    plan = FourierTrajectory(np.zeros((3, 3)), 1.0, 10.0)
    t = np.linspace(0.0, 10.0, 11)
    where = plan.motion(t, 1).orders[0] + np.where(t[:, None] == 5.0, [[0.5, 0.1, -0.6]], 0.0)
    log = Log(t, {"position": Channel("position", ("x", "y", "z"), ("m",) * 3)}, {"position": where})
    rows = [{"quantity": "position", "tracking_margin": kept} for kept in (1.0, 1.0, 0.3)]
    rows.append({"quantity": "speed", "tracking_margin": 0.1})
    found = _away(log, plan, rows)
    np.testing.assert_allclose([found["away"], found["of margin"]], [0.6, 2.0])
