"""Inputs of a vehicle: columns, plan and log alike, the way back, and what flights teach them."""

from __future__ import annotations

import numpy as np
import pytest
from inverse_flights import SPEC, flights, random_log, samples_of

from etude.codes import Notice, Warn
from etude.errors import DataError, UnsafeTrajectoryError, UsageError
from etude.trajectories import FourierTrajectory
from etude.types import Motion
from etude_quadrotor import QuadrotorInputs
from etude_quadrotor.flatness import VECTORS
from etude_quadrotor.preprocessing import FlightData

ALL = [
    QuadrotorInputs(h, a, v, (0.6, 0.4, 0.0))
    for h in (True, False)
    for a in ("specific_force", "kinematic")
    for v in (True, False)
]


def motion(seed: int = 0, count: int = 9, orders: int = 5) -> Motion:
    table = 0.4 * np.random.default_rng(seed).standard_normal((7, 3))
    table[0, 2] = 2.0
    return FourierTrajectory(table, 0.5, 4.0 * np.pi).motion(np.linspace(0.0, 12.0, count), orders)


def test_the_columns_of_the_thesis() -> None:
    inputs = QuadrotorInputs(True, "kinematic", False)
    log = random_log(np.random.default_rng(0))
    X = inputs.of_log(log)
    assert X.shape == (len(log), 10)
    np.testing.assert_array_equal(X[:, :1], log["altitude"])
    np.testing.assert_array_equal(X[:, 1:4], log["body_acceleration"])
    np.testing.assert_array_equal(X[:, 4:7], log["rates"])
    np.testing.assert_array_equal(X[:, 7:], log["angular_acceleration"])
    assert inputs.columns[0] == ("altitude", "z", "m", "")
    assert inputs.columns[-1] == ("angular_acceleration", "z", "rad/s^2", "")
    assert [len(inputs.columns) for inputs in ALL] == [13, 10, 13, 10, 12, 9, 12, 9]


@pytest.mark.parametrize("inputs", ALL, ids=lambda i: "+".join(i.parts))
def test_a_plan_is_the_log_of_its_perfect_flight(inputs: QuadrotorInputs) -> None:
    planned, keep = motion(), np.array([1, 5])
    log = inputs.states(planned)
    X = inputs.of_log(log)
    np.testing.assert_array_equal(inputs.plan(planned).X, X)
    np.testing.assert_array_equal(inputs.plan(planned, keep).X, X[keep])
    np.testing.assert_array_equal(inputs.plan(planned).gains, 1.0)
    for i in range(len(log)):
        x, memory = inputs.step({name: values[i] for name, values in log.values.items()}, None)
        np.testing.assert_array_equal(x, X[i])
        assert not memory.size
    for j, (channel, part, unit, op) in enumerate(inputs.columns):
        own = log.channels[channel]
        place = own.parts.index(part)
        assert (unit, op) == (own.units[place], "")
        np.testing.assert_array_equal(X[:, j], log[channel][:, place])


@pytest.mark.parametrize("inputs", ALL[:3], ids=lambda i: "+".join(i.parts))
@pytest.mark.parametrize("keep", [None, np.array([2, 7])])
def test_pull_is_the_gradient_through_flatness(inputs: QuadrotorInputs, keep) -> None:
    planned, rng = motion(1, orders=6), np.random.default_rng(2)
    found = inputs.plan(planned, keep)
    weights = rng.standard_normal(found.X.shape)
    pulled = found.vjp(weights, np.zeros_like(found.gains))
    assert pulled.shape == planned.orders.shape

    def value(orders: np.ndarray) -> float:
        return float(np.sum(weights * inputs.plan(Motion(planned.t, orders), keep).X))

    for _ in range(5):
        step = rng.standard_normal(planned.orders.shape)
        slope = (value(planned.orders + 1e-5 * step) - value(planned.orders - 1e-5 * step)) / 2e-5
        assert float(np.sum(pulled * step)) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_what_an_autopilot_is_told_is_the_plan() -> None:
    planned = motion()
    log = QuadrotorInputs().states(planned)
    for order, name in enumerate(("position_des", "velocity_des", "acceleration_des")):
        np.testing.assert_array_equal(log[name], planned.orders[order])
    force = planned.orders[2] + [0.0, 0.0, 9.81]
    np.testing.assert_allclose(log["thrust_des"][:, 0], np.linalg.norm(force, axis=1), rtol=1e-12)
    np.testing.assert_allclose(log["attitude_des"][:, 2], 0.0, atol=1e-15)
    np.testing.assert_array_equal(log["rates_des"], log["rates"])
    assert {log.channels[name].role for name in VECTORS} == {"state"}


def test_a_singular_plan_is_refused_where_it_is_flown_and_not_where_it_is_sought() -> None:
    falling = Motion(np.zeros(1), np.zeros((5, 1, 3)))
    falling.orders[2, 0, 2] = -20.0
    with pytest.raises(UnsafeTrajectoryError, match="falls"):
        QuadrotorInputs().states(falling)
    assert QuadrotorInputs().plan(falling).X.shape == (1, 13)


def test_a_missing_quantity_names_the_option() -> None:
    log = random_log(np.random.default_rng(0))
    for name, option in {
        "altitude": "altitude = false",
        "body_velocity": "body_velocity = false",
        "body_acceleration": "specific_force",
    }.items():
        with pytest.raises(DataError, match=name.replace("_", " ")) as refused:
            QuadrotorInputs(acceleration="kinematic").of_log(log.without(name))
        assert option in refused.value.next_step
    with pytest.raises(UsageError):
        QuadrotorInputs().plan(motion()).vjp(np.zeros((9, 12)), np.zeros((9, 4)))
    with pytest.raises(UsageError):
        QuadrotorInputs(acceleration="world")  # type: ignore[arg-type]


def test_flights_teach_the_drag_and_tell_what_they_lack() -> None:
    samples = flights(2)
    log = samples.log
    force = log["specific_force"].copy()
    force[:, :2] = -log["body_velocity"][:, :2] * [0.5, 0.7]
    dragged = samples_of(log.put(log.channels["specific_force"], force), samples.group)
    fitted = FlightData().inputs().fitted(dragged)
    np.testing.assert_allclose(fitted.drag, [0.5, 0.7, 0.0], atol=1e-12)
    assert fitted.notes == ()
    bare = samples_of(dragged.log.without("altitude", "body_velocity"), samples.group)
    poorer = FlightData().inputs().fitted(bare)
    assert poorer.parts == ("specific_force", "rates", "angular_acceleration")
    assert poorer.drag == (0.0, 0.0, 0.0)
    assert poorer.notes == (Notice(Warn.INPUTS_MISSING, {"inputs": ("altitude", "body velocity")}),)
    for one in (fitted, poorer):
        again = FlightData().inputs().restore(one.arrays())
        assert again == one
    assert again.lateral is None
    assert SPEC.body is not None
