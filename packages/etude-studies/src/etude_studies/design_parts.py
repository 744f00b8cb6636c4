"""The parts of the study of design: what one cell of each measures, error by what was run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from etude.errors import DataError
from etude.protocols import Trajectory
from etude.trajectories import PointToPoint
from etude.types import Array, Log
from etude_studies.design_arms import Arm, arm_of
from etude_studies.design_flights import flights, room
from etude_studies.world import one_period

Cell = dict[str, float]
Run = tuple[Trajectory, Log]
CANDIDATES = 20
LENGTHS = (10.0, 20.0, 30.0, 60.0)
LONGEST = 120.0
"""s of motion of the part on segment lengths."""
MOTION, RUN, FIT, TEST, TASK = range(5)
"""Streams of random numbers."""


def stream(seed: int, what: int, *more: int) -> np.random.Generator:
    """Random numbers of one purpose: paired arms of a study get the same."""
    return np.random.default_rng([seed, what, *more])


def run_of(arm: Arm, motion: Trajectory, seed: int, number: int) -> Run:
    return motion, arm.recorded(motion, stream(seed, RUN, number))


def judged(arm: Arm, runs: list[Run], name: str, seed: int, tests: list[Trajectory]) -> Cell:
    """Error of each structure after those recordings, by name."""
    errors = {}
    for rung in arm.rungs:
        model = arm.learned(runs, rung, stream(seed, FIT))
        errors[f"{name} {rung}"] = arm.errors(model, tests, stream(seed, TEST, 1))
    return errors


def chain(name: str, seed: int) -> Cell:
    """60 s of motion of a fast arm: one short motion thrice, three random ones, three that were designed."""
    arm = arm_of(name)
    tests = arm.tests(stream(seed, TEST))
    spec, config = arm.world.spec, arm.world.config
    family: Any = arm.world.kind.family(spec, config)
    duration, segment = config.trajectory.duration, family.duration
    count = round(duration / segment)
    again: Any = arm.having(duration=duration, omega0=family.omega0)
    errors: Cell = {}
    motions = {
        "repeated": again.random(stream(seed, MOTION), 1)[0],
        "random": arm.chained(arm.random(stream(seed, MOTION), count)),
        "designed": arm.designed(None, stream(seed, MOTION, 1), count),
    }
    for what, motion in motions.items():
        errors |= judged(arm, [run_of(arm, motion, seed, 1)], what, seed, tests)
        errors[f"{what} seconds"] = motion.duration
    one = arm.chained(arm.random(stream(seed, MOTION), 1))
    return errors | judged(arm, [run_of(arm, one, seed, 1)], "one segment", seed, tests)


def first(name: str, seed: int) -> Cell:
    """A minute, random or designed from the limits."""
    arm = arm_of(name)
    tests = arm.tests(stream(seed, TEST))
    errors: Cell = {}
    for what, motion in _firsts(arm, seed).items():
        errors |= judged(arm, [run_of(arm, motion, seed, 1)], f"{what} 60 s", seed, tests)
    return errors


def later(name: str, seed: int) -> Cell:
    """Two and three minutes: random motions; or one from the limits, then those that its lessons call for."""
    arm = arm_of(name)
    tests = arm.tests(stream(seed, TEST))
    errors: Cell = {}
    for what, motion in _firsts(arm, seed).items():
        runs = [run_of(arm, motion, seed, 1)]
        for number in (2, 3):
            if what == "random":
                motion = arm.random(stream(seed, MOTION, number), 1)[0]
            else:
                model = arm.learned(runs, "gp", stream(seed, FIT))
                motion = arm.designed(model, stream(seed, MOTION, number + 1), 1)
            runs.append(run_of(arm, motion, seed, number))
            model = arm.learned(runs, "gp", stream(seed, FIT))
            errors[f"{what} {60 * number} s gp"] = arm.errors(model, tests, stream(seed, TEST, 1))
    return errors


def _firsts(arm: Arm, seed: int) -> dict[str, Trajectory]:
    """A random motion, and one designed before any log."""
    return {
        "random": arm.chained(arm.random(stream(seed, MOTION), 1)),
        "designed": arm.designed(None, stream(seed, MOTION, 1), 1),
    }


def oracle(name: str, seed: int) -> Cell:
    """Error of each of 20 random candidates as motion 1, 2 and 3; chosen and judged on different tests."""
    arm = arm_of(name)
    chosen_on, judged_on = arm.tests(stream(seed, TEST)), arm.tests(stream(seed, TEST, 9))
    figures: Cell = {}
    runs: list[Run] = []
    for number in (1, 2, 3):
        errors = []
        tried = []
        for place, motion in enumerate(arm.random(stream(seed, MOTION, number), CANDIDATES)):
            tried.append(run_of(arm, motion, seed, 100 * number + place))
            model = arm.learned([*runs, tried[-1]], "gp", stream(seed, FIT))
            errors.append(
                [
                    arm.errors(model, split_tests, stream(seed, TEST, 1))
                    for split_tests in (chosen_on, judged_on)
                ]
            )
        table: Array = np.array(errors)
        figures[f"best {number}"] = float(table[np.argmin(table[:, 0]), 1])
        figures[f"worst {number}"] = float(table[np.argmax(table[:, 0]), 1])
        figures[f"mean {number}"] = float(table[:, 1].mean())
        runs.append(tried[0])
    return figures


def lengths(name: str, seed: int) -> Cell:
    """Error after each 30 s (or segment, if longer) of random and designed segments of several lengths."""
    errors: Cell = {}
    tests = arm_of(name).tests(stream(seed, TEST))
    for segment in LENGTHS:
        arm = arm_of(name).having(**one_period(segment))
        for what in ("random", "designed"):
            runs: list[Run] = []
            seconds = 0.0
            step = max(1, round(30.0 / segment))
            while seconds < LONGEST - 1e-9:
                number = len(runs)
                if what == "random":
                    motion = arm.chained(arm.random(stream(seed, MOTION, number), step))
                else:
                    model = arm.learned(runs, "gp", stream(seed, FIT)) if runs else None
                    motion = arm.designed(model, stream(seed, MOTION, 50 + number), step)
                runs.append(run_of(arm, motion, seed, number))
                seconds += step * segment
                model = arm.learned(runs, "gp", stream(seed, FIT))
                errors[f"{what} {segment:g} s after {seconds:g}"] = arm.errors(
                    model, tests, stream(seed, TEST, 1)
                )
    return errors


def tasks(name: str, seed: int) -> Cell:
    """A pick-and-place after 60 and 120 s: by random motions, designed without and with it, and by itself."""
    arm = arm_of(name)
    task = pick_and_place(arm, stream(seed, TASK))
    generic = arm.tests(stream(seed, TEST))
    errors: Cell = {}
    for what in ("random", "without", "with", "itself"):
        runs: list[Run] = []
        for number in (0, 1):
            model = (
                arm.learned(runs, "gp", stream(seed, FIT)) if runs and what in ("without", "with") else None
            )
            if what == "random":
                motion: Trajectory = arm.random(stream(seed, MOTION, number), 1)[0]
            elif what == "itself":
                motion = task
            else:
                fixed_tasks = [task] if what == "with" and model is not None else []
                motion = arm.designed(model, stream(seed, MOTION, 50 + number), 1, fixed_tasks)
            runs.append(run_of(arm, motion, seed, number))
            after = f"{what} {60 * (number + 1)} s"
            errors |= {f"{after} {on}": error for on, error in _on(arm, runs, seed, task, generic).items()}
    return errors


def _on(arm: Arm, runs: list[Run], seed: int, task: Trajectory, generic: list[Trajectory]) -> Cell:
    """Error on the task and on others; feedback alone if the log is refused, as a joint hardly moves."""
    tests = {"task": [task], "generic": generic}
    try:
        model = arm.learned(runs, "gp", stream(seed, FIT))
    except DataError:
        return {on: arm.tracked(None, motions, stream(seed, TEST, 1)) for on, motions in tests.items()}
    return {on: arm.errors(model, motions, stream(seed, TEST, 1)) for on, motions in tests.items()}


def pick_and_place(arm: Arm, rng: np.random.Generator) -> PointToPoint:
    """Between two random places, from above each, again and again for about a minute."""
    spec = arm.world.spec
    middle, half = 0.5 * (spec.upper + spec.lower), 0.5 * (spec.upper - spec.lower)
    pick, place = (middle + 0.7 * half * rng.uniform(-1.0, 1.0, spec.dof) for _ in range(2))
    above = [pose + 0.15 * half * rng.uniform(-1.0, 1.0, spec.dof) for pose in (pick, place)]
    cycle = [above[0], pick, above[0], above[1], place, above[1]]
    speeds = 0.6 * spec.velocity, 0.6 * spec.acceleration
    single = PointToPoint(np.array([*cycle, cycle[0]]), speeds[0], 0.4, speeds[1])
    times = max(1, round(60.0 / single.duration))
    return PointToPoint(np.array([*(cycle * times), cycle[0]]), speeds[0], 0.4, speeds[1])


PARTS: dict[str, tuple[Callable[[str, int], Cell], tuple[str, ...]]] = {
    "chain": (chain, ("seven",)),
    "first": (first, ("arm4_rough", "arm4")),
    "later": (later, ("arm4_rough",)),
    "tasks": (tasks, ("arm4_rough",)),
    "lengths": (lengths, ("arm4_rough",)),
    "oracle": (oracle, ("arm4_rough",)),
    "flights": (flights, ("quadrotor_rough",)),
    "room": (room, ("quadrotor_rough",)),
}
"""By name: what one cell measures, and of which arms."""
