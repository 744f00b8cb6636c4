"""How long after a change the tracking error is back: with the frozen model, one that learns on line, and one
learned from the new logs alone.

A simulated arm repeats a motion that the model has not seen; before the second pass it takes up a load, or
its friction grows. Errors are those of ten seconds over those of the same ten seconds before it. They are
back from the first window on after which none is over a quarter larger. The batch model is learned from the
first 20 s (what `etude watch` proposes is as long), 60 s or 120 s after it, and runs the motion again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude.contracts import Array, Log
from etude.models.online.learner import OnlineConfig
from etude_studies.changed_robot import FRICTION, LOAD, Plant
from etude_studies.online import CHANGE_S, PASS_S, PASSES, feedback, run_rule, start_model
from etude_studies.world import World, one_period

ROBOTS, CHANGES = ("arm4",), ("payload", "friction")
SEEDS = 1
"""The first so many of the study's."""
STREAM = 10
WINDOW_S = 10.0
BACK = 1.25
TOP_UPS = (20.0, 60.0, 120.0)


def recovery_cells(seed: int, seeds: int, folder: Path, kept: Callable[..., Any]) -> list[dict[str, Any]]:
    """Every cell, from its file if it was run."""
    return [
        kept(folder / f"recovery_{robot}_{change}_{s:04d}.json", partial(measured, robot, change, s))
        for robot in ROBOTS
        for change in CHANGES
        for s in range(seed, seed + min(seeds, SEEDS))
    ]


def measured(robot: str, change: str, seed: int) -> dict[str, Any]:
    """Seconds until the error is back, None within the run, and the ratio in the last pass."""
    world = World.of(robot)
    rng = np.random.default_rng([seed, STREAM])
    model, own_logs = start_model(world, rng)
    known = feedback(world, own_logs)
    motion = world.motion(rng, harmonics=2, **one_period(PASS_S))
    what = {"payload": LOAD * Plant.of(robot).rated(), "friction": FRICTION}
    changed = world.robot.changed(**{change: what[change]})
    found: dict[str, Any] = {"robot": robot, "change": change}
    runs: dict[str, OnlineConfig | None] = {"frozen": None, "online": OnlineConfig()}
    change_at = {CHANGE_S: changed}
    logs = {
        name: run_rule(world, model, motion, own, seed, change_at, known).log for name, own in runs.items()
    }
    found |= {name: _back(log) for name, log in logs.items()}
    before, after = (_windows(logs["frozen"], k * PASS_S) for k in (0, 1))
    for seconds in TOP_UPS:
        log = logs["frozen"]
        new = log.take((log.t >= CHANGE_S) & (log.t < CHANGE_S + seconds))
        own = world.learned(world.samples(_from_zero(new)), world.config.model, rng).model
        controller = world.kind.controller(world.spec, world.config, own)
        ratio = _windows(changed.run(motion, controller, rng), 0.0) / before
        good = bool(np.all(ratio <= BACK))
        found[f"batch_{seconds:g}"] = {"seconds": seconds if good else None, "ratio": float(ratio.mean())}
    found["at_once"] = float((after / before).mean())
    return found


def _from_zero(log: Log) -> Log:
    return replace(log, t=log.t - log.t[0])


def _back(log: Log) -> dict[str, Any]:
    before = _windows(log, 0.0)
    ratios = np.concatenate([_windows(log, k * PASS_S) / before for k in range(1, PASSES)])
    late = np.flatnonzero(ratios > BACK)
    first = 0 if not len(late) else int(late[-1]) + 1
    seconds = None if first >= len(ratios) else WINDOW_S * first
    return {"seconds": seconds, "ratio": float(ratios[-len(before) :].mean())}


def _windows(log: Log, start: float) -> Array:
    """(W,) mean absolute tracking error, over the joints, in each window of a pass that starts then, s."""
    error = np.abs(log["q_des"] - log["q_true"]).mean(axis=1)
    edges = start + np.arange(0.0, PASS_S, WINDOW_S)
    return np.array([error[(log.t >= a) & (log.t < a + WINDOW_S)].mean() for a in edges])
