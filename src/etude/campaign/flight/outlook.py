"""What a vehicle's model expects of itself on intended flights: the facts that the stop rule rests on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.folder import Campaign
from etude.campaign.outlook import REFERENCE_STREAM
from etude.campaign.state import State
from etude.design.flight.reference import flight_reference, uniform_intended
from etude.models.flight.config import PHYSICS_KINDS
from etude.models.flight.model import FlightModel
from etude.trajectories.flight.feasible import feasible_flights

Array = NDArray[np.float64]
STATES = 100


def flight_outlook(
    model: FlightModel, before: FlightModel | None, campaign: Campaign, state: State, drag: list[float]
) -> dict[str, Any]:
    """Facts for the `trained` event, as `outlook.outlook`; each list per command, in its unit."""
    flight, spec = campaign.config.flight, campaign.spec.flight
    assert flight is not None
    assert spec is not None
    rng = np.random.default_rng([state.seed, REFERENCE_STREAM])
    flights = uniform_intended(rng, feasible_flights(spec, flight.trajectory), flight.trajectory)
    X = flight_reference(rng, model.features, flights, STATES, (drag[0], drag[1], drag[2]))
    latent = np.concatenate([np.tile(np.mean(p.predict(X)[1]), len(p.outputs)) for p in model.processes])
    noise = np.concatenate([np.tile(p.noise_variance, len(p.outputs)) for p in model.processes])
    deviation = model.deviation * np.sqrt(latent)
    forecast = deviation * np.sqrt(model.scale)
    if model.kind in PHYSICS_KINDS and model.physics_variance is not None:
        forecast = np.sqrt(model.physics_variance)
    return {
        "forecast_deviation": forecast.tolist(),
        "latent_deviation": deviation.tolist(),
        "noise_deviation": (model.deviation * np.sqrt(noise)).tolist(),
        "moved": None if before is None else _moved(model, before),
    }


def _moved(model: FlightModel, before: FlightModel) -> float | None:
    """Largest |change| of a logarithmic length scale; None if the processes differ in kind."""
    moves = []
    for now, then in zip(model.processes, before.processes, strict=False):
        a, b = now.outputs[0], then.outputs[0]
        if a.kernel != b.kernel:
            return None
        lengths = np.array([role == "length" for role in a.kernel.roles()])
        moves.append(float(np.abs(a.theta - b.theta)[lengths].max()))
    return max(moves, default=None)
