"""A joint's position that jumps is named first: its velocities and commands look wrong because of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from made_motion import CHANNELS, LIMITS, QD, RATE, TOP, Q, moved

from etude.logs import judge_motion
from etude.types import Array, Finding, Log

REACH = {**LIMITS, "q": (np.full(3, -3.0), np.full(3, 3.0))}


def told(log: Log) -> list[Finding]:
    return [f for f in judge_motion(log, "q", CHANNELS, REACH, RATE) if f.flag or f.light == "red"]


def with_positions(change: Callable[[Array], None], velocities: bool = True) -> Log:
    log = moved(velocities=velocities)
    q = log["q"].copy()
    change(q)
    return log.put(Q, q)


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("size", [0.5, -0.5, 40.0])
@pytest.mark.parametrize("j", [0, 2])
def test_a_jump_is_the_one_thing_that_is_said(velocities: bool, size: float, j: int) -> None:
    def jumping(q: Array) -> None:
        q[777:, j] += size

    (found,) = told(with_positions(jumping, velocities))
    assert (found.check, found.light) == ("jump", "red")
    part = Q.parts[j]
    assert found.sentence.startswith(f"{part}: the position jumps by ")
    assert "at t = 7.760 s" in found.sentence
    ((start, end),) = found.spans
    assert start < 7.765 < end


def test_single_wild_rows_are_none_and_are_dropped_elsewhere() -> None:
    def wild(q: Array) -> None:
        q[300, 1] += 3.0
        q[900, 1] -= 3.0

    assert told(with_positions(wild)) == []


@pytest.mark.parametrize("factor", [10.0, 60.0, 1000.0])
def test_a_clock_that_is_off_is_not_taken_for_jumps(factor: float) -> None:
    log = moved()
    fast = Log(log.t / factor, log.channels, log.values, log.source)
    assert "jump" not in [f.check for f in told(fast)]


def test_rows_that_hold_their_values_do_not_jump() -> None:
    log = moved(velocities=False)
    held = np.repeat(log["q"][::4], 4, axis=0)[: len(log)]
    assert "jump" not in [f.check for f in told(log.put(Q, held))]


def test_a_coarse_sensor_in_degrees_does_not_jump() -> None:
    """Each of its steps is further than the joint can move, in radians, and stands alone."""
    log = moved(velocities=False)
    slow = 0.5 * np.sin(0.2 * np.pi * log.t)[:, None] * [1.0, 0.0, 0.0]
    coarse = np.rad2deg(np.round(slow / 0.3) * 0.3)
    assert "jump" not in [f.check for f in told(log.put(Q, coarse))]


def test_without_limits_nothing_is_said_of_it() -> None:
    log = with_positions(lambda q: q.__setitem__((slice(777, None), 0), q[777:, 0] + 0.5))
    found = judge_motion(log.put(QD, log["qd"]), "q", CHANNELS, {"qd": (-TOP, TOP)}, RATE)
    assert "jump" not in [f.check for f in found]
