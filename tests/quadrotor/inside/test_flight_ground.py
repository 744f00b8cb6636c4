"""Ground in a flight: by rest, and by a weight that idling motors cannot carry."""

from __future__ import annotations

import numpy as np
import pytest

from etude.types import Array, Channel, Log
from etude_quadrotor.log_checks import ground_finding, windows

RATE, SECONDS, G = 100.0, 40.0, 9.81
MOTORS = Channel("command", ("m1", "m2"), ("1", "1"), "command")
HOVERING, IDLING = 0.55, 0.05


def landed(*spans: tuple[float, float], noise: float = 1.0) -> tuple[Log, Array, Array]:
    """A flight that stands on the ground in these spans (s), its gyroscope and specific force (T, 3).

    noise: m/s^2 of the accelerometer, by vibration; on the ground it is shaken less, but more than at rest.
    """
    rng = np.random.default_rng(0)
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    ground = np.any([(t >= low) & (t < high) for low, high in spans], axis=0)
    throttle = np.where(ground, IDLING, HOVERING + 0.05 * np.sin(t))[:, None] * np.ones(2)
    gyro = np.where(ground[:, None], 0.02, 0.5) * rng.normal(size=(len(t), 3))
    force = np.where(ground[:, None], 0.5, 1.0) * noise * rng.normal(size=(len(t), 3)) + [0.0, 0.0, G]
    return Log(t, {}, {}, "made").put(MOTORS, throttle), gyro, force


def found(log: Log, gyro: Array, force: Array) -> tuple[tuple[float, float], ...]:
    return ground_finding(windows(log.t, gyro, force, log["command"])).spans


def test_motors_that_idle_on_the_ground_shake_and_are_noticed() -> None:
    spans = found(*landed((0.0, 3.0), (36.0, SECONDS)))
    np.testing.assert_allclose(spans, [(0.0, 3.0), (36.0, SECONDS)], atol=0.011)


def test_a_fall_is_no_ground() -> None:
    """Motors that idle in the air carry nothing, and nothing is felt."""
    log, gyro, force = landed((0.0, 3.0), (20.0, 23.0))
    falling = (log.t >= 20.0) & (log.t < 23.0)
    force[falling] -= [0.0, 0.0, 0.8 * G]
    np.testing.assert_allclose(found(log, gyro, force), [(0.0, 3.0)], atol=0.011)


@pytest.mark.parametrize("turning", [False, True])
def test_a_dive_in_which_drag_is_the_weight_for_a_moment_is_no_ground(turning: bool) -> None:
    log, gyro, force = landed((20.0, 23.0 if turning else 20.4))
    if turning:
        gyro[:, 0] += 0.5
    assert found(log, gyro, force) == ()


def test_ground_between_two_flights_is_cut_and_a_touch_is_not() -> None:
    log, gyro, force = landed((0.0, 2.0), (10.0, 10.6), (20.0, 25.0))
    finding = ground_finding(windows(log.t, gyro, force, log["command"]))
    kept = finding.cut(log)
    assert kept.t[0] == pytest.approx(2.5)
    assert not ((kept.t > 19.51) & (kept.t < 25.49)).any()
    assert ((kept.t > 9.0) & (kept.t < 12.0)).sum() == pytest.approx(3.0 * RATE, abs=2)
    assert "is on the ground for 7.6 s" in kept.repairs[-1]
    assert len(log) - len(kept) == pytest.approx(8.5 * RATE, abs=2)


def test_ground_throughout_stays() -> None:
    log, gyro, force = landed((0.0, SECONDS))
    log = log.put(MOTORS, np.where(log.t[:, None] > 39.0, 0.5, log["command"]))
    finding = ground_finding(windows(log.t, gyro, force, log["command"]))
    assert len(finding.cut(log)) == pytest.approx(0.5 * RATE, abs=2)
