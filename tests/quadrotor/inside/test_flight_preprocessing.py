"""From recorded flights to samples: states that are derived, the lag of the motors, rate and trimming."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from inverse_flights import SPEC, flown, log_with

from etude.errors import DataError, UsageError
from etude.types import Array, Log, Samples
from etude_quadrotor import common_lag, with_states
from etude_quadrotor.channels import ATTITUDE, ORIENTATION, POSITION, POSITION_DES, VELOCITY, command
from etude_quadrotor.log_checks import findings
from etude_quadrotor.preprocessing import FlightData, flight_samples
from etude_quadrotor.vehicle import GRAVITY

MIX = np.random.default_rng(3).normal(size=(9, 4))
WEIGHT = np.array([0.0, 0.0, GRAVITY])


def samples(logs: list[Log], data: FlightData | None = None, spec=SPEC) -> Samples:
    groups = [np.full(len(log), number, dtype=np.int64) for number, log in enumerate(logs)]
    return flight_samples(spec, data or FlightData(), logs, groups)


def turning(t: Array) -> tuple[Array, Array, Array, Array]:
    """Roll, position, velocity and acceleration in closed form, 600 samples at 100 Hz."""
    position = np.stack([np.sin(t), np.cos(t), 1.5 + 0.2 * np.sin(t)], axis=1)
    velocity = np.stack([np.cos(t), -np.sin(t), 0.2 * np.cos(t)], axis=1)
    acceleration = np.stack([-np.sin(t), -np.cos(t), -0.2 * np.sin(t)], axis=1)
    return 0.3 * np.sin(2.0 * t), position, velocity, acceleration


def recorded(t: Array, *, quaternion: bool = False) -> Log:
    """What a recorder writes of that motion: accelerometer, gyroscope, position, attitude, commands."""
    roll, position, _, acceleration = turning(t)
    force = np.einsum("tji,tj->ti", rolled(roll), acceleration + WEIGHT)
    rates = np.stack([0.6 * np.cos(2.0 * t), 0.0 * t, 0.0 * t], axis=1)
    log = log_with(t, specific_force=force, rates=rates).put(POSITION, position)
    zero = 0.0 * roll
    if quaternion:
        log = log.put(ORIENTATION, np.stack([np.cos(roll / 2), np.sin(roll / 2), zero, zero], axis=1))
    else:
        log = log.put(ATTITUDE, np.stack([roll, zero, zero], axis=1))
    return log.put(command(SPEC), 5.9 + 0.1 * np.sin(t[:, None] + np.arange(4)))


def rolled(roll: Array) -> Array:
    R = np.tile(np.eye(3), (len(roll), 1, 1))
    R[:, 1, 1] = R[:, 2, 2] = np.cos(roll)
    R[:, 1, 2], R[:, 2, 1] = -np.sin(roll), np.sin(roll)
    return R


@pytest.mark.parametrize("quaternion", [False, True])
def test_recorded_channels_become_states(quaternion: bool) -> None:
    t = np.arange(600) / 100.0
    roll, position, velocity, acceleration = turning(t)
    R, inside = rolled(roll), slice(50, -50)  # ends of the zero-phase derivative
    log = with_states(recorded(t, quaternion=quaternion))
    np.testing.assert_array_equal(log["altitude"][:, 0], position[:, 2])
    body_velocity = np.einsum("tji,tj->ti", R, velocity)
    np.testing.assert_allclose(log["body_velocity"][inside], body_velocity[inside], atol=5e-3)
    seen = np.einsum("tji,tj->ti", R, acceleration)
    np.testing.assert_allclose(log["body_acceleration"], seen, atol=1e-12)
    alpha = -1.2 * np.sin(2.0 * t)
    np.testing.assert_allclose(log["angular_acceleration"][inside, 0], alpha[inside], atol=5e-3)
    measured = with_states(recorded(t).put(VELOCITY, velocity))
    np.testing.assert_allclose(measured["body_velocity"], body_velocity, atol=1e-12)


def test_what_is_told_is_believed_and_what_nothing_tells_stays_out() -> None:
    log = flown()
    assert with_states(log) is log
    bare = recorded(np.arange(600) / 100.0).without("position", "attitude")
    assert set(with_states(bare).values) - set(bare.values) == {"angular_acceleration"}


def test_a_vehicle_that_was_never_armed_is_refused() -> None:
    log = recorded(np.arange(600) / 100.0)
    idle = log.put(log.channels["command"], np.full_like(log["command"], SPEC.command_lower))
    (found,) = (f for f in findings(SPEC, idle) if f.light == "red")
    assert "not armed" in found.sentence
    assert not any(f.check == "motors" for f in findings(SPEC, log))


def test_a_vehicle_on_the_ground_or_of_another_scale_is_told() -> None:
    log = recorded(np.arange(600) / 100.0)
    assert [f.light for f in findings(SPEC, log)] == ["green"] * 5
    ground = log.t < 2.0  # ten windows
    standing = {"rates": np.zeros(3), "specific_force": WEIGHT, "command": np.zeros(4)}
    landed = log
    for name, still in standing.items():
        landed = landed.put(log.channels[name], np.where(ground[:, None], still, log[name]))
    found = findings(SPEC, landed)[0]
    assert found.light == "yellow"
    np.testing.assert_allclose(found.spans, [(0.0, 2.0)])
    kept = found.cut(landed)
    assert kept.t[0] == pytest.approx(2.5)
    assert kept.repairs[-1].endswith("2.5 s at the ends were cut.")
    strong = log.put(log.channels["command"], log["command"] / 100.0)
    scale = findings(SPEC, strong)[-1]
    assert scale.light == "yellow"
    assert not scale.flag  # a note: `tell` takes the flight, so there is nothing to answer
    assert findings(replace(SPEC, vehicle=None), log)[-1].light == "cannot tell"


def test_rows_that_are_missing_are_filled_on_the_grid() -> None:
    t = np.arange(600) / 100.0
    rare = np.random.default_rng(2).choice(np.arange(1, 599), 30, replace=False)
    found, clean = samples([recorded(np.delete(t, rare))]), samples([recorded(t)])
    np.testing.assert_allclose(found.t, clean.t, atol=1e-9)
    np.testing.assert_allclose(found.command, clean.command, atol=1e-4)


def lagging(lag: float, rate: float = 200.0, seconds: float = 20.0, seed: int = 0) -> Log:
    """Commands that lead the motion they cause by `lag` s: a linear vehicle with a pure delay."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    frequency, phase = rng.uniform(0.5, 6.0, size=(9, 4)), rng.uniform(0, 6, size=(9, 4))

    def motion(times: Array) -> Array:
        pairs = zip(frequency, phase, strict=True)
        return np.stack([np.sin(times[:, None] * f + p).sum(axis=1) for f, p in pairs], 1)

    X = motion(t) + 1e-3 * rng.normal(size=(len(t), 9))
    log = log_with(t, specific_force=X[:, :3] + 100.0, rates=X[:, 3:6], angular_acceleration=X[:, 6:])
    return log.put(command(SPEC), 5.5 + 0.1 * motion(t + lag) @ MIX)


def test_the_lag_is_measured_only_in_logs_faster_than_the_model() -> None:
    slow, fast = lagging(0.1, rate=19.0, seconds=60.0), lagging(0.1)
    assert common_lag([slow], SPEC, FlightData()) == 0.0
    assert common_lag([slow, fast], SPEC, FlightData()) == pytest.approx(0.1, abs=1e-3)
    assert common_lag([fast], SPEC, FlightData(lag_s=0.03)) == 0.03
    # a robot file that states the rate of the log, as its page says, has the lag measured all the same
    assert common_lag([fast], replace(SPEC, rate=200.0), FlightData()) == pytest.approx(0.1, abs=1e-3)
    found = samples([fast])
    assert "lags 0.1 s behind" in found.log.repairs[-1]
    still = samples([fast], FlightData(lag_s=0.0))

    def left(one: Samples) -> float:
        """What the motion does not explain of the commands, V."""
        X = np.hstack([one.log[n] for n in ("specific_force", "rates", "angular_acceleration")])
        X = np.hstack([X, np.ones((len(X), 1))])
        return float(np.abs(one.command - X @ np.linalg.lstsq(X, one.command, rcond=None)[0]).max())

    assert left(found) < 0.1 * left(still)


def test_means_are_of_each_interval_and_points_of_its_start() -> None:
    log = recorded(np.arange(600) / 100.0).put(POSITION_DES, np.zeros((600, 3)))
    mean, point = samples([log]), samples([log], FlightData(averaged=False))
    assert len(mean) == len(point) == 60
    np.testing.assert_allclose(mean.command[1], log["command"][10:20].mean(axis=0))
    np.testing.assert_allclose(mean.log["position"][0], log["position"][:10].mean(axis=0))
    np.testing.assert_array_equal(point.log["rates"], log["rates"][::10])
    np.testing.assert_allclose(mean.t, np.arange(60) / 10.0)
    assert "attitude" not in mean.log
    assert "position_des" in mean.log
    assert mean.usable.all()
    assert mean.moving.all()


def test_flights_are_joined_trimmed_and_timed() -> None:
    logs = [flown(seed) for seed in (0, 1)]
    late = replace(logs[1], t=logs[1].t + 100.0)
    groups = [np.full(300, 5, dtype=np.int64), np.full(300, 3, dtype=np.int64)]
    data = FlightData(first_s=2.0, last_s=1.0)
    found = flight_samples(SPEC, data, [late, logs[0]], groups)
    assert np.unique(found.group).tolist() == [3, 5]
    assert found.t.min() == pytest.approx(2.0)
    assert found.t.max() == pytest.approx(28.9)
    np.testing.assert_array_equal(found.command[found.group == 3], logs[0]["command"][20:290])
    other = flight_samples(SPEC, data, [logs[0], late], groups[::-1])
    np.testing.assert_array_equal(other.command, found.command)


def test_segments_of_a_flight_keep_their_numbers() -> None:
    log = recorded(np.arange(600) / 100.0)
    groups = [np.repeat(np.array([1, 2], dtype=np.int64), 300)]
    for averaged in (True, False):
        found = flight_samples(SPEC, FlightData(averaged=averaged), [log], groups)
        np.testing.assert_array_equal(found.group, np.repeat([1, 2], 30))


def test_what_one_flight_lacks_all_lack() -> None:
    found = samples([flown(0), flown(1).without("altitude")])
    assert "altitude" not in found.log
    assert "body_velocity" in found.log


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda log: log.put(log.channels["command"], nan_at(log["command"])), "command contains NaN"),
        (lambda log: replace(log, t=np.where(np.arange(300) == 7, np.inf, log.t)), "t contains"),
        (lambda log: log.put(log.channels["rates"], nan_at(log["rates"])), "rates contains NaN"),
        (lambda log: log.put(log.channels["command"], np.full((300, 4), 5.9)), "no command ever changes"),
        (lambda log: log.put(log.channels["command"], saturated(log["command"])), "always saturated"),
    ],
)
def test_flights_that_teach_nothing_are_refused(change, words: str) -> None:
    with pytest.raises(DataError, match=words) as refused:
        samples([change(flown())])
    assert "flight.csv" in str(refused.value)


def nan_at(values: Array) -> Array:
    return np.where(np.arange(len(values))[:, None] == 7, np.nan, values)


def saturated(values: Array) -> Array:
    return np.column_stack([np.where(np.arange(len(values)) % 2, 0.0, 11.1), values[:, 1:]])


def test_no_flight_other_units_and_too_much_trimming_are_refused() -> None:
    log = flown()
    with pytest.raises(DataError, match="no flight"):
        samples([])
    units = replace(log.channels["command"], units=("1",) * 4)
    with pytest.raises(DataError, match="different units"):
        samples([log, log.put(units, log["command"])])
    with pytest.raises(DataError, match="no rows of the log remain"):
        samples([log], FlightData(first_s=40.0))
    for wrong in ({"lag_s": -1.0}, {"first_s": "auto"}, {"last_s": np.nan}, {"acceleration": "world"}):
        with pytest.raises(UsageError):
            FlightData(**wrong)


def test_one_constant_output_is_no_reason_to_refuse() -> None:
    log = flown()
    spoken = log["command"].copy()
    spoken[:, 3] = 0.5
    assert len(samples([log.put(log.channels["command"], spoken)])) == 300
