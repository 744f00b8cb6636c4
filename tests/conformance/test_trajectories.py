"""What every trajectory owes. A new kind is a row in TRAJECTORIES and, to be proposed, a certificate."""

from __future__ import annotations

import numpy as np
import pytest

from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.certificate import certify
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.moves import random_moves
from etude.trajectories.random import random_trajectory
from etude.trajectories.trajectory_file import from_json

SPEC = RobotSpec(
    "pair", (Axis("a", -1.0, 0.5, 0.6, 1.0, 9.0), Axis("b", 0.1, 2.0, 1.0, 3.0, 9.0)), "N m", 100.0
)
RNG = np.random.default_rng(0)
RAMPED = TrajectoryFamily(harmonics=2, duration=20.0, omega0=(0.4, 0.9), rest="ramp", ramp=2.0)
TRAJECTORIES = {
    "fourier, null space": random_trajectory(RNG, SPEC, TrajectoryFamily(duration=20.0)),
    "fourier, phase ramp": random_trajectory(RNG, SPEC, RAMPED),
    "moves": random_moves(RNG, SPEC, 4),
}
EVERY = pytest.mark.parametrize("motion", TRAJECTORIES.values(), ids=TRAJECTORIES.keys())


@EVERY
def test_rates_are_derivatives(motion) -> None:
    t, h = np.linspace(0.01, motion.duration - 0.01, 301), 1e-5
    here, ahead, behind = motion.sample(t), motion.sample(t + h), motion.sample(t - h)
    assert here.q.shape == here.qd.shape == here.qdd.shape == here.qddd.shape == (301, motion.dof)
    for low, high in (("q", "qd"), ("qd", "qdd"), ("qdd", "qddd")):
        slope, exact = (getattr(ahead, low) - getattr(behind, low)) / (2 * h), getattr(here, high)
        wrong = np.abs(slope - exact).max(axis=1) > 1e-4 * np.abs(exact).max() + 1e-6
        # jerk may jump where a piece begins; nothing below it does
        assert np.count_nonzero(wrong) <= (2 if low == "qdd" else 0)


@EVERY
def test_at_rest_at_both_ends_and_outside(motion) -> None:
    ends = motion.sample(np.array([0.0, motion.duration]))
    assert np.abs(ends.qd).max() < 1e-12
    outside = motion.sample(np.array([-5.0, motion.duration + 5.0]))
    np.testing.assert_allclose(outside.q, ends.q, atol=1e-12)
    assert not outside.qd.any()
    assert not outside.qdd.any()


@EVERY
def test_its_limits_are_proved(motion) -> None:
    certificate = certify(motion, SPEC)
    assert certificate.ok
    assert [(r.axis, r.quantity) for r in certificate.rows] == [
        (name, quantity) for name in SPEC.names for quantity in ("position", "velocity", "acceleration")
    ]


@EVERY
def test_samples_do_not_depend_on_the_company_they_are_asked_in(motion) -> None:
    t = np.array([3.0, 1.0, 2.0, 1.0])
    together = motion.sample(t)
    np.testing.assert_array_equal(together.q[1], together.q[3])
    np.testing.assert_allclose(motion.sample(t[2:3]).q[0], together.q[2], rtol=0, atol=1e-14)


@EVERY
def test_a_file_gives_it_back_bit_for_bit(motion) -> None:
    again, t = from_json(motion.to_json()), np.linspace(0.0, motion.duration, 99)
    for name in ("q", "qd", "qdd", "qddd"):
        np.testing.assert_array_equal(getattr(again.sample(t), name), getattr(motion.sample(t), name))
