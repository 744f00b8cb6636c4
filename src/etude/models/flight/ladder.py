"""The ladder of inverse models of a vehicle: every kind, and the one that predicts unseen flights best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.models.flight.config import PHYSICS_KINDS, FlightKind, FlightModelConfig
from etude.models.flight.dataset import FlightDataset
from etude.models.flight.lesson import HeldOut, fitted_physics, lesson, physics_held_out
from etude.models.flight.model import FlightModel
from etude.models.flight.training import WITH_PROCESS, physics_alone, train_process
from etude.robots.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightLadder:
    """All trained models and the choice among them.

    Attributes:
        models: by kind.
        chosen: the kind in use.
        held_out: by kind, what it says of each flight without having seen it.
    """

    models: dict[FlightKind, FlightModel]
    chosen: FlightKind
    held_out: dict[FlightKind, HeldOut]

    @property
    def model(self) -> FlightModel:
        """The model in use."""
        return self.models[self.chosen]

    def error(self, kind: FlightKind) -> float:
        """Mean absolute error of a kind on flights held out, command units."""
        return float(self.held_out[kind].mae().mean())


def train_flight_ladder(
    data: FlightDataset,
    vehicle: Vehicle | None,
    config: FlightModelConfig,
    rng: np.random.Generator,
    previous: Mapping[FlightKind, FlightModel] | None = None,
) -> FlightLadder:
    """Trains every kind that `config` and the vehicle allow, and chooses by the error on flights held out.

    Raises:
        UsageError: a nominal kind without a vehicle. DataError: no flight, or a missing input.
    """
    own, previous = lesson(data, vehicle, config, rng), previous or {}
    kinds = _kinds(config, own.vehicle)
    bases = {base: fitted_physics(own, base) for base in dict.fromkeys(_base(kind) for kind in kinds)}
    models: dict[FlightKind, FlightModel] = {}
    held: dict[FlightKind, HeldOut] = {}
    for kind in [kind for kind in kinds if kind not in PHYSICS_KINDS]:
        physics, folds = bases[_base(kind)]
        models[kind], held[kind] = train_process(own, kind, config, physics, folds, previous.get(kind))
    for kind in [kind for kind in kinds if kind in PHYSICS_KINDS]:
        physics, folds = bases[kind]
        twin = models.get(WITH_PROCESS[kind]) or models.get("identified+gp")
        if twin is None:
            twin, _ = train_process(own, WITH_PROCESS[kind], config, physics, folds, previous.get(kind))
        held[kind] = physics_held_out(own, folds)
        models[kind] = physics_alone(twin, kind, physics, held[kind], config)
    return FlightLadder(models, choose(held, len(data.flights)), held)


def _base(kind: FlightKind) -> FlightKind:
    """Whose physics a kind has: a process on the commands themselves is held against the identified one."""
    return "nominal" if kind.startswith("nominal") else "identified"


def _kinds(config: FlightModelConfig, vehicle: Vehicle | None) -> tuple[FlightKind, ...]:
    if config.kind != "auto":
        return (config.kind,)
    rungs: tuple[FlightKind, ...] = ("gp", "identified+gp", "identified")
    return rungs if vehicle is None else (*rungs, "nominal")


def choose(held: Mapping[FlightKind, HeldOut], flights: int) -> FlightKind:
    """The kind with the least mean absolute error on flights held out.

    Processes compete from two flights on: stretches of one flight are no new flights, and flatter them.
    """
    kinds = list(held)
    physics = [kind for kind in kinds if kind in PHYSICS_KINDS]
    if flights < 2 and physics:
        kinds = physics
    return min(kinds, key=lambda kind: float(held[kind].mae().mean()))
