"""Runs and samples of a simulated robot, for the suites of a kind."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from etude.testing.world import World
from etude.types import Log, Samples


@lru_cache(maxsize=32)
def log_of(here: World, seed: int) -> Log:
    """The log of a random trajectory under the robot's own feedback."""
    robot = here.kind.robot(here.spec, here.config)
    assert robot is not None, f"{here.spec.name} cannot be simulated, and this law needs a run"
    return robot.run(here.trajectory(seed), None, np.random.default_rng(seed))


def samples_of(here: World, *seeds: int) -> Samples:
    """What a model would learn from these runs, one group each."""
    logs = [log_of(here, seed) for seed in seeds]
    groups = [np.full(len(log), number, dtype=np.int64) for number, log in enumerate(logs)]
    return here.kind.samples(here.spec, here.config, logs, groups)
