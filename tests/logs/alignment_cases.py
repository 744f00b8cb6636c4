"""Random recordings of a random motion of a robot: from when to when, at which rate, by which clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from robot_limits import ROBOTS, Robot

from etude.errors import DataError
from etude.logs import align
from etude.trajectories import FourierTrajectory
from etude.types import Array, Log

TEN = (
    "arm4",
    "baxter_left",
    "go1_leg",
    "panda",
    "quadrotor",
    "so101",
    "talos_left_arm",
    "tiago_pro_right",
    "ur10",
    "xarm7",
)
KINDS = ("exactly", "rest before", "rest after", "rest both", "cut before", "cut after", "cut both")
CLOCKS = ("its own", "from zero", "since 1970", "anything")
NOISE = 1e-3
"""Of each coordinate's range."""


@dataclass(frozen=True)
class Case:
    """One recording. since, until: s of the proposal at the first row, and after its end at the last."""

    robot: Robot
    motion: FourierTrajectory
    kind: str
    clock: str
    since: float
    until: float
    rate: float
    start: float
    seed: int

    @staticmethod
    def of(seed: int) -> Case:
        rng = np.random.default_rng([seed, 14])
        robot = ROBOTS[TEN[seed % len(TEN)]]
        motion = robot.motion(10_000 + seed)
        kind, clock = str(rng.choice(KINDS)), str(rng.choice(CLOCKS))
        rest, cut, delay = rng.uniform(0.1, 10.0, 2), rng.uniform(0.0, 5.0, 2), rng.uniform(0.0, 1.0)
        since = -rest[0] if kind in ("rest before", "rest both") else 0.0
        since = cut[0] if kind in ("cut before", "cut both") else since
        until = rest[1] if kind in ("rest after", "rest both") else 0.0
        until = -cut[1] if kind in ("cut after", "cut both") else until
        if rng.random() < 0.5 and since <= 0.0:  # the robot starts later than its recorder
            since -= delay
        rate = float(np.exp(rng.uniform(np.log(20.0), np.log(1000.0))))
        zero = {"its own": 0.0, "from zero": -since, "since 1970": 1.7e9 + rng.uniform(0.0, 1e6)}
        start = float(zero.get(clock, rng.uniform(-30.0, 30.0)))
        return Case(robot, motion, kind, clock, float(since), float(until), rate, start, seed)

    def log(self) -> Log:
        """The robot rests before and after the motion."""
        t = np.arange(self.since, self.motion.duration + self.until, 1.0 / self.rate)
        q = self.planned(t)
        noise = np.random.default_rng(self.seed).standard_normal(q.shape) * NOISE * self.robot.scale
        channel = self.robot.channels[0]
        return Log(t + self.start, {channel.name: channel}, {channel.name: q + noise}, "log")

    def error(self) -> float:
        """s by which the start was missed; whole periods of a motion that repeats itself all through the log
        are none.
        """
        log = self.log()
        found = align(log, self.motion, self.robot.channels, self.robot.path, self.robot.scale)
        error = float(log.t[0] - found.t[0]) - self.start
        periods = round(error * self.motion.omega0 / (2.0 * np.pi))
        whole = periods * 2.0 * np.pi / self.motion.omega0
        own, other = (self.planned(log.t - self.start - shift) for shift in (0.0, whole))
        return abs(error - whole) if np.abs(own - other).max() < 1e-9 else abs(error)

    def planned(self, t: Array) -> Array:
        """(T, k) the motion, in rest before and after."""
        return self.motion.motion(np.clip(t, 0.0, self.motion.duration), 1).orders[0]

    def refused(self) -> bool:
        """Whether the log of another random motion of the same robot, recorded likewise, is refused."""
        log = replace(self, motion=self.robot.motion(20_000 + self.seed)).log()
        try:
            align(log, self.motion, self.robot.channels, self.robot.path, self.robot.scale)
        except DataError:
            return True
        return False


def failures(first: int, count: int) -> tuple[list[int], list[int]]:
    """Seeds of the cases aligned worse than to a sample, and of those that take another motion for theirs."""
    cases = [Case.of(seed) for seed in range(first, first + count)]
    missed = [case.seed for case in cases if case.error() > 1.0 / case.rate + 1e-6]
    return missed, [case.seed for case in cases if not case.refused()]


if __name__ == "__main__":
    import sys

    start, number = map(int, sys.argv[1:])
    missed, taken = failures(start, number)
    sys.stdout.write(f"{number} cases from {start}: missed {missed}, another motion taken {taken}\n")
