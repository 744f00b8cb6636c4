"""What goes into a simulated flight: plans, disturbances, parameter files; bad ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude_quadrotor import KIND, Disturbance
from etude_quadrotor.plant.flight_plan import plan_on_grid
from etude_quadrotor.plant.parameters import DATA, load_flight_parameters
from etude_quadrotor.plant.robot import flight_log
from etude_quadrotor.plant.simulated_vehicle import PLANTS, simulated_vehicle

Array = NDArray[np.float64]


def _curve(t: Array) -> tuple[Array, Array]:
    return (
        np.column_stack([np.sin(t), np.cos(2.0 * t), t]),
        np.column_stack([np.cos(t), -2.0 * np.sin(2.0 * t), np.ones_like(t)]),
    )


def test_a_coarse_plan_is_refined_to_the_fourth_order() -> None:
    errors = []
    for step in (0.2, 0.1):
        t = np.arange(round(4.0 / step) + 1) * step
        plan = plan_on_grid(t, *_curve(t))
        assert len(plan) == 4001
        np.testing.assert_allclose(np.diff(plan.t), 1e-3, rtol=1e-9)
        position, velocity = _curve(plan.t)
        np.testing.assert_allclose(plan.position[:: round(1000 * step)], _curve(t)[0], atol=1e-13)
        errors.append([np.abs(plan.position - position).max(), np.abs(plan.velocity - velocity).max()])
    ratio = np.array(errors[0]) / errors[1]
    assert ratio[0] == pytest.approx(16.0, rel=0.1)
    assert ratio[1] == pytest.approx(8.0, rel=0.1)


def test_feedforward_is_refined_linearly_and_a_fine_plan_stays() -> None:
    t = np.array([0.0, 0.01, 0.03])
    ff = np.column_stack([t, 2.0 * t, -t])
    plan = plan_on_grid(t, *_curve(t), acceleration_ff=ff, voltage_ff=np.column_stack([ff, t]))
    assert plan.acceleration_ff is not None
    assert plan.voltage_ff is not None
    np.testing.assert_allclose(plan.acceleration_ff[:, 1], 2.0 * plan.t)
    np.testing.assert_allclose(plan.voltage_ff[:, 3], plan.t)
    same = plan_on_grid(plan.t, plan.position, plan.velocity)
    assert len(same) == len(plan)
    np.testing.assert_allclose(same.position, plan.position, atol=1e-14)
    assert same.acceleration_ff is None


@pytest.mark.parametrize(
    ("t", "position", "message"),
    [
        ([0.0], np.zeros((1, 3)), "increase"),
        ([0.0, 0.0], np.zeros((2, 3)), "increase"),
        ([0.0, np.nan], np.zeros((2, 3)), "increase"),
        ([0.0, 1.0], np.zeros((2, 2)), "shape"),
        ([0.0, 1.0], np.full((2, 3), np.nan), "nan"),
    ],
)
def test_impossible_plans_are_refused(t: list[float], position: Array, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        plan_on_grid(np.array(t), position, np.zeros_like(position))


def test_a_gust_is_one_pulse_and_the_supply_falls() -> None:
    t = np.linspace(0.0, 10.0, 1001)
    d = Disturbance(
        wind=(1.0, 0.0, 0.0), gust=(0.0, 4.0, 0.0), gust_start=2.0, gust_duration=3.0, sag=0.1, sag_rate=0.02
    )
    air = d.over(t)
    np.testing.assert_array_equal(air[:, 0], 1.0)
    np.testing.assert_allclose(air[(t <= 2.0) | (t >= 5.0), 1], 0.0, atol=1e-12)
    assert air[:, 1].max() == air[350, 1] == pytest.approx(4.0)
    assert air[:, 1].sum() * 0.01 == pytest.approx(0.5 * 4.0 * 3.0)
    np.testing.assert_allclose(air[:, 3], 0.9 - 0.02 * t)
    assert Disturbance(sag_rate=1.0).over(t)[-1, 3] == 0.1


@pytest.mark.parametrize(
    "bad",
    [{"sag": 1.0}, {"sag": -0.1}, {"gust_duration": 0.0}, {"wind": (np.nan, 0.0, 0.0)}, {"sag_rate": np.inf}],
)
def test_impossible_disturbances_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="disturbance"):
        Disturbance(**bad)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('base = "quadrotor"\n[body]\nmas = 1.0', "mas"),
        ('base = "quadrotor"\n[body]\nmass = -1.0', "mass"),
        ('base = "quadrotor"\n[rotor]\nradius = "wide"', "radius"),
        ('base = "quadrotor"\n[control]\ninputs = "thoughts"', "inputs"),
        ('base = "quadrotor"\n[mismatch]\nthrust = [1.0, 1.0, 1.0]', "thrust"),
        ('base = "nobody"', "nobody"),
        ("contact_height = 0.1", "body"),
        ("[[", "used"),
    ],
)
def test_impossible_vehicles_are_refused(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "quadrotor.toml").write_text((DATA / "quadrotor.toml").read_text())
    (tmp_path / "odd.toml").write_text(line)
    with pytest.raises(UsageError, match=message):
        load_flight_parameters("odd", tmp_path)


def test_a_variant_states_only_what_differs(tmp_path: Path) -> None:
    (tmp_path / "quadrotor.toml").write_text((DATA / "quadrotor.toml").read_text())
    (tmp_path / "odd.toml").write_text('base = "quadrotor"\n[air]\nquadratic = 0.1\n')
    base, odd = load_flight_parameters("quadrotor"), load_flight_parameters("odd", tmp_path)
    assert odd.air.quadratic == 0.1
    assert odd.air.drag == base.air.drag
    assert odd.body == base.body


@pytest.mark.parametrize("name", PLANTS)
def test_the_description_fits_the_vehicle(name: str) -> None:
    vehicle = simulated_vehicle(name)
    spec, v = KIND.spec(KIND.built_in()[name]), vehicle.vehicle
    hover = (
        v.hover_voltage
        if spec.command_unit == "V"
        else v.mass * 9.81 / vehicle.parameters.control.full_thrust
    )
    assert spec.command_lower[3] < hover < 0.7 * spec.command_upper[3]
    assert (np.array(spec.upper) - spec.lower > 2.0 * spec.margin).all()
    assert spec.upper[2] > vehicle.parameters.contact_height
    assert vehicle.rate % vehicle.parameters.control.position_rate == 0.0
    assert spec.plant == name


@pytest.mark.parametrize("rate", [0.0, -10.0, 7.0, 2000.0, float("nan")])
def test_a_log_rate_divides_the_simulations(rate: float) -> None:
    vehicle = simulated_vehicle("quadrotor")
    t = np.arange(200) / 1000.0
    still = np.tile([0.0, 0.0, 1.0], (200, 1))
    plan = plan_on_grid(t, still, np.zeros_like(still))
    with pytest.raises(UsageError, match="Hz"):
        flight_log(vehicle.fly(plan, None), plan, rate)


def test_a_log_needs_the_plan_that_was_flown_and_one_sample() -> None:
    vehicle = simulated_vehicle("quadrotor")
    t = np.arange(150) / 1000.0
    still = np.tile([0.0, 0.0, 1.0], (150, 1))
    plan = plan_on_grid(t, still, np.zeros_like(still))
    flight = vehicle.fly(plan, None)
    assert len(flight_log(flight, plan, 10.0)) == 1
    with pytest.raises(UsageError, match="plan"):
        flight_log(flight, plan_on_grid(t[:100], still[:100], np.zeros((100, 3))))
    with pytest.raises(DataError, match="shorter"):
        flight_log(flight, plan, 5.0)
