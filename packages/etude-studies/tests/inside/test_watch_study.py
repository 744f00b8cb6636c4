"""The study of watching: what its rows count, its broken sensors, and the samples of CrazyPAD."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from etude.errors import UsageError
from etude.types import Channel, Log, Motion
from etude_studies.bench_watch import run as bench
from etude_studies.broken_sensors import ENCODER, FAULTS, FROZEN_S, GAIN, OFFSET, broken
from etude_studies.crazypad import LEAD_IN, MOTORS, STATES, samples_of
from etude_studies.watch_recovery import BACK, PASS_S, WINDOW_S, _back
from etude_studies.watch_rows import WAYS, rows_of


def run(alarm_s: float | None, named: str = "unknown", **more: Any) -> dict[str, Any]:
    return {"alarm_s": alarm_s, "named": named, "largest": 3.0, **more}


def test_rows_count_right_unknown_wrong_and_not_noticed() -> None:
    cell = {
        "unchanged_0": run(None),
        "unchanged_1": run(9.0),
        "payload": run(4.0, "load"),
        "friction": run(25.0, "offset"),
        "sensor": run(3.0, "stuck", fault="stuck"),
    }
    other = {**cell, "payload": run(None), "sensor": run(5.0, fault="gain")}
    several = [{"robot": "arm", "growing": "little by little", "sudden": "little by little"}]
    way = {"seconds": 20.0, "ratio": 1.1}
    never = {"seconds": None, "ratio": 9.0}
    ways = dict.fromkeys(WAYS, way) | {"frozen": never}
    facts = {"robot": "arm", "change": "payload", "before_deg": 0.1, **ways}
    recovery = [{**facts, "at_once": ratio} for ratio in (8.0, 4.0)]
    rows = {row.metric: row for row in rows_of({"arm": [cell, other]}, several, recovery)}
    value = {name: row.value for name, row in rows.items()}
    assert (value["false_alarms_arm"], rows["false_alarms_arm"].reference[:4]) == (2, "of 4")
    assert (value["changes_right_all"], value["changes_wrong_all"]) == (2, 2)
    assert (value["changes_unknown_all"], value["changes_not_noticed_all"]) == (1, 1)
    assert (value["payload_soon_arm"], value["friction_soon_arm"]) == (1, 0)
    assert (value["sensor_stuck_right"], value["sensor_gain_right"], value["sensor_offset_right"]) == (
        1,
        0,
        0,
    )
    assert (value["growing_told"], value["sudden_told"]) == (1, 0)
    assert value["back_online_arm_payload"] == 20.0
    assert np.isinf(value["back_frozen_arm_payload"])
    assert rows["back_frozen_arm_payload"].reference == "median; 0 of 2 came back"
    assert (value["error_at_once_arm_payload"], value["error_before_arm_payload"]) == (6.0, 0.1)
    assert rows["error_at_once_arm_payload"].reference == "median; 4 .. 8"


class Follows:
    """A robot that does what it is told, whose command is its position in N m."""

    def run(self, motion: Any, _: None, rng: np.random.Generator) -> Log:
        t = np.arange(0.0, 40.0, 0.1)
        q = motion.motion(t, 1).orders[0]
        parts, units = ("a", "b"), ("rad", "rad")
        channels = {
            "q": Channel("q", parts, units),
            "q_des": Channel("q_des", parts, units, "plan"),
            "command": Channel("command", parts, ("N m", "N m"), "command"),
        }
        return Log(t, channels, {"q": q, "q_des": q, "command": q.copy()})


class Sine:
    duration = 40.0

    def motion(self, t: Any, orders: int = 3) -> Motion:
        return Motion(t, (np.sin(t)[:, None] * np.ones(2))[None])


def test_broken_sensors_do_what_they_say() -> None:
    limit, rng = np.array([10.0, 20.0]), np.random.default_rng(0)
    true = np.sin(np.arange(0.0, 40.0, 0.1))
    logs = {fault: broken(Follows(), Sine(), rng, fault, 1, limit) for fault in FAULTS}  # type: ignore[arg-type]
    for log in logs.values():
        np.testing.assert_allclose(log["q"], log["q_des"])
        np.testing.assert_allclose(log["command"][:, 0], true, atol=1e-12)
    np.testing.assert_allclose(logs["offset"]["command"][:, 1], true + OFFSET * 20.0)
    np.testing.assert_allclose(logs["gain"]["command"][:, 1], GAIN * true)
    # the measured position follows the plan, so the true one, whose command it is, is behind
    np.testing.assert_allclose(logs["encoder"]["q"][:, 1], true, atol=1e-12)
    np.testing.assert_allclose(logs["encoder"]["command"][:, 1], true - ENCODER, atol=1e-12)
    late = logs["stuck"].t >= FROZEN_S
    assert np.ptp(logs["stuck"]["command"][late, 1]) == 0.0
    np.testing.assert_allclose(logs["stuck"]["command"][~late, 1], true[~late])


def test_the_error_is_back_where_no_later_window_is_larger() -> None:
    t = np.arange(0.0, 3.0 * PASS_S, 0.5)
    error = np.where(t < PASS_S, 1.0, 3.0)
    error[t >= PASS_S + 3 * WINDOW_S] = 0.99 * BACK
    channels = {n: Channel(n, ("a",), ("rad",)) for n in ("q_des", "q_true")}
    log = Log(t, channels, {"q_des": error[:, None], "q_true": np.zeros((len(t), 1))})
    before = np.ones(6)
    assert _back(log, before) == {"seconds": 3 * WINDOW_S, "ratio": pytest.approx(0.99 * BACK)}
    error[t < 2.0 * PASS_S + 1.5 * WINDOW_S] = 3.0
    error[t < PASS_S] = 1.0
    assert _back(log, before)["seconds"] is None  # not for a whole pass
    error[t >= PASS_S] = 1.0
    error[-1] = 99.0
    assert _back(log, before)["seconds"] is None


def test_flights_are_cut_to_the_air_and_averaged() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    air = (t > 3.0) & (t < 18.0)
    values = {name: np.full(len(t), float(i)) for i, name in enumerate(STATES)}
    values |= {name: np.where(air, 40000.0, 0.3 * LEAD_IN * 40000.0) for name in MOTORS}
    found = samples_of(t, values, 7)
    assert found.t[0] >= 3.5
    assert found.t[-1] <= 17.5
    assert np.diff(found.t) == pytest.approx(0.1)
    np.testing.assert_allclose(found.command, 40000.0 / 65535.0)
    np.testing.assert_allclose(found.log["state"][0], np.arange(len(STATES)))
    assert set(found.group.tolist()) == {7}


def test_crazypad_is_asked_for_where_it_is_not(tmp_path: Any) -> None:
    with pytest.raises(UsageError, match="not part of the project"):
        bench()
    with pytest.raises(UsageError, match="there is no crazypad_motor"):
        bench(logs=tmp_path)
