"""A run that was stopped teaches up to the stop, whether the recording ended there or went on at rest."""

from __future__ import annotations

import numpy as np
import pytest
from log_examples import CHANNELS, MOTION, SCALE, Sines, at, make_log, with_values
from robot_limits import ROBOTS, Robot
from test_robot_starts import recorded

from etude.errors import DataError
from etude.logs import align
from etude.types import Log

LOG = make_log(start=-2.0)


def aligned(log: Log) -> Log:
    return align(log, MOTION, CHANNELS, "q", SCALE)


def stopped(log: Log, stop: float, last: float = np.inf) -> Log:
    """The robot holds still from `stop` on; the recording ends at `last`."""
    held = np.flatnonzero(log.t <= stop)[-1]
    q = log["q"].copy()
    q[held:] = q[held]
    return with_values(log, q=q).take(log.t <= last)


@pytest.mark.parametrize("stop", [5.5, 8.0, 13.0, 17.0])
@pytest.mark.parametrize("shift", [0.0, 1.7e9])
@pytest.mark.parametrize("rest", [0.0, 2.0, 99.0])
def test_it_teaches_up_to_the_stop(stop: float, shift: float, rest: float) -> None:
    log = stopped(LOG, stop, stop + rest)
    found = aligned(at(log, log.t + shift))
    assert found.t[0] == pytest.approx(-2.0, abs=0.01)
    assert found.t[-1] == pytest.approx(stop, abs=0.15)
    (sentence,) = [s for s in found.repairs if "only this part is used" in s]
    end, missing = (float(word) for word in (sentence.split()[4], sentence.split()[11]))
    assert end == pytest.approx(found.t[-1], abs=0.06)
    assert missing == pytest.approx(20.0 - found.t[-1], abs=0.06)
    np.testing.assert_allclose(found["q_des"], MOTION.motion(found.t).orders[0], atol=1e-12)


def test_a_whole_run_is_not_stopped() -> None:
    for log in (LOG, stopped(LOG, 99.0), LOG.take(LOG.t <= 19.8)):
        assert not any("ends at" in sentence for sentence in aligned(log).repairs)
        assert len(aligned(log)) == len(log)


@pytest.mark.parametrize("path", [True, False])
def test_a_recording_that_was_cut_says_what_is_missing(path: bool) -> None:
    """In mid-motion, whether or not the log tells the motion itself."""
    log = LOG.take((LOG.t >= 0.0) & (LOG.t <= 13.0))
    log = log if path else Log(log.t, {"command": log.channels["command"]}, {"command": log["command"]})
    (sentence,) = [s for s in aligned(log).repairs if "ends at" in s]
    assert sentence == (
        "The log ends at 13.0 s of the proposal's 20 s, 7.0 s before its end: only this part is used."
    )


@pytest.mark.parametrize("other", [Sines((0.35, 0.15, 0.25)), Sines((0.2, 0.45, 0.1), (0.3, 0.8, 0.9))])
def test_a_part_of_another_motion_is_refused(other: Sines) -> None:
    for stop in (6.0, 9.0, 14.0):
        with pytest.raises(DataError):
            align(stopped(LOG, stop), other, CHANNELS, "q", SCALE)
        with pytest.raises(DataError):
            align(LOG.take(stop >= LOG.t), other, CHANNELS, "q", SCALE)


def test_a_part_without_the_start_and_too_short_a_one_are_refused() -> None:
    with pytest.raises(DataError, match=r"holds .* of the proposal's 20 s|not the log"):
        aligned(LOG.take((LOG.t > 4.0) & (LOG.t < 12.0)))
    with pytest.raises(DataError):
        aligned(stopped(LOG, 4.0))


def held(robot: Robot, log: Log, stop: float) -> Log:
    q = log[robot.path].copy()
    q[log.t > stop] = q[np.flatnonzero(log.t <= stop)[-1]]
    return log.put(robot.channels[0], q)


@pytest.mark.parametrize("name", ["arm4", "so101"])
def test_of_robots(name: str) -> None:
    robot = ROBOTS[name]
    trajectory, other = robot.motion(3), robot.motion(1003)
    for part in (0.2, 0.8):
        stop = max(6.0, part * trajectory.duration)
        log = held(robot, recorded(robot, trajectory, -1.5, 0.0, 1.5), stop + 1.5)
        found = align(log, trajectory, robot.channels, robot.path, robot.scale)
        assert found.t[0] == pytest.approx(-1.5, abs=1.0 / robot.rate + 1e-6), part
        assert found.t[-1] == pytest.approx(stop, abs=0.5), part
        wrong = held(robot, recorded(robot, other, -1.5, 0.0, 1.5), stop + 1.5)
        with pytest.raises(DataError):
            align(wrong, trajectory, robot.channels, robot.path, robot.scale)
