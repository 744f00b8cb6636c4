"""The parts of a robot's kind that a study needs: motions, samples, and models of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude import plugins
from etude.campaign import CampaignConfig, find_robot, preset_config
from etude.errors import UsageError
from etude.limits import FeasibleSet, scaled
from etude.logs import read_log
from etude.models import LearnedModel, ModelConfig, ModelSelection, select_structures
from etude.protocols import Inputs, Kind, Robot, Trajectory
from etude.types import Array, Log, Samples


@dataclass(frozen=True, eq=False)
class World:
    """A robot and how a campaign would treat it.

    Attributes:
        kind: of the robot. spec: its description. config: a preset of the kind.
    """

    kind: Kind
    spec: Any
    config: CampaignConfig

    @classmethod
    def of(cls, robot: str | Path, preset: str = "default") -> World:
        """A built-in robot, or that of a file. UsageError if there is none."""
        kind, path = find_robot(str(robot))
        return cls(kind, kind.spec(path), preset_config(kind, preset))

    @classmethod
    def described(cls, kind: str, spec: Any, preset: str = "default") -> World:
        """A robot that is described here, of a kind by name."""
        robot_kind = plugins.load("etude.robots", kind)
        return cls(robot_kind, spec, preset_config(robot_kind, preset))

    @property
    def robot(self) -> Robot:
        """The simulated stand-in. UsageError if there is none."""
        simulated = self.kind.robot(self.spec, self.config)
        if simulated is None:
            raise UsageError(f"there is no simulated {self.spec.name}")
        return simulated

    def motion(self, rng: np.random.Generator, **trajectory: Any) -> Trajectory:
        """A random motion enlarged to the limits; keys of [trajectory] may be other than the preset's."""
        config = replace(self.config, trajectory=replace(self.config.trajectory, **trajectory))
        family = self.kind.family(self.spec, config).drawn(rng)
        limits = self.kind.limits(self.spec, config, None, {})
        return family.trajectory(scaled(rng, FeasibleSet.of(limits, family, self.kind.home(self.spec)))[0])

    def read(self, path: Path) -> Log:
        """A recorded log, cleaned. DataError if it cannot be used."""
        expected = self.kind.expected(self.spec)
        channels = self.kind.channels(self.spec)
        return read_log(path, channels, rate=expected.rate, limits=expected.limits)

    def samples(self, *logs: Log, data: Any = None) -> Samples:
        """Samples of the logs, each a group of its own; `data` in place of the preset's [data]."""
        config = self.config if data is None else replace(self.config, data=data)
        groups = [np.full(len(log), place, dtype=np.int64) for place, log in enumerate(logs)]
        return self.kind.samples(self.spec, config, logs, groups)

    @property
    def alone(self) -> ModelConfig:
        """The preset's [model] without candidates beside the default."""
        return replace(self.config.model, candidates=("default",))

    def inputs(self, model: ModelConfig) -> Inputs:
        """What a model of that configuration looks at."""
        return self.kind.inputs(self.spec, replace(self.config, model=model))

    def learned(
        self,
        samples: Samples,
        model: ModelConfig,
        rng: np.random.Generator,
        previous: LearnedModel | None = None,
        *,
        body: bool = True,
    ) -> ModelSelection:
        """The ladder of these samples, trained on from the `previous` model; with `body` False, as if nobody
        had described the robot's.
        """
        kind, spec, config = self.kind, self.spec, self.config
        physics = kind.physics(spec, config) if body else {}
        inputs, limit = self.inputs(model), kind.limit(spec)
        return select_structures(samples, inputs, physics, limit, model, rng, previous)

    @property
    def command_limits(self) -> tuple[Array, Array]:
        """Lower and upper (J,) of the commands."""
        return self.kind.expected(self.spec).limits["command"]


def one_period(duration: float) -> dict[str, float]:
    """Keys of [trajectory] for a motion that nothing in it repeats, s."""
    return {"duration": duration, "omega0": 2.0 * math.pi / duration}
