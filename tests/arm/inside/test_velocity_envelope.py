"""Velocity limits that shrink towards the ends of a joint: proved at all times, kept by ways and moves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import FeasibleSet, certify, scaled
from etude.testing import LimitSuite
from etude.trajectories import FourierConfig, PointToPoint
from etude_arm import ArmSpec, Axis
from etude_arm.motions import family, limits
from etude_arm.robot_file import parse_robot, robot_to_toml
from etude_arm.spec import Envelope
from etude_arm.velocity_envelope import EnvelopeLimit

FIRST = Envelope(-0.30, 12.0, -2.7501, 2.7501)
SIXTH = Envelope(-0.35, 11.0, 0.54092, 4.5205)
SPEC = ArmSpec(
    "two of the FR3's joints",
    (
        Axis("fr3_joint1", -2.7437, 2.7437, 2.62, 10.0, 87.0, envelope=FIRST),
        Axis("fr3_joint6", 0.5445, 4.5169, 4.18, 10.0, 12.0, envelope=SIXTH),
    ),
    "N m",
    100.0,
)
HOME = np.array([0.0, 2.5])


def of(spec: ArmSpec, margins=None) -> EnvelopeLimit:
    (found,) = (one for one in limits(spec, margins or {}) if isinstance(one, EnvelopeLimit))
    return found


def published(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """(T, 2) what is left by the formulas of the robot's documentation, joints 1 and 6."""
    root = lambda slope, way: np.sqrt(np.maximum(0.0, slope * way))  # noqa: E731
    upper = [
        np.minimum(2.62, np.maximum(0.0, -0.30 + root(12.0, 2.75010 - q[:, 0]))),
        np.minimum(4.18, np.maximum(0.0, -0.35 + root(11.0, 4.52050 - q[:, 1]))),
    ]
    lower = [
        np.maximum(-2.62, np.minimum(0.0, 0.30 - root(12.0, 2.75010 + q[:, 0]))),
        np.maximum(-4.18, np.minimum(0.0, 0.35 - root(11.0, -0.54092 + q[:, 1]))),
    ]
    return np.stack([np.minimum(upper[j] - qd[:, j], qd[:, j] - lower[j]) for j in range(2)], axis=1)


class TestEnvelope(LimitSuite):
    limit = of(SPEC)
    family = family(SPEC, FourierConfig())
    home = HOME


def fast_motion():
    """Inside all constant limits, and at the ends faster than the robot lets it be."""
    free = dataclasses.replace(SPEC, axes=tuple(dataclasses.replace(a, envelope=None) for a in SPEC.axes))
    rng = np.random.default_rng(0)
    own = family(free, FourierConfig()).drawn(rng)
    return own.trajectory(scaled(rng, FeasibleSet.of(limits(free, {}), own, HOME))[0])


def test_the_row_is_what_the_published_formulas_leave_at_worst() -> None:
    motion = fast_motion()
    orders = motion.motion(np.linspace(0.0, motion.duration, 40_001), 2).orders
    worst = published(orders[0], orders[1]).min(axis=0)
    rows = of(SPEC).prove(motion)
    assert [row.axis for row in rows] == list(SPEC.names)
    for row, least in zip(rows, worst, strict=True):
        assert least - 0.005 * 4.18 <= row.proved_lower <= least + 1e-9
    assert worst.min() < 0.0
    assert not certify(motion, limits(SPEC, {})).ok


def test_tracking_errors_of_position_and_velocity_count() -> None:
    motion = PointToPoint(np.array([[0.0, 2.5], [2.5, 2.5]]), 2.0, 0.0, 8.0, 50.0)
    margins = {motion.form: (np.array([[0.01, 0.0], [0.05, 0.0]]), 1.0)}
    t = np.linspace(0.0, motion.duration, 40_001)
    orders = motion.motion(t, 2).orders
    off = np.array([0.01, 0.0]), np.array([0.05, 0.0])
    expected = min(
        published(orders[0] + sign * off[0], orders[1] + sign * off[1])[:, 0].min() for sign in (1.0, -1.0)
    )
    row = of(SPEC, margins).prove(motion)[0]
    assert row.proved_lower == pytest.approx(expected, abs=0.01)
    assert row.tracking_margin > 0.05


def test_the_penalty_pushes_inside_by_its_gradient() -> None:
    motion, limit = fast_motion(), of(SPEC)
    planned = motion.motion(np.linspace(0.0, motion.duration, 200), 3)
    value, gradient = limit.penalty(planned)
    assert value > 0.0
    rng = np.random.default_rng(1)
    way = rng.standard_normal(planned.orders.shape)
    step = 1e-7
    ends = [
        limit.penalty(dataclasses.replace(planned, orders=planned.orders + sign * step * way))[0]
        for sign in (-1.0, 1.0)
    ]
    assert (ends[1] - ends[0]) / (2.0 * step) == pytest.approx(float((gradient * way).sum()), rel=1e-4)


def test_the_robot_file_keeps_it_and_refuses_nonsense(tmp_path) -> None:
    assert parse_robot(robot_to_toml(SPEC), where="", folder=tmp_path) == SPEC
    same = Envelope(0.0, 1.0, 1.0, 1.0)
    for wrong in (dataclasses.replace(FIRST, slope=0.0), same):
        spec = dataclasses.replace(SPEC, axes=(dataclasses.replace(SPEC.axes[0], envelope=wrong),))
        with pytest.raises(UsageError, match="envelope"):
            parse_robot(robot_to_toml(spec), where="", folder=tmp_path)
