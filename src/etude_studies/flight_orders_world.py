"""The presets of the study of flights: what flies, how it is logged, and what learns from the logs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from etude.campaign.flight.learner import drag_of
from etude.control.flight_feedforward import PID_ALONE, flight_plan
from etude.models.flight.config import FlightModelConfig
from etude.models.flight.dataset import FlightDataset, flight_dataset
from etude.plants.flight.record import flight_log
from etude.plants.flight.registry import flight_plant
from etude.plants.flight.simulated import SimulatedVehicle
from etude_studies.flight_accuracy import SETTINGS, Setting
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.feasible_set import FeasibleSet
from etude.trajectories.flight.flatness import Drag
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]

NO_DRAG = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Preset:
    """One way to fly and to learn.

    Attributes:
        setting: noise, start, logs and models.
        drag_aware: whether plans lean against the drag that the flights so far show.
        points: samples that processes are conditioned on, at most.
        longer: arms that fly `Effort.longer` times.
        arms: the only ones of the preset; None: all.
    """

    setting: Setting
    drag_aware: bool
    points: int
    longer: tuple[str, ...] = ()
    arms: tuple[str, ...] | None = None


_THESIS = SETTINGS["thesis"]
_LITERAL = replace(_THESIS, config=replace(_THESIS.config, noise_floor=0.0))
PRESETS = {
    # reference row L: ten flights of the thesis's criterion and of uniform random ones
    "thesis": Preset(_THESIS, drag_aware=False, points=1200, longer=("uniform", "mean_variance")),
    "clean": Preset(SETTINGS["default"], drag_aware=True, points=600),
    # plain maximum likelihood on the first flight, as the thesis's text says
    "literal": Preset(
        _LITERAL,
        drag_aware=False,
        points=1200,
        longer=("uniform", "mean_variance"),
        arms=("uniform", "mean_variance", "ivr"),
    ),
}


@dataclass(frozen=True)
class World:
    """The quadrotor of a preset in its room.

    Attributes:
        plant: as simulated.
        preset: see `Preset`.
        points: cap on the preset's points.
    """

    plant: SimulatedVehicle
    preset: Preset
    points: int

    @classmethod
    def of(cls, preset: str, points: int) -> World:
        """The world of a preset of that name."""
        chosen = PRESETS[preset]
        plant = replace(flight_plant("quadrotor"), noise=chosen.setting.noise)
        return cls(plant, chosen, min(points, chosen.points))

    @cached_property
    def family(self) -> FlightFamily:
        return FlightFamily(start=self.preset.setting.start)

    @cached_property
    def feasible(self) -> FeasibleSet:
        return feasible_flights(self.plant.spec, self.family)

    def config(self, *, every_kind: bool) -> FlightModelConfig:
        """Of the models: the whole ladder, or a process on the commands alone."""
        return replace(self.preset.setting.config, kind="auto" if every_kind else "gp", points=self.points)

    def flight(self, parameters: Array) -> FourierTrajectory:
        """The flight that parameters (P,) choose."""
        return self.family.trajectory(parameters)

    def fly(self, parameters: Array, rng: np.random.Generator, number: int) -> FlightDataset:
        """The log of one flight under PID alone, as samples to learn from or to test on."""
        plan = flight_plan(self.flight(parameters), PID_ALONE, self.plant.vehicle, self.plant.rate)
        setting = self.preset.setting
        flown = self.plant.fly(plan, rng, start=setting.start)
        log = flight_log(flown, plan, self.plant.spec.rate, averaged=setting.averaged)
        return flight_dataset([log], self.plant.spec, numbers=[number])

    def planned_drag(self, data: FlightDataset) -> Drag:
        """(dx, dy, dz) 1/s that a plan made after these flights counts with."""
        if not self.preset.drag_aware:
            return NO_DRAG
        x, y, z = drag_of(data)
        return (x, y, z)

    @property
    def true_drag(self) -> Drag:
        """The same of a plan that knew everything; for comparisons, never for a design."""
        if not self.preset.drag_aware:
            return NO_DRAG
        x, y, z = self.plant.parameters.drag_per_mass
        return (float(x), float(y), float(z))
