"""Silent topics: a sensor that was cut off, and a command that is sent only when it changes."""

from __future__ import annotations

import numpy as np

from etude.logs.readers.registry import silences

TIMES = np.arange(0.0, 20.0, 0.01)


def test_nothing_is_known_where_a_sensor_was_cut_off() -> None:
    t = TIMES[::5]
    silent, said = silences("Topic imu", TIMES, t[(t < 8.0) | (t > 9.0)])
    np.testing.assert_array_equal(silent, (TIMES > 7.95) & (TIMES < 9.05))
    assert said[0].startswith("Topic imu is silent for 1.0")
    assert said[0].endswith("left out.")


def test_a_slow_topic_is_not_silent() -> None:
    for step in (1, 7, 100):
        silent, said = silences("Topic battery", TIMES, TIMES[::step])
        assert not silent.any()
        assert said == ()


def test_a_short_pause_is_bridged_and_the_ends_are_not_its_business() -> None:
    t = TIMES[(TIMES > 3.0) & (TIMES < 15.0) & ~((TIMES > 5.0) & (TIMES < 5.15))]
    assert not silences("Topic imu", TIMES, t)[0].any()


def test_what_is_silent_for_long_holds_and_is_said() -> None:
    silent, said = silences("Topic goal", TIMES, TIMES[(TIMES < 5.0) | (TIMES > 15.0)])
    assert not silent.any()
    assert said[0].endswith("interpolated.")
