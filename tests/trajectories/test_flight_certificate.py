from __future__ import annotations

import json
import math

import numpy as np
import pytest
from feasible_examples import room

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.certificate import certify_flight, require_flight_certified
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.fourier import FourierTrajectory

WIDE = room(radius=9.0, tilt=0.5, thrust=(5.0, 14.0))


def dense_values(trajectory: FourierTrajectory, count: int) -> dict[tuple[str, str], np.ndarray]:
    s = trajectory.sample(np.linspace(0.0, 2.0 * np.pi / trajectory.omega0, count))
    force = s.qdd + np.array([0.0, 0.0, GRAVITY])
    across = np.hypot(force[:, 0], force[:, 1])
    out = {(axis, "position"): s.q[:, j] for j, axis in enumerate("xyz")}
    out[("vehicle", "speed")] = np.linalg.norm(s.qd, axis=1)
    out[("vehicle", "radius")] = np.hypot(s.q[:, 0], s.q[:, 1])
    out[("vehicle", "lift")] = force[:, 2]
    out[("vehicle", "thrust")] = np.linalg.norm(force, axis=1)
    out[("vehicle", "tilt")] = np.arctan2(across, force[:, 2])
    return out


@pytest.mark.parametrize("harmonics", [1, 2, 5])
def test_dense_samples_stay_inside_what_is_proved_and_come_near_it(harmonics: int) -> None:
    rng = np.random.default_rng(harmonics)
    for _ in range(40 // harmonics):
        table = 10.0 ** rng.uniform(-1.5, 0.8) * rng.standard_normal((2 * harmonics + 1, 3))
        trajectory = FourierTrajectory(table, omega0 := 10.0 ** rng.uniform(-1.0, 0.3), 2.0 * np.pi / omega0)
        certificate = certify_flight(trajectory, WIDE)
        values = dense_values(trajectory, 100 * 64 * 2 * harmonics)
        assert {(row.axis, row.quantity) for row in certificate.rows} == set(values)
        for row in certificate.rows:
            dense = values[(row.axis, row.quantity)]
            assert dense.max() <= row.proved_upper + 1e-9, row
            two_sided = row.lower != -row.upper or row.quantity == "position"
            assert not two_sided or row.proved_lower <= dense.min() + 1e-9, row
            if row.quantity not in ("tilt", "thrust"):
                assert row.proved_upper <= dense.max() + 0.01 * max(np.abs(dense).max(), np.ptp(dense)), row


def test_tilt_is_proved_to_a_hundredth_of_a_degree_or_two() -> None:
    """A level circle: the lean is constant, atan(a/g)."""
    omega0, radius = 1.0, 3.0
    table = np.zeros((3, 3))
    table[1, 0], table[2, 1] = radius * omega0, radius * omega0
    table[0, 2] = 2.0
    row = certify_flight(FourierTrajectory(table, omega0, 2.0 * np.pi), WIDE).rows[-1]
    assert row.quantity == "tilt"
    assert row.proved_upper == pytest.approx(math.atan2(radius * omega0**2, GRAVITY), abs=3e-4)


def test_nothing_is_proved_of_the_tilt_of_a_vehicle_that_turns_over() -> None:
    table = np.zeros((3, 3))
    table[0, 2], table[1, 2] = 2.0, 20.0
    certificate = certify_flight(FourierTrajectory(table, 1.0, 2.0 * np.pi), WIDE)
    rows = {row.quantity: row for row in certificate.rows}
    assert rows["tilt"].proved_upper == math.pi
    assert rows["lift"].margin < 0.0


def test_rest_is_asked_only_where_it_is_wanted() -> None:
    table = np.zeros((5, 3))
    table[0, 2], table[1, 0] = 2.0, 1.0
    moving = FourierTrajectory(table, 2.0 * np.pi / 30.0, 30.0)
    certificate = certify_flight(moving, room())
    assert certificate.ok
    assert not certificate.at_rest
    assert certificate.end_speed == pytest.approx(1.0 / 6.0)
    assert not certify_flight(moving, room(), rest=True).ok
    with pytest.raises(UnsafeTrajectoryError, match="not at rest"):
        require_flight_certified(moving, room(), rest=True)


def test_the_limit_that_is_missed_is_named() -> None:
    family = FlightFamily()
    table = np.zeros((5, 3))
    table[0, 2], table[1, 0] = 2.0, 1.0
    for changes, message in (
        ({"speed": 0.9}, r"speed \(vehicle\) may reach 1\.\d+, outside its limit -0\.9\.\.0\.9"),
        ({"upper": (3.0, 10.0, 5.0)}, r"position \(x\) may reach 4\.7\d+, outside its limit -9\.5\.\.2\.5"),
        ({"margin": 1.8}, r"position \(z\) may reach 2, outside its limit 2\.1\.\.3\.2"),
        ({"radius": 5.0}, r"radius \(vehicle\) may reach 4\.7"),
        ({"tilt": 0.02}, r"tilt \(vehicle\) may reach 0\.021"),
        ({"thrust": (9.81, 9.812)}, r"thrust \(vehicle\) may reach 9\.812"),
    ):
        with pytest.raises(UnsafeTrajectoryError, match=message) as caught:
            require_flight_certified(FourierTrajectory(table, family.frequency, 30.0), room(**changes))
        assert caught.value.exit_code == 4


def test_json_has_the_form_of_every_certificate() -> None:
    table = np.zeros((5, 3))
    table[0, 2] = 2.0
    content = json.loads(certify_flight(FourierTrajectory(table, 0.2, 30.0), WIDE).to_json())
    assert content["ok"] is True
    assert content["at_rest"] is True
    assert [row["quantity"] for row in content["rows"][3:]] == ["speed", "radius", "lift", "thrust", "tilt"]
    assert "twice the degree" in content["rows"][3]["method"]


def test_not_a_flight() -> None:
    with pytest.raises(UsageError, match="3 axes"):
        certify_flight(FourierTrajectory(np.zeros((3, 2)), 1.0, 5.0), room())
    with pytest.raises(UsageError, match="ramp"):
        certify_flight(FourierTrajectory(np.zeros((3, 3)), 1.0, 5.0, 1.0), room())
