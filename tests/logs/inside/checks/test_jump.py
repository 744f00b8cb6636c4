"""A position that jumps: found wherever it is and however drawn out, and nothing else is taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from etude import plugins
from etude.campaign import Answers, LogQuestions, preset_config
from etude.logs.checks.plausibility import jump_finding
from etude.logs.cleaning.smoothing import segments
from etude.types import Array, Channel, Finding, Log

SECONDS, AT, TOP = 30.0, 17.3, np.full(3, 6.0)
POSITION = Channel("position", ("x", "y", "z"), ("m",) * 3, "aside")


def flown(rate: float, noise: float = 0.0, speed: float = 2.0) -> tuple[Array, Array]:
    """Times (T,) s and positions (T, 3) m of a smooth flight, up to that speed in m/s."""
    t = np.arange(0.0, SECONDS, 1.0 / rate) + 100.0
    rng = np.random.default_rng(0)
    turns = np.array([0.5, 0.7, 0.3])
    return t, speed / turns * np.sin(np.outer(t, turns)) + noise * rng.normal(size=(len(t), 3))


def told(t: Array, q: Array) -> Finding:
    return jump_finding(logged(t, q), "position", TOP)


def logged(t: Array, q: Array) -> Log:
    return Log(t, {"position": POSITION}, {"position": q}, "made")


@pytest.mark.parametrize("rate", [10.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize("size", [1.7, -1.7, 25.0])
@pytest.mark.parametrize("drawn_out", [0.0, 0.02])
def test_a_reset_is_told_with_place_and_size_and_left_out(rate: float, size: float, drawn_out: float) -> None:
    """Drawn out where a table joins a slower position to faster rows."""
    t, q = flown(rate, noise=0.002)
    part = (t >= 100.0 + AT) if not drawn_out else np.clip((t - 100.0 - AT) / drawn_out, 0.0, 1.0)
    q[:, 1] += size * part
    found = told(t, q)
    assert found.light == "yellow"
    assert f"by {size:.2g} m in y at" in found.sentence
    ((start, end),) = found.spans
    assert start < 100.0 + AT < end
    pieces = segments(found.cut(logged(t, q)).t)
    assert len(pieces) == 2  # a pause, which nothing is drawn through
    assert float(t[-1] - t[0]) - sum(float(np.ptp(t[p.start : p.stop])) for p in pieces) < 3.0


@pytest.mark.parametrize("rows", [40, 100, 150, 500])
@pytest.mark.parametrize("drawn_out", [1, 2, 3])
def test_of_a_short_log_one_jump_is_many_rows(rows: int, drawn_out: int) -> None:
    t, q = flown(25.0)
    t, q = t[:rows], q[:rows]
    q[:, 0] += np.clip((np.arange(rows) - rows // 2) / drawn_out, 0.0, 1.0)
    assert told(t, q).light == "yellow"
    t, q = flown(25.0)
    assert told(t[:rows], q[:rows]).light == "green"


def test_two_resets_are_two_and_a_spike_is_one() -> None:
    t, q = flown(100.0)
    q[(t > 105.0) & (t < 120.0)] += [0.0, 0.0, 1.7]
    assert len(told(t, q).spans) == 2
    t, q = flown(100.0)
    q[500] += 3.0
    ((start, end),) = told(t, q).spans
    assert start < t[500] < end < start + 0.3


def held(t: Array, q: Array, every: float) -> Array:
    """The newest position of a slower sensor, at each row."""
    slow = np.floor((t - t[0]) / every) * every + t[0]
    return np.column_stack([np.interp(slow, t, column) for column in q.T])


@pytest.mark.parametrize("rate", [10.0, 100.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_what_a_vehicle_and_its_sensors_do_is_no_jump(rate: float) -> None:
    t, q = flown(rate)
    crash = np.maximum(t - 110.0, 0.0)[:, None] * [0.0, 0.0, -5.5]  # another speed from one row to the next
    gone = (t < 105.0) | (t > 108.0)
    quick_t, quick = flown(rate, speed=14.0)
    for name, own_t, own in (
        ("plain", t, q),
        ("noise", t, flown(rate, noise=0.05)[1]),
        ("held at 5 Hz", t, held(t, flown(rate, speed=5.5)[1], 0.2)),
        ("held at 1 Hz, with noise", t, held(t, flown(rate, noise=0.3, speed=5.5)[1], 1.0)),
        ("crash", t, q + crash),
        ("faster than its limit", quick_t, quick),
        ("a pause", t[gone], q[gone]),
        ("a correction", t, q + 0.15 * (t > 110.0)[:, None]),
        ("at rest", t, 0.0 * q),
    ):
        found = told(own_t, own)
        assert (found.light, found.spans) == ("green", ()), (name, found.sentence)


@pytest.mark.slow
def test_simulated_flights_do_not_jump_and_one_that_does_is_cut_unless_accepted() -> None:
    kind = plugins.load("etude.robots", "quadrotor")
    for name in ("quadrotor", "pelican"):
        spec = kind.spec(kind.built_in()[name])
        config, rng = preset_config(kind, "default"), np.random.default_rng(1)
        robot = kind.robot(spec, config)
        for flight in kind.tests(spec, config, rng).values():
            log = robot.run(flight, None, rng)
            found = {f.check: f for f in kind.checks(spec, log)}
            assert found["jump"].light == "green"
    moved = log.put(log.channels["position"], log["position"] + 1.7 * (log.t > 10.0)[:, None])
    cleaned = LogQuestions(kind, spec, Answers()).cleaned(moved)
    assert len(cleaned) < len(moved)
    assert any(
        "jumps faster than the limits allow" in s and s.endswith("That was cut.") for s in cleaned.repairs
    )
    kept = LogQuestions(kind, spec, Answers(accept=("jump",))).cleaned(moved)
    assert len(kept) == len(moved)
    assert any("jumps faster than the limits allow" in s for s in kept.repairs)
