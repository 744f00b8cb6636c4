"""The battery's voltage is an input where all log it, it varies and it helps; plans assume the usual one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from inverse_flights import SPEC, flights, flown
from test_flight_inputs import motion

from etude.types import Array, Log, Samples
from etude_quadrotor import QuadrotorInputs
from etude_quadrotor.battery import slow_voltage, usual_voltage
from etude_quadrotor.channels import BATTERY, command
from etude_quadrotor.preprocessing import FlightData, flight_samples

USUAL = 3.8


def with_voltage(samples: Samples, voltage: Array) -> Samples:
    return replace(samples, log=samples.log.put(BATTERY, voltage[:, None]))


def drained(count: int = 4, effect: float = 1.0) -> Samples:
    """Flights from a full battery to an empty one; commands grow as it falls."""
    samples = flights(count)
    done = (samples.group * 30.0 + samples.t) / (30.0 * count)
    voltage = USUAL + 0.6 * (0.5 - done)
    spoken = samples.command * (USUAL / voltage[:, None]) ** effect
    return with_voltage(replace(samples, log=samples.log.put(command(SPEC), spoken)), voltage)


def test_a_voltage_that_helps_is_one_more_input() -> None:
    samples = drained()
    fitted = QuadrotorInputs().fitted(samples)
    assert fitted.volts == pytest.approx(USUAL, abs=2e-3)
    X = fitted.of_log(samples.log)
    np.testing.assert_array_equal(X[:, :-1], QuadrotorInputs().of_log(samples.log))
    np.testing.assert_array_equal(X[:, -1], samples.log["battery_voltage"][:, 0])
    assert fitted.columns[-1] == ("battery_voltage", "pack", "V", "")
    assert (
        fitted.restore(fitted.arrays()).volts
        == QuadrotorInputs().restore(fitted.arrays()).volts
        == fitted.volts
    )
    assert QuadrotorInputs(battery_voltage=False).fitted(samples).volts is None


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "samples",
    [
        drained(effect=0.0),
        drained(1),
        with_voltage(drained(), np.full(1200, USUAL)),
        replace(drained(), log=drained().log.without("battery_voltage")),
    ],
    ids=["tells nothing", "one flight", "constant", "not logged"],
)
def test_else_the_model_is_as_before(samples: Samples) -> None:
    """Inputs, what is stored of them and plans are those of flights without a voltage."""
    plain = replace(samples, log=samples.log.without("battery_voltage"))
    found, before = (QuadrotorInputs().fitted(each) for each in (samples, plain))
    assert usual_voltage(samples) is None
    assert found == before
    assert list(found.arrays()) == list(before.arrays())
    np.testing.assert_array_equal(found.of_log(samples.log), before.of_log(plain.log))
    assert list(found.states(motion()).values) == list(before.states(motion()).values)


def test_plans_and_logs_that_do_not_say_it_have_the_usual_voltage() -> None:
    inputs = replace(QuadrotorInputs(), volts=USUAL)
    planned, keep = motion(), np.array([1, 5])
    log = inputs.states(planned)
    assert log.channels["battery_voltage"].nominal == (USUAL,)
    X = inputs.of_log(log)
    np.testing.assert_array_equal(X[:, -1], USUAL)
    np.testing.assert_array_equal(inputs.plan(planned).X, X)
    np.testing.assert_array_equal(inputs.plan(planned, keep).X, X[keep])
    silent = log.without("battery_voltage")
    np.testing.assert_array_equal(inputs.of_log(silent), X)
    for told in (log, silent):
        row = {name: values[3] for name, values in told.values.items()}
        np.testing.assert_array_equal(inputs.step(row, None)[0], X[3])


def test_the_voltage_has_no_part_in_the_way_back() -> None:
    plain, inputs = QuadrotorInputs(), replace(QuadrotorInputs(), volts=USUAL)
    G = np.random.default_rng(2).standard_normal((9, 14))
    vjp = inputs.plan(motion()).vjp(G, np.zeros((9, 4)))
    np.testing.assert_array_equal(vjp, plain.plan(motion()).vjp(G[:, :-1], np.zeros((9, 4))))


def test_a_flight_that_does_not_say_it_leaves_none_with_it() -> None:
    first, second = flown(0), flown(1)
    voltage = np.linspace(4.1, 3.9, len(first))[:, None]
    groups = [np.full(len(log), number) for number, log in enumerate((first, second))]
    both = [log.put(BATTERY, voltage) for log in (first, second)]
    assert "battery_voltage" in flight_samples(SPEC, FlightData(), both, groups).log
    samples = flight_samples(SPEC, FlightData(), [both[0], second], groups)
    plain = flight_samples(SPEC, FlightData(), [first, second], groups)
    assert list(samples.log.values) == list(plain.log.values)
    for name, values in plain.log.values.items():
        np.testing.assert_array_equal(samples.log[name], values)


def test_dips_under_load_are_averaged_away_and_the_discharge_stays() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    slow = 4.1 - 0.01 * t
    log = Log(t, {}, {}).put(BATTERY, (slow - 0.3 * (np.sin(2.0 * np.pi * t) > 0.0))[:, None])
    found = slow_voltage(log)["battery_voltage"][:, 0]
    inside = (t > 5.0) & (t < 55.0)
    np.testing.assert_allclose(found[inside], slow[inside] - 0.15, atol=4e-3)
    assert np.abs(np.diff(found)).max() < 5e-3
