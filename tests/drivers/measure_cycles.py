"""What a cycle of the clock loop costs, and how many come late: 7 joints at 1 kHz, in this process.

    python tests/drivers/measure_cycles.py --seconds 60

A cycle is late by our own doing where its work alone takes more than a period of CPU. Otherwise the computer
woke the thread too late or interrupted it; a thread that only sleeps tells how often this one does.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import time

import numpy as np

from etude.drivers import Bounds, Sample, Streamed, Supervisor, planned
from etude.testing import FakeRobot
from etude.trajectories import PointToPoint
from etude.types import Array

JOINTS = tuple(f"joint{number}" for number in range(7))


class Ticking(FakeRobot):
    """Its `state` waits for the next millisecond, as real robots do; joints are where they are asked.

    Attributes:
        work: s of CPU in each cycle.
    """

    def __init__(self) -> None:
        super().__init__(JOINTS, 1000.0, virtual=False)
        self.work: list[float] = []
        self.woken = 0.0

    def state(self) -> Sample:
        self.work.append(time.thread_time() - self.woken)
        self.t = slept(self.rate)
        self.woken = time.thread_time()
        return Sample(self.t, self.q, self.command, self.qd)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.q, self.qd, self.command = q, qd, qdd


def slept(rate: float) -> float:
    """Sleeps until the next tick of the clock, s."""
    now = time.monotonic()
    tick = (int(now * rate) + 1) / rate
    time.sleep(tick - now)
    return tick


def late_without_work(cycles: int, rate: float, work: float) -> int:
    """How often a thread that does nothing wakes so late that this work (s) would not be done in time."""
    return sum(-slept(rate) + time.monotonic() > 1.0 / rate - work for _ in range(cycles))


def first() -> None:
    """As the loop does: before other threads of the computer, where that is permitted."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (2 + int(seconds / 3.0), 7))
    places[0] = 0.0
    path = PointToPoint(places, 1.0, dwell=0.1, peak_acceleration=5.0)
    robot = Ticking()
    text = path.to_json().encode()
    motion = planned(text, number=1, part="motion", speed=100, names=JOINTS, joints=JOINTS, rate=1000.0)
    ones = np.ones(7)
    bounds = Bounds(ones, -9 * ones, 9 * ones, 9 * ones, effort=99 * ones, residual=99 * ones)
    supervisor = Supervisor(bounds, robot.about(), motion, np.zeros_like(motion.q))
    with Streamed(robot) as player:
        recording = player.play(motion, supervisor.watch, "feedback")
    work = np.array(robot.work[2:])  # the first two are of what comes before
    own, usual = int((work > 1e-3).sum()), float(np.median(work))
    print(f"{recording.ended.value} {supervisor.reason}: {len(work)} cycles of {1e6 * usual:.0f} us of CPU")
    print(f"{recording.late} cycles lost; {own} of them by our own work, at most {1e6 * work.max():.0f} us")
    first()
    others = late_without_work(len(work), 1000.0, usual)
    print(f"{others} of as many wake-ups of a thread that only sleeps are too late for that work")


if __name__ == "__main__":
    main()
