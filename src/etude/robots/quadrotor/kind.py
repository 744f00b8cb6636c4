"""Campaigns on flying vehicles: flights, their logs and their models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.campaign.kinds import TakenIn
from etude.campaign.learner import Learned, Say
from etude.errors import UsageError
from etude.logs.flight.log import FlightLog
from etude.robots.flight_spec import FlightSpec
from etude.robots.spec import RobotSpec
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.samples import Trajectory

if TYPE_CHECKING:
    from etude.campaign.flight.config import FlightConfig
    from etude.campaign.folder import Campaign
    from etude.campaign.state import State
    from etude.deploy.trajectory_files import TrajectoryFiles
    from etude.models.flight.model import FlightModel


class FlightKind:
    """See `kinds.RobotKind`. Modules are loaded when they are needed."""

    def first(self, campaign: Campaign, rng: np.random.Generator) -> tuple[FourierTrajectory, str]:
        """Uniform on the feasible flights."""
        from etude.trajectories.flight.feasible import feasible_flights
        from etude.trajectories.flight.samplers import uniform_parameters

        family = flight_config(campaign).trajectory
        feasible = feasible_flights(flight_spec(campaign.spec), family)
        return family.trajectory(uniform_parameters(rng, feasible)[0]), "random, uniform on the safe flights"

    def design(
        self, campaign: Campaign, model: FlightModel, rng: np.random.Generator, tasks: Sequence[Trajectory]
    ) -> tuple[FourierTrajectory, dict[str, Any]]:
        from etude.design.flight.reference import IntendedFlights
        from etude.design.flight.solve import design_flight

        config, spec = flight_config(campaign), flight_spec(campaign.spec)
        flights = tuple(task for task in tasks if isinstance(task, FourierTrajectory))
        if len(flights) < len(tasks):
            raise UsageError(
                "intended flights must be Fourier trajectories, as `ask` writes them",
                next_step="Give the trajectory.json of a flight with --tasks.",
            )
        intended = IntendedFlights("tasks", flights) if flights else None
        dx, dy, dz = (campaign.state().trained[-1].trained or {})["drag"]
        found = design_flight(model, spec, config.trajectory, config.design, rng, intended, (dx, dy, dz))
        after, before = found.deviation_after, found.deviation_before
        facts = {
            "status": f"{found.criterion} {found.value:.4g} on {found.reference}; "
            f"best of {config.design.candidates} random flights {found.baseline:.4g}",
            "gain": 1.0 - (after / before) ** 2,
            "criterion": found.criterion,
            "value": found.value,
            "baseline_value": found.baseline,
            "active_limits": [list(pair) for pair in found.certificate.active()],
            "deviation_before": before,
            "deviation_after": after,
            "evaluations": found.evaluations,
            "seconds": found.seconds,
        }
        return found.trajectory, facts

    def render(self, trajectory: FourierTrajectory, spec: RobotSpec) -> TrajectoryFiles:
        from etude.deploy.flight_files import render_flight

        return render_flight(trajectory, spec)

    def read(self, path: Path, spec: RobotSpec, degrees: bool) -> FlightLog:
        from etude.logs.flight.table import read_flight

        return read_flight(path, flight_spec(spec), degrees=degrees)

    def align(self, log: FlightLog, trajectory: FourierTrajectory, spec: RobotSpec) -> FlightLog:
        from etude.logs.flight.identity import align_flight

        return align_flight(log, trajectory, flight_spec(spec))

    def take_in(self, campaign: Campaign, number: int, log: FlightLog, source: str) -> TakenIn:
        from etude.logs.flight.parquet import flight_bytes
        from etude.models.flight.preprocess import build_flight_dataset

        build_flight_dataset(log, flight_spec(campaign.spec), flight_config(campaign).data, number)
        return TakenIn(flight_bytes(replace(log, source=source)), float(log.t[-1] - log.t[0]), len(log))

    def learn(self, campaign: Campaign, state: State, number: int, _: Say) -> Learned:
        from etude.campaign.flight.learner import learn_flights

        return learn_flights(campaign, state, number)

    def load_model(self, folder: Path) -> FlightModel:
        from etude.campaign.flight.learner import load_chosen

        return load_chosen(folder)


FLIGHTS = FlightKind()


def flight_config(campaign: Campaign) -> FlightConfig:
    """The campaign's own tables."""
    assert campaign.config.flight is not None  # checked where the campaign was opened
    return campaign.config.flight


def flight_spec(spec: RobotSpec) -> FlightSpec:
    """The vehicle."""
    assert spec.flight is not None  # the kind was chosen by it
    return spec.flight
