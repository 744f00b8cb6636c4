"""Recovery of the tracking error after a change: of the frozen model, of models that learn online, and of
one learned from new logs alone, as `etude tell --changed new` does.

The model is that of a campaign after two logs. A simulated arm repeats a motion that it has not seen; before
the second pass it takes up a load, or its friction grows. Errors are those of ten seconds over those of the
same ten seconds before it. They are back from the first window on after which none, of a whole pass at least,
is over a quarter larger.
The batch models learn one or two other motions that the changed arm makes under its feedback alone, of 20 s
or of a minute (what `etude watch` proposes is as long), and run the motion again. All of a cell see the same
motion and noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude.types import Array, Log
from etude_online import OnlineConfig
from etude_studies.changed_robot import FRICTION, LOAD, Plant
from etude_studies.online import CHANGE_S, HALF_LIFE_S, PASS_S, PASSES, TRAINING, feedback, run_rule
from etude_studies.world import World, one_period

ROBOTS, CHANGES = ("arm4", "arm4_rough"), ("payload", "friction")
SEEDS = 4
"""The first so many of the study's."""
STREAM = 10
WINDOW_S = 10.0
BACK = 1.25
TOP_UPS = {"batch_20": (20.0,), "batch_60": (60.0,), "batch_120": (60.0, 60.0)}
"""s of each new log."""
ONLINE = {"frozen": None, "online": OnlineConfig(), "forgetting": OnlineConfig(half_life=HALF_LIFE_S)}


def recovery_cells(seed: int, seeds: int, folder: Path, cached: Callable[..., Any]) -> list[dict[str, Any]]:
    """Every cell, from its file if it was run."""
    return [
        cached(folder / f"recovery_{robot}_{change}_{s:04d}.json", partial(measured, robot, change, s))
        for robot in ROBOTS
        for change in CHANGES
        for s in range(seed, seed + min(seeds, SEEDS))
    ]


def measured(robot: str, change: str, seed: int) -> dict[str, Any]:
    """Errors before and at once after, deg and times; of each way seconds until it is back (None: not within
    the run) and the ratio in the last pass.
    """
    world = World.of(robot)
    rng = np.random.default_rng([seed, STREAM])
    logs = [world.robot.run(world.motion(rng), None, rng) for _ in range(TRAINING)]
    model = world.learned(world.samples(*logs), world.config.model, rng).model
    feedback_law, motion = feedback(world, logs), world.motion(rng, harmonics=2, **one_period(PASS_S))
    what = {"payload": LOAD * Plant.of(robot).rated(), "friction": FRICTION}
    changed = world.robot.changed(**{change: what[change]})
    runs = {
        name: run_rule(world, model, motion, config, seed, {CHANGE_S: changed}, feedback_law).log
        for name, config in ONLINE.items()
    }
    before = _windows(runs["frozen"], 0.0)
    after = _windows(runs["frozen"], CHANGE_S) / before
    result: dict[str, Any] = {"robot": robot, "change": change, "at_once": float(after.mean())}
    result["before_deg"] = math.degrees(before.mean())
    result |= {name: _back(log, before) for name, log in runs.items()}
    for name, lengths in TOP_UPS.items():
        new = [changed.run(world.motion(rng, duration=s), None, rng) for s in lengths]
        retrained = world.learned(world.samples(*new), world.config.model, rng).model
        controller = world.kind.controller(world.spec, world.config, retrained)
        again = changed.run(motion, controller, np.random.default_rng([seed, 2]))
        ratio = _windows(again, 0.0) / before
        good = bool(np.all(ratio <= BACK))
        result[name] = {"seconds": sum(lengths) if good else None, "ratio": float(ratio.mean())}
    return result


def _back(log: Log, before: Array) -> dict[str, Any]:
    ratios = np.concatenate([_windows(log, k * PASS_S) / before for k in range(1, PASSES)])
    late = np.flatnonzero(ratios > BACK)
    first = 0 if not len(late) else int(late[-1]) + 1
    seconds = None if first > len(ratios) - len(before) else WINDOW_S * first
    return {"seconds": seconds, "ratio": float(ratios[-len(before) :].mean())}


def _windows(log: Log, start: float) -> Array:
    """(W,) mean absolute tracking error, over the joints, in each window of a pass that starts then, s."""
    error = np.abs(log["q_des"] - log["q_true"]).mean(axis=1)
    edges = start + np.arange(0.0, PASS_S, WINDOW_S)
    return np.array([error[(log.t >= a) & (log.t < a + WINDOW_S)].mean() for a in edges])
