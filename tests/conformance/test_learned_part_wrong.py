"""What is commanded because it was learned may be wrong: how far the robot is then off its plan."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from px4_cascade import fly, padded

from etude.deploy import MotionWithCommands, certified_playback, certify_played
from etude.errors import UnsafeTrajectoryError
from etude.limits import AxisLimit, Certificate, FeasibleSet, at_rest, boundary, slack
from etude.protocols import Limit
from etude.types import Array
from etude_quadrotor import KIND, NED, OFFBOARD, FlightConfig, flight_family

ROBOT = Path(__file__).parents[2] / "examples" / "px4" / "px4_quad.toml"
WRONG = "where what was learned is wrong"


def flight(drag: float, tmp_path: Path, extra: str = "") -> tuple[MotionWithCommands, tuple[Limit, ...]]:
    """A flight at the edge of its limits, whose accelerations hold against that drag, 1/s."""
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT.read_text() + extra)
    spec = KIND.spec(path)
    config = FlightConfig(2, 15.0)
    allowed, family = KIND.limits(spec, SimpleNamespace(trajectory=config), None, {}), flight_family(config)
    room = FeasibleSet.of(allowed, family, KIND.home(spec))
    motion = at_rest(family.trajectory(boundary(np.random.default_rng(0), room)[0]), allowed)

    def told(t: Array) -> Array:
        orders = motion.motion(np.minimum(t, motion.duration), 3).orders
        return np.asarray(orders[2] + drag * orders[1])

    return MotionWithCommands(motion, acceleration=told), allowed


def rows(found: Certificate) -> dict[tuple[str, str], tuple[float, float]]:
    """Proved interval by axis and quantity, of rows about what was learned."""
    return {
        (row.axis, row.quantity): (row.proved_lower, row.proved_upper)
        for row in found.rows
        if WRONG in row.quantity
    }


def table(files: dict[str, bytes], *, learned: bool) -> Array:
    """(N, 9) set-points, north, east, down; with the learned part of accelerations or without."""
    lines = files["setpoints.csv"].decode().splitlines()
    values = np.array([line.split(",") for line in lines[1:]], dtype=float)
    own = values[:, 1:10].copy()
    own[:, 6:9] -= 0.0 if learned else values[:, 11:14]
    return own


@pytest.mark.parametrize("extra", [pytest.param("", marks=pytest.mark.slow), "\nradius = 2.4\n"])
def test_a_vehicle_without_the_drag_strays_no_further_than_the_row_says(extra: str, tmp_path: Path) -> None:
    """In PX4's cascade, which is another program, with and without the learned part."""
    what, allowed = flight(0.35, tmp_path, extra)
    files = dict(OFFBOARD(what, KIND, KIND.spec(ROBOT)))
    found = rows(certify_played(OFFBOARD, files, allowed, what.trajectory))
    assert len(found) == (4 if extra else 3)
    flown = [
        fly(padded([table(files, learned=own)], 50.0, 0.0, 8.0)).position[:, 0] @ NED.T
        for own in (True, False)
    ]
    plan = fly(padded([table(files, learned=True)], 50.0, 0.0, 8.0)).setpoint[:, 0] @ NED.T
    off = flown[0] - flown[1]
    places, told = OFFBOARD.strays(files) or (plan, plan)
    assert (np.abs(off).max(axis=0) <= 1.05 * told.max(axis=0) + 0.01).all()
    assert (np.abs(off).max(axis=0)[:2] >= 0.5 * told.max(axis=0)[:2]).all(), "and it is no idle bound"
    for i, axis in enumerate("xyz"):
        low, high = found[axis, f"position, {WRONG}, tracking apart"]
        assert low <= (plan + off)[:, i].min() + 0.02
        assert high >= (plan + off)[:, i].max() - 0.02
        assert abs(high - (places + told)[:, i].max()) < 1e-6


def test_motions_alone_say_nothing_of_it(tmp_path: Path) -> None:
    what, allowed = flight(0.0, tmp_path)
    _, found = certified_playback(OFFBOARD, what.trajectory, KIND, KIND.spec(ROBOT), allowed)
    assert rows(found) == {}
    assert found.notes == ()


@pytest.mark.parametrize(("drag", "least", "most"), [(0.2, 1.0, 1.0), (2.6, 0.5, 0.99)])
def test_what_would_leave_the_room_is_cut(drag: float, least: float, most: float, tmp_path: Path) -> None:
    what, allowed = flight(drag, tmp_path)
    spec = KIND.spec(ROBOT)
    files, found = certified_playback(OFFBOARD, what, KIND, spec, allowed)
    kept, whole = (
        np.abs(table(own, learned=True) - table(own, learned=False)).max()
        for own in (dict(files), dict(OFFBOARD(what, KIND, spec)))
    )
    share = float(kept / whole)
    assert least - 1e-6 <= share <= most + 1e-6
    said = f"Only {100.0 * share:.0f} % of the learned accelerations is commanded"
    assert any(said in note for note in found.notes) == (share < 0.999)
    assert all(slack(row) >= 0.0 for row in found.rows if WRONG in row.quantity)


def test_less_than_half_is_refused(tmp_path: Path) -> None:
    """What is left out is a larger error then, where it was right."""
    what, allowed = flight(4.0, tmp_path)
    with pytest.raises(UnsafeTrajectoryError, match=WRONG):
        certified_playback(OFFBOARD, what, KIND, KIND.spec(ROBOT), allowed)


def test_the_ground_below_a_landing_is_no_wall() -> None:
    """Below the margin a vehicle comes straight down; above it the floor counts."""
    limit = AxisLimit("position", 0, ("z",), np.array([0.0]), np.array([5.0]), margin=np.array([0.3]))
    places = np.array([[0.0], [0.2], [0.5], [1.0]])
    for off, low in (([0.2, 0.4, 0.1, 0.1], 0.0), ([0.0, 0.0, 0.7, 0.0], -0.2)):
        (row,) = limit.strayed(places, np.array(off)[:, None])
        assert (row.lower, row.upper) == (0.0, 5.0)
        assert row.proved_lower == pytest.approx(low)
        assert (slack(row) >= 0.0) == (low == 0.0)
