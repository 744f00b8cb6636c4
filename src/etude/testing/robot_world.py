"""Fixture of the kind suites: a kind with one of its robots, opened as in a campaign."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from etude.campaign.record.config import preset_config
from etude.limits.feasible import FeasibleSet
from etude.limits.samplers import uniform
from etude.protocols import Family, Inputs, Kind, Limit, Trajectory
from etude.storage import write_atomic
from etude.types import Array, Log, Motion, Samples

_KNOWN: dict[tuple[int, str, str], World] = {}


@dataclass(frozen=True, eq=False)
class World:
    """One robot of a kind: its description, the preset's tables, and the nouns made of both."""

    kind: Kind
    spec: Any
    config: Any
    family: Family
    limits: tuple[Limit, ...]
    inputs: Inputs
    drawn: dict[tuple[int, ...], tuple[Any, ...]] = field(default_factory=dict, repr=False)
    """Parameters by seed and by the parts that they depend on, which laws ask for again and again."""

    def feasible(self, rng: np.random.Generator) -> tuple[Family, FeasibleSet]:
        """A drawn member of the family's frequencies, and the parameters that keep every limit."""
        family = self.family.drawn(rng)
        return family, FeasibleSet.of(self.limits, family, self.kind.home(self.spec))

    def parameters(self, seed: int) -> tuple[Family, Array]:
        """A drawn family and random parameters (P,) inside all limits."""
        parts = (self.kind, self.spec, self.family, self.limits)
        key = (seed, *map(id, parts))
        if key not in self.drawn:
            rng = np.random.default_rng(seed)
            family, feasible = self.feasible(rng)
            # the parts are kept too, so that no other object gets their id
            self.drawn[key] = (*parts, family, uniform(rng, feasible, 1)[0])
        family, p = self.drawn[key][-2:]
        return family, p.copy()

    def trajectory(self, seed: int) -> Trajectory:
        """A random trajectory inside all limits."""
        family, p = self.parameters(seed)
        return family.trajectory(p)

    def motion(self, seed: int, count: int = 40) -> Motion:
        """`count` instants of a random trajectory, at the rate that inputs with memory need.

        Those begin in the middle: at rest a memory has a kink, and no derivative for a law to look at.
        """
        trajectory = self.trajectory(seed)
        if self.inputs.rate > 0.0:
            t = 0.5 * trajectory.duration + np.arange(count) / self.inputs.rate
        else:
            t = trajectory.duration * (np.arange(count) + 0.5) / count
        return trajectory.motion(t, self.inputs.orders)


def world(kind: Kind, robot: str | Path, name: str = "default") -> World:
    """The robot (built-in name, or a file the kind recognises) with the tables of a preset; made once."""
    key = (id(kind), str(robot), name)
    if key not in _KNOWN:
        _KNOWN[key] = _open_world(kind, robot, name)
    return _KNOWN[key]


def _open_world(kind: Kind, robot: str | Path, name: str) -> World:
    path = kind.built_in().get(str(robot), Path(robot))
    folder = Path(tempfile.mkdtemp(prefix="etude-testing-"))
    atexit.register(
        shutil.rmtree, folder, ignore_errors=True
    )  # physics read the model file when they are asked
    for file, content in kind.described(path).files.items():
        write_atomic(folder / file, content)
    spec = kind.spec(folder / "robot.toml")
    config = preset_config(kind, name)
    return World(
        kind=kind,
        spec=spec,
        config=config,
        family=kind.family(spec, config),
        limits=tuple(kind.limits(spec, config, None, {})),
        inputs=kind.inputs(spec, config),
    )


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
