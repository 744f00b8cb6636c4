"""What is commanded to an autopilot holds the tilt limit, with what was learned of the drag too."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from etude.deploy import MotionWithCommands, certify_played
from etude.deploy.feedforward import within_tilt
from etude.limits import FeasibleSet, at_rest, boundary, certify
from etude_quadrotor import KIND, NED, OFFBOARD, FlightConfig, flight_family

ROBOT = Path(__file__).parents[3] / "examples" / "px4" / "px4_quad.toml"
TILT = np.deg2rad(20.0)


@pytest.mark.parametrize("drag", [0.0, 0.6, 1.5])
def test_the_learned_part_is_cut_to_the_tilt(drag: float) -> None:
    spec = KIND.spec(ROBOT)
    config = FlightConfig(2, 15.0, tilt=TILT)
    allowed, family = KIND.limits(spec, SimpleNamespace(trajectory=config), None, {}), flight_family(config)
    room = FeasibleSet.of(allowed, family, KIND.home(spec))
    motion = at_rest(family.trajectory(boundary(np.random.default_rng(3), room)[0]), allowed)
    assert certify(motion, allowed).ok

    def told(t: np.ndarray) -> np.ndarray:
        orders = motion.motion(t, 3).orders
        return np.asarray(orders[2] + drag * orders[1])

    what = within_tilt(MotionWithCommands(motion, acceleration=told), allowed)
    files = OFFBOARD(what, KIND, spec)
    proof = certify_played(OFFBOARD, files, allowed, motion)
    table = np.loadtxt(files["setpoints.csv"].decode().splitlines(), delimiter=",", skiprows=1)
    answered = table[:, 7:10] - (table[:, 14:17] if drag else 0.0)  # less the part for PX4's cascade
    thrust = answered @ NED.T + [0.0, 0.0, 9.81]
    tilts = np.arctan2(np.hypot(thrust[:, 0], thrust[:, 1]), thrust[:, 2])
    assert tilts.max() <= TILT
    assert proof.ok
    rows = [row for row in proof.rows if row.quantity == "tilt, commanded"]
    assert len(rows) == (drag > 0.0)
    if drag:
        assert abs(rows[0].proved_upper - tilts.max()) < 1e-6
        assert np.abs(table[:, 11:14]).max() > 0.3, "and what the limit allows of it is held"
