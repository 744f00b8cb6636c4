"""A simulated vehicle as the studies of flights see it: how noisy it is, where it flies, what is learned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from etude.limits import FeasibleSet, boundary, timid, uniform
from etude.models import LearnedModel, ModelSelection, fit_student
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array, Log
from etude_quadrotor import SimulatedFlights
from etude_studies.world import World

SAMPLERS = {"uniform": uniform, "scaled": timid, "boundary": boundary}
"""The random flights by name; "scaled" are of random size in a random direction."""
THESIS_ROOM = {"lower": (-10.0, -10.0, 0.3), "margin": 0.5, "vertical_margin": None}
"""Of the studies of flights that teach; the vehicle's own file keeps more room for tracking."""
THESIS_S = 30.0
"""Duration of the studies' flights, the thesis's. Those of a campaign take half of it by default: as many
harmonics in half of the time fly twice as fast, and feedback alone errs twice as much."""


@dataclass(frozen=True, eq=False)
class Flights:
    """A simulated vehicle, its campaign and its noise.

    Attributes:
        world: the vehicle and its preset. noise: level of its noise.
    """

    world: World
    noise: str

    @classmethod
    def of(
        cls,
        robot: str,
        noise: str,
        preset: str = "default",
        room: Mapping[str, Any] | None = None,
        **flight: Any,
    ) -> Flights:
        """A built-in vehicle. room: what of its description is other; flight: keys of [trajectory]."""
        world = World.of(robot, preset)
        config = replace(world.config, trajectory=replace(world.config.trajectory, **flight))
        return cls(replace(world, spec=replace(world.spec, **(room or {})), config=config), noise)

    @cached_property
    def robot(self) -> SimulatedFlights:
        """What flies."""
        simulated = self.world.robot
        assert isinstance(simulated, SimulatedFlights)
        return replace(simulated, vehicle=replace(simulated.vehicle, noise=self.noise))

    @cached_property
    def family(self) -> Family:
        return self.world.kind.family(self.world.spec, self.world.config)

    @cached_property
    def limits(self) -> Sequence[Limit]:
        """Before anything is known of tracking."""
        return self.world.kind.limits(self.world.spec, self.world.config, None, {})

    @property
    def home(self) -> Array:
        """(3,) m."""
        return self.world.kind.home(self.world.spec)

    @cached_property
    def feasible(self) -> FeasibleSet:
        return FeasibleSet.of(self.limits, self.family, self.home)

    def drawn(self, rng: np.random.Generator, count: int, sampler: str = "uniform") -> list[Trajectory]:
        """Random flights inside the limits."""
        return [self.family.trajectory(p) for p in SAMPLERS[sampler](rng, self.feasible, count)]

    def flown(self, flights: Iterable[Trajectory], rng: np.random.Generator) -> list[Log]:
        """The logs of flights under PID alone, in a room without walls."""
        return [self.robot.test(flight, None, rng) for flight in flights]


def models_by_rung(selection: ModelSelection) -> dict[str, LearnedModel]:
    """A model of each structure for all commands, with the tails of its own held-out errors."""
    models = {}
    for rung in selection.model.structures:
        model, held = selection.model.of_structure(rung), selection.held_out[rung]
        ratio = held.error / np.sqrt(held.variance)
        student = None if model.student is None else fit_student(ratio[np.isfinite(ratio)])
        models[rung] = replace(model, student=student)
    return models
