from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from trajectory_examples import FAMILIES, robot

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.certificate import certify, certify_bytes, require_certified
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint, random_moves
from etude.trajectories.random import random_trajectory

QUANTITIES = {"position": "q", "velocity": "qd", "acceleration": "qdd"}


def assert_inside(motion, certificate, spec: RobotSpec, count: int, slack: float = 0.0) -> None:
    samples = motion.sample(np.linspace(0.0, motion.duration, count))
    for row in certificate.rows:
        values = getattr(samples, QUANTITIES[row.quantity])[:, spec.names.index(row.axis)]
        assert row.proved_lower - slack <= values.min(), row
        assert values.max() <= row.proved_upper + slack, row
        assert row.margin == min(row.upper - row.proved_upper, row.proved_lower - row.lower)


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES.keys())
def test_dense_samples_stay_inside_what_is_proved(family) -> None:
    rng = np.random.default_rng(3)
    for seed in range(15):
        spec = robot(seed)
        motion = random_trajectory(rng, spec, family, "limits")
        for method in ("riesz", "roots"):
            certificate = certify(motion, spec, method=method)
            assert certificate.ok
            slack = 0.0 if method == "riesz" else 1e-12
            assert_inside(motion, certificate, spec, 6400 * family.harmonics, slack)


@pytest.mark.parametrize("harmonics", [1, 2, 6, 10])
def test_ramped_series_of_any_kind_are_bounded(harmonics: int) -> None:
    rng, spec = np.random.default_rng(harmonics), robot(1)
    for _ in range(20):
        omega0, ramp = 10.0 ** rng.uniform(-1, 0.5), rng.uniform(0.1, 5.0)
        table = rng.standard_normal((2 * harmonics + 1, 3))
        motion = FourierTrajectory(table, omega0, 20.0, ramp)
        assert_inside(motion, certify(motion, spec), spec, 20_000)


def test_moves_are_bounded_exactly() -> None:
    rng = np.random.default_rng(0)
    for seed in range(20):
        spec = robot(seed)
        motion = random_moves(rng, spec, 5)
        certificate = certify(motion, spec)
        assert certificate.ok
        assert_inside(motion, certificate, spec, 100_000, slack=1e-12)
        samples = motion.sample(np.linspace(0.0, motion.duration, 100_000))
        for row in certificate.rows:
            values = getattr(samples, QUANTITIES[row.quantity])[:, spec.names.index(row.axis)]
            reached = (values.max() - values.min()) / (row.proved_upper - row.proved_lower)
            assert reached > 0.99, row


def test_the_bytes_that_were_written_are_what_is_certified() -> None:
    spec = robot()
    motion = random_trajectory(np.random.default_rng(0), spec, FAMILIES["nullspace"])
    assert certify_bytes(motion.to_json().encode(), spec) == certify(motion, spec)
    content = json.loads(motion.to_json())
    content["coefficients"][0][1] += 10.0
    assert not certify_bytes(json.dumps(content).encode(), spec).ok


def test_certificate_as_json() -> None:
    spec = robot()
    motion = random_trajectory(np.random.default_rng(0), spec, FAMILIES["ramp, omega0 free"])
    content = json.loads(certify(motion, spec).to_json())
    assert content["ok"] is True
    assert [row["axis"] for row in content["rows"]] == [n for n in spec.names for _ in range(3)]
    assert all("Riesz" in row["method"] and "ramp" in row["method"] for row in content["rows"])


def test_a_limit_that_is_not_met_is_named() -> None:
    spec = robot()
    motion = random_trajectory(np.random.default_rng(0), spec, FAMILIES["nullspace"])
    faster = FourierTrajectory(motion.coefficients, 3.0 * motion.omega0, motion.duration / 3.0)
    slow = replace(spec, axes=(spec.axes[0], replace(spec.axes[1], velocity=1e-3), spec.axes[2]))
    with pytest.raises(UnsafeTrajectoryError, match=r"velocity of joint 'j1' may reach .*0\.001") as caught:
        require_certified(faster, slow)
    assert caught.value.exit_code == 4
    assert not certify(faster, slow).ok


def test_positions_outside_a_box() -> None:
    spec = robot()
    motion = random_trajectory(np.random.default_rng(0), spec, FAMILIES["nullspace"])
    whole = (spec.lower, spec.upper)
    assert require_certified(motion, spec, box=whole).rows[3].quantity == "box"
    half = (spec.lower, 0.5 * (spec.lower + spec.upper))
    with pytest.raises(UnsafeTrajectoryError, match="box of joint"):
        require_certified(motion, spec, box=half)


def test_a_velocity_step_at_the_start_is_not_certified() -> None:
    spec = robot()
    table = np.zeros((3, 3))
    table[0] = 0.5 * (spec.lower + spec.upper)
    table[1] = 1e-4
    motion = FourierTrajectory(table, 1.0, 2.0 * np.pi)
    certificate = certify(motion, spec)
    assert all(row.margin > 0 for row in certificate.rows)
    assert not certificate.ok
    with pytest.raises(UnsafeTrajectoryError, match="not at rest"):
        require_certified(motion, spec)
    require_certified(FourierTrajectory(table, 1.0, 2.0 * np.pi, 1.0), spec)


def test_part_of_a_period_does_not_end_at_rest() -> None:
    spec = robot()
    motion = random_trajectory(np.random.default_rng(0), spec, FAMILIES["nullspace"])
    with pytest.raises(UnsafeTrajectoryError, match="not at rest"):
        require_certified(FourierTrajectory(motion.coefficients, motion.omega0, 45.0), spec)


def test_use_and_active_limits() -> None:
    spec = robot()
    middle = 0.5 * (spec.lower + spec.upper)
    motion = PointToPoint(np.array([middle, spec.upper]), 0.1 * spec.velocity, 0.5, spec.acceleration)
    certificate = certify(motion, spec)
    assert {("j0", "position"), ("j1", "position"), ("j2", "position")} <= set(certificate.active())
    assert certificate.worst.use == pytest.approx(1.0)


def test_another_robot_and_another_kind() -> None:
    class Unknown:
        dof, duration = 3, 1.0

    with pytest.raises(UsageError, match="moves 2 joints"):
        certify(FourierTrajectory(np.zeros((3, 2)), 1.0, 5.0), robot())
    with pytest.raises(UsageError, match="no certificate for a Unknown"):
        certify(Unknown(), robot())
    with pytest.raises(UsageError, match="'riesz' or 'roots'"):
        certify(FourierTrajectory(np.zeros((3, 3)), 1.0, 5.0), robot(), method="samples")
