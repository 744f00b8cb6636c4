"""Every simulated vehicle: what a campaign of flights relies on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etude.errors import DataError, UsageError
from etude.types import Log
from etude_quadrotor import KIND, Disturbance, QuadrotorSpec
from etude_quadrotor.channels import command
from etude_quadrotor.plant.flight import Flight
from etude_quadrotor.plant.flight_plan import FlightPlan
from etude_quadrotor.plant.robot import flight_log
from etude_quadrotor.plant.simulated_vehicle import PLANTS, SimulatedVehicle, simulated_vehicle


@pytest.fixture(params=list(PLANTS))
def vehicle(request: pytest.FixtureRequest) -> SimulatedVehicle:
    return simulated_vehicle(request.param)


def spec_of(vehicle: SimulatedVehicle) -> QuadrotorSpec:
    """Its owner's description."""
    return KIND.spec(KIND.built_in()[vehicle.name])


def _circle(vehicle: SimulatedVehicle, seconds: float = 3.0) -> FlightPlan:
    """Half a metre of radius, once in 5 s, in the middle of the room."""
    t = np.arange(round(seconds * vehicle.rate)) / vehicle.rate
    w, zero = 2.0 * np.pi / 5.0, np.zeros_like(t)
    position = 0.5 * np.column_stack([np.cos(w * t), np.sin(w * t), zero]) + [0.0, 0.0, 1.2]
    velocity = 0.5 * w * np.column_stack([-np.sin(w * t), np.cos(w * t), zero])
    return FlightPlan(t=t, position=position, velocity=velocity)


def test_a_flight_is_complete_and_stays_near_its_plan(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle)
    flight = vehicle.fly(plan, np.random.default_rng(0))
    assert flight.ended is None
    assert len(flight) == len(plan)
    for name, rows in vars(flight).items():
        if isinstance(rows, np.ndarray):
            assert len(rows) == len(plan), name
            assert np.isfinite(rows).all(), name
    np.testing.assert_array_equal(flight.position[0], plan.position[0])
    R = flight.R_world_body
    np.testing.assert_allclose(np.einsum("tij,tkj->tik", R, R) - np.eye(3), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(flight.R_world_body), 1.0, atol=1e-12)
    assert np.linalg.norm(flight.position - plan.position, axis=1).max() < 0.7
    told = vehicle.commands
    assert (flight.command >= told.lower).all()
    assert (flight.command <= told.upper).all()


def test_a_hovering_vehicle_stays_where_it_is(vehicle: SimulatedVehicle) -> None:
    t = np.arange(3000) / vehicle.rate
    place = np.tile([0.4, -0.3, 0.5], (len(t), 1))
    flight = vehicle.fly(FlightPlan(t, place, np.zeros_like(place)), None)
    np.testing.assert_allclose(flight.position, place, atol=1e-11)
    np.testing.assert_allclose(flight.rotor_speed, np.tile(flight.rotor_speed[0], (len(t), 1)), rtol=1e-11)


def test_states_are_the_derivatives_of_each_other(vehicle: SimulatedVehicle) -> None:
    flight = vehicle.fly(_circle(vehicle), None)
    for low, high in (
        (flight.position, flight.velocity),
        (flight.velocity, flight.acceleration),
        (flight.rates, flight.angular_acceleration),
    ):
        slope = (low[2:] - low[:-2]) * (0.5 * vehicle.rate)
        np.testing.assert_allclose(slope[200:], high[201:-1], atol=2e-3 * np.abs(high).max())
    turned = np.einsum(
        "tji,tjk->tik", flight.R_world_body[1:-1], flight.R_world_body[2:] - flight.R_world_body[:-2]
    )
    rates = 0.5 * vehicle.rate * np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    np.testing.assert_allclose(rates, flight.rates[1:-1], atol=1e-3 * np.abs(flight.rates).max())


def test_the_same_seed_gives_the_same_flight_and_another_seed_another(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 0.5)
    one, same, other = (vehicle.fly(plan, np.random.default_rng(seed)) for seed in (1, 1, 2))
    for name, rows in vars(one).items():
        if isinstance(rows, np.ndarray):
            np.testing.assert_array_equal(rows, getattr(same, name))
    assert (one.position[1:] != other.position[1:]).any()


def test_a_log_has_samples_or_their_means(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 1.0)
    flight = vehicle.fly(plan, np.random.default_rng(3))
    rate = spec_of(vehicle).rate
    ticks = round(vehicle.rate / rate)
    point = flight_log(flight, plan, rate, averaged=False)
    mean = flight_log(flight, plan, rate, averaged=True)
    for row in range(len(mean)):
        part = slice(row * ticks, (row + 1) * ticks)
        for rows, true in _pairs(point, flight, plan):
            np.testing.assert_array_equal(rows[row], true[part][0])
        for rows, true in _pairs(mean, flight, plan):
            np.testing.assert_allclose(rows[row], true[part].mean(axis=0), rtol=1e-12, atol=1e-12)
    assert len(mean) == len(point) == round(rate)
    np.testing.assert_allclose(np.diff(mean.t), 1.0 / rate)
    assert mean.channels["command"] == replace(command(spec_of(vehicle)), reach=())


def _pairs(log: Log, flight: Flight, plan: FlightPlan) -> list[tuple[np.ndarray, np.ndarray]]:
    pairs = {
        "command": flight.command,
        "position": flight.position,
        "position_des": plan.position,
        "altitude": flight.position[:, 2:],
        "specific_force": flight.specific_force,
        "body_acceleration": flight.acceleration_body,
        "body_velocity": flight.velocity_body,
        "rates": flight.rates,
        "angular_acceleration": flight.angular_acceleration,
    }
    assert set(pairs) == set(log.values)
    return [(log.t, flight.t), *((log[name], true) for name, true in pairs.items())]


def test_wind_carries_and_a_weak_battery_sinks(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 1.5)
    calm = vehicle.fly(plan, None)
    blown = vehicle.fly(plan, None, disturbance=Disturbance(wind=(0.0, 3.0, 0.0)))
    gust = Disturbance(gust=(0.0, 3.0, 0.0), gust_start=1.0, gust_duration=0.5)
    gusty = vehicle.fly(plan, None, disturbance=gust)
    weak = vehicle.fly(plan, None, disturbance=Disturbance(sag=0.05))
    assert blown.position[-1, 1] > calm.position[-1, 1] + 0.1
    np.testing.assert_array_equal(gusty.position[:1001], calm.position[:1001])
    assert gusty.position[-1, 1] > calm.position[-1, 1] + 1e-3
    assert weak.position[-1, 2] < calm.position[-1, 2] - 1e-2
    assert weak.command[-1].mean() > calm.command[-1].mean()
    if vehicle.commands.unit == "V":
        np.testing.assert_allclose(weak.voltage, 0.95 * weak.command)


def test_a_flight_ends_at_the_ground_and_at_the_wall(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 2.0)
    down = replace(plan, position=plan.position - [0.0, 0.0, 0.5] * np.minimum(2.0 * plan.t, 3.0)[:, None])
    crashed = vehicle.fly(down, None)
    assert crashed.ended is not None
    assert "ground" in crashed.ended.reason
    assert len(crashed) < len(plan)
    assert crashed.ended.position[2] == pytest.approx(vehicle.parameters.contact_height, abs=0.01)
    assert crashed.ended.time == pytest.approx(len(crashed) / vehicle.rate)
    log = flight_log(crashed, down, spec_of(vehicle).rate)
    assert "ground" in log.repairs[0]
    away = replace(plan, position=plan.position + [2.0, 0.0, 0.0] * plan.t[:, None])
    room = replace(spec_of(vehicle), lower=(-1.0, -1.0, 0.0), upper=(1.0, 1.0, 3.0))
    left = vehicle.fly(away, None, room=room)
    assert left.ended is not None
    assert "room" in left.ended.reason
    assert left.ended.position[0] == pytest.approx(1.0, abs=0.02)
    assert (np.abs(left.position[:, :2]) <= 1.0).all()
    inside = replace(room, lower=(-9.0, -9.0, 0.0), upper=(9.0, 9.0, 3.0), radius=0.9)
    aside = replace(plan, position=plan.position + [0.0, 2.0, 0.0] * plan.t[:, None])
    rounded = vehicle.fly(aside, None, room=inside).ended
    assert rounded is not None
    assert "room" in rounded.reason
    assert np.hypot(*rounded.position[:2]) == pytest.approx(0.9, abs=0.02)


def test_bad_plans_are_refused(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 0.2)
    hole = plan.position.copy()
    hole[7, 1] = np.nan
    for bad, message in (
        (replace(plan, position=hole), "nan"),
        (replace(plan, velocity=plan.velocity[:-1]), "shape"),
        (replace(plan, voltage_ff=np.zeros((len(plan), 3))), "shape"),
        (replace(plan, acceleration_ff=np.full((len(plan), 3), np.inf)), "inf"),
        (replace(plan, t=2.0 * plan.t), "grid"),
        (replace(plan, position=plan.position - [0.0, 0.0, 1.2]), "ground"),
        (FlightPlan(plan.t[:0], plan.position[:0], plan.velocity[:0]), "shape"),
    ):
        with pytest.raises(UsageError, match=message):
            vehicle.fly(bad, None)
    with pytest.raises(UsageError, match="start"):
        vehicle.fly(plan, None, start="flying")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="noise"):
        replace(vehicle, noise="loud").fly(plan, None)


def test_saturation_throughout_is_no_log(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 0.3)
    pushed = replace(plan, voltage_ff=np.full((len(plan), 4), 100.0))
    flight = vehicle.fly(pushed, None)
    assert flight.command.max() == vehicle.commands.upper[3]
    assert flight.voltage.max() <= vehicle.vehicle.voltage_limit
    with pytest.raises(DataError, match="limit"):
        flight_log(flight, pushed, spec_of(vehicle).rate)


def test_a_moving_start_moves_as_planned(vehicle: SimulatedVehicle) -> None:
    plan = _circle(vehicle, 1.0)
    hover, moving = vehicle.fly(plan, None), vehicle.fly(plan, None, start="moving")
    np.testing.assert_array_equal(hover.velocity[0], 0.0)
    np.testing.assert_array_equal(moving.velocity[0], plan.velocity[0])
    up = moving.R_world_body[0, :, 2]
    wish = np.array([-0.5 * (2.0 * np.pi / 5.0) ** 2, 0.0, 9.81])
    np.testing.assert_allclose(up, wish / np.linalg.norm(wish), atol=1e-3)
    errors = [np.linalg.norm(f.position - plan.position, axis=1).mean() for f in (hover, moving)]
    assert errors[1] < 0.5 * errors[0]


def test_an_unknown_vehicle_is_refused() -> None:
    with pytest.raises(UsageError, match="quadrotor_rough"):
        simulated_vehicle("zeppelin")
