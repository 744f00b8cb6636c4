"""What a cycle of the clock loop costs, and how many come late: 7 joints at 1 kHz, in this process.

    python tests/drivers/measure_cycles.py --seconds 60

Late cycles mean something on an idle core only; the CPU time of a cycle does on any.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from etude.drivers import Bounds, Sample, Streamed, Supervisor, planned
from etude.testing import FakeRobot
from etude.trajectories import PointToPoint
from etude.types import Array

JOINTS = tuple(f"joint{number}" for number in range(7))


class Ticking(FakeRobot):
    """Its `state` waits for the next millisecond, as real robots do; joints are where they are asked."""

    def state(self) -> Sample:
        now = time.monotonic()
        self.t = (int(now * self.rate) + 1) / self.rate
        time.sleep(self.t - now)
        return Sample(self.t, self.q, self.command, self.qd)

    def send(self, q: Array, qd: Array, qdd: Array, effort: Array | None) -> None:
        self.q, self.qd, self.command = q, qd, qdd


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (2 + int(seconds / 3.0), 7))
    places[0] = 0.0
    path = PointToPoint(places, 1.0, dwell=0.1, peak_acceleration=5.0)
    robot = Ticking(JOINTS, 1000.0, virtual=False)
    text = path.to_json().encode()
    motion = planned(text, number=1, part="motion", speed=100, names=JOINTS, joints=JOINTS, rate=1000.0)
    ones = np.ones(7)
    bounds = Bounds(ones, -9 * ones, 9 * ones, 9 * ones, effort=99 * ones, residual=99 * ones)
    supervisor = Supervisor(bounds, robot.about(), motion, np.zeros_like(motion.q))
    with Streamed(robot) as player:
        before = time.process_time()
        recording = player.play(motion, supervisor.watch, "feedback")
        spent = time.process_time() - before
    cycles = len(recording.t)
    print(f"{recording.ended.value} {supervisor.reason}: {cycles} cycles, {recording.late} late")
    print(f"{1e6 * spent / cycles:.0f} us of CPU in a cycle of 1000 us")


if __name__ == "__main__":
    main()
