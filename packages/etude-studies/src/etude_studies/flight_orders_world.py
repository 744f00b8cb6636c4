"""The presets of the study of flights: what flies, how it is logged, and what learns from the logs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from etude.models import ModelConfig
from etude.protocols import Inputs
from etude_quadrotor import Drag, QuadrotorInputs
from etude_studies.flight_world import THESIS_ROOM, THESIS_S, Flights

NO_DRAG = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Preset:
    """One way to fly and to learn.

    Attributes:
        noise: level of the vehicle's noise.
        campaign: the kind's preset, with its start, logs and models.
        drag_aware: whether plans lean against the drag that the flights so far show.
        points: samples that processes are conditioned on, at most.
        noise_floor: in place of the preset's.
        longer: arms that fly `Effort.longer` times.
        arms: the only ones of the preset; None: all.
    """

    noise: str
    campaign: str
    drag_aware: bool
    points: int
    noise_floor: float | None = None
    longer: tuple[str, ...] = ()
    arms: tuple[str, ...] | None = None


# reference row L: ten flights of the thesis's criterion and of uniform random ones
_THESIS = Preset("mid", "thesis", drag_aware=False, points=1200, longer=("uniform", "mean_variance"))
PRESETS = {
    "thesis": _THESIS,
    "clean": Preset("low", "default", drag_aware=True, points=600),
    # plain maximum likelihood on the first flight, as the thesis's text says
    "literal": replace(_THESIS, noise_floor=0.0, arms=("uniform", "mean_variance", "ivr")),
}


@dataclass(frozen=True, eq=False)
class World:
    """The quadrotor of a preset in its room.

    Attributes:
        flights: the vehicle.
        preset: see `Preset`.
        points: cap on the preset's points.
    """

    flights: Flights
    preset: Preset
    points: int

    @classmethod
    def of(cls, preset: str, points: int) -> World:
        """The world of a preset of that name."""
        chosen = PRESETS[preset]
        flights = Flights.of("quadrotor", chosen.noise, chosen.campaign, THESIS_ROOM, duration=THESIS_S)
        return cls(flights, chosen, min(points, chosen.points))

    def config(self, *, every_kind: bool) -> ModelConfig:
        """Of the models: the whole ladder, or a process on the commands alone."""
        config = self.flights.world.config.model
        if self.preset.noise_floor is not None:
            config = replace(config, noise_floor=self.preset.noise_floor)
        # its tables have what is selected
        return replace(config, rung="auto" if every_kind else "gp", points=self.points, replace="chance")

    def planning(self, inputs: Inputs) -> Inputs:
        """Of a plan made after the flights that the inputs are tuned to: with their drag, or none."""
        return inputs if self.preset.drag_aware else _with_drag(inputs, NO_DRAG)

    def judging(self, inputs: Inputs) -> Inputs:
        """The same of a plan that knew everything; for comparisons, never for a design."""
        return _with_drag(inputs, self._true_drag if self.preset.drag_aware else NO_DRAG)

    @cached_property
    def _true_drag(self) -> Drag:
        x, y, z = self.flights.robot.vehicle.parameters.drag_per_mass.tolist()
        return (x, y, z)


def _with_drag(inputs: Inputs, drag: Drag) -> Inputs:
    assert isinstance(inputs, QuadrotorInputs)
    return replace(inputs, drag=drag)
