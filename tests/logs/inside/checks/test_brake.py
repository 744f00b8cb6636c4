"""Drives that are off are told from a robot that is held, and from one that moves without a command."""

from __future__ import annotations

import numpy as np
import pytest
from made_motion import COMMAND, Q, moved

from etude.logs.checks.plausibility import brake_finding
from etude.types import Log

LIMIT = np.full(3, 100.0)


def held(log: Log, command: float, noise: float = 1e-5, first: int = 1000, last: int = 1600) -> Log:
    """From row to row in one pose, with that command."""
    rng, q, u = np.random.default_rng(3), log["q"].copy(), log["command"].copy()
    q[first:last] = q[first] + noise * rng.standard_normal((last - first, 3))
    u[first:last] = command
    return log.put(Q, q).put(COMMAND, u)


def light(log: Log) -> str:
    return brake_finding(log, COMMAND, LIMIT).light


def test_a_brake_is_found_and_cut() -> None:
    log = held(moved(), 0.01)
    found = brake_finding(log, COMMAND, LIMIT)
    ((start, end),) = found.spans
    assert found.light == "yellow"
    assert log.t[1000] <= start < log.t[1000] + 0.5
    assert log.t[1600] - 0.5 < end <= log.t[1600] + 0.5
    left = found.cut(log)
    assert light(left) == "green"
    assert not ((left.t >= start) & (left.t < end)).any()
    assert len(left) == ((log.t < start) | (log.t >= end)).sum()
    assert left.repairs[-1].endswith("That was cut.")


@pytest.mark.parametrize(
    "log",
    [
        moved(),
        held(moved(), 5.0),  # held against gravity
        held(moved(), 0.0, noise=1e-2),  # moved by hand
        held(moved(), 0.0, last=1050),  # between two moves
    ],
    ids=["moving", "held", "by hand", "short"],
)
def test_what_is_no_brake(log: Log) -> None:
    assert light(log) == "green"


def test_a_log_that_is_all_brake_is_refused() -> None:
    log = moved()
    assert light(held(log, 0.0, first=0, last=len(log))) == "red"
