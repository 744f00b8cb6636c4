"""What the design of one flight costs: all of it, and what exact gradients save over finite differences.

No simulator takes part: a design sees a model's variances alone, and those depend on where the vehicle has
been, not on what it answered. So the processes are conditioned on planned flights with fixed hyperparameters.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.design.flight.config import FlightDesignConfig
from etude.design.flight.reference import IntendedFlights, uniform_intended
from etude.design.flight.refine import refine_flight
from etude.design.flight.solve import design_flight, flight_objective
from etude.models.contracts import Posterior
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import SquaredExponential
from etude.robots.flight_spec import FlightSpec
from etude_studies.rows import Row
from etude.threads import threads_for
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import uniform_parameters
from etude.trajectories.flight.states import FlightStates, join_states

Array = NDArray[np.float64]

METHODS = ("gradient", "finite_differences")
FLIGHTS = 4
NOISE = 0.2
"""Noise deviation of the processes, as a part of their signal's."""
LENGTH = 2.0
"""Lengthscale of every input, in half ranges."""
DRAG = (0.57, 0.57, 0.0)
COLUMNS = ("specific_force", "rates", "angular_acceleration", "velocity")


@dataclass(frozen=True)
class AllStates:
    """Altitude and COLUMNS, each divided by the half range it had in the flights learned from."""

    scale: Array

    def transform(self, states: FlightStates) -> Array:
        """X (T, 13)."""
        return _columns(states) / self.scale

    def pullback(self, states: FlightStates, G: Array) -> FlightStates:  # noqa: ARG002
        """Gradients of sum(G * transform(states))."""
        G = G / self.scale
        parts = {name: G[:, 1 + 3 * k : 4 + 3 * k] for k, name in enumerate(COLUMNS)}
        return FlightStates(altitude=G[:, 0], **parts)


@dataclass(frozen=True)
class KnownFlights:
    """A model of planned flights, as a design sees it."""

    features: AllStates
    posteriors: Sequence[Posterior]


def thesis_room() -> FlightSpec:
    """The box and speed of the thesis's quadrotor."""
    return FlightSpec(
        name="room",
        lower=(-10.0, -10.0, 0.3),
        upper=(10.0, 10.0, 5.0),
        speed=6.0,
        command_names=("front_right", "back_right", "back_left", "front_left"),
        command_unit="V",
        command_lower=(0.0, 0.0, 0.0, 0.0),
        command_upper=(11.1, 11.1, 11.1, 11.1),
        rate=10.0,
    )


def known_flights(
    rng: np.random.Generator, spec: FlightSpec, family: FlightFamily, count: int = FLIGHTS
) -> KnownFlights:
    """One process for all commands that has seen `count` uniform flights at the log's rate."""
    feasible = feasible_flights(spec, family)
    t = np.arange(0.0, family.duration, 1.0 / spec.rate)
    flights = [family.trajectory(point) for point in uniform_parameters(rng, feasible, count)]
    states = join_states([flat_motion(motion_of(flight, t), DRAG).states for flight in flights])
    columns = _columns(states)
    features = AllStates(np.maximum(0.5 * np.ptp(columns, axis=0), 1e-3))
    X = features.transform(states)
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    theta = kernel.initial(np.full(X.shape[1], LENGTH), 1.0)
    posterior = ExactGP(kernel, theta, float(np.log(NOISE))).condition(X, np.zeros(len(X)))
    return KnownFlights(features, (posterior,))


def design_rows(
    rng: np.random.Generator, config: FlightDesignConfig | None = None, *, starts: int = 4
) -> list[Row]:
    """The cost of a design, by default of 75 points, 300 inducing points and 8 starts.

    `design_cpu_s`: CPU of all of it. `design_gradient_speedup`: CPU of finite differences over that of exact
    gradients, whole searches from the same starts; `design_gradient_value`: the mean value each reached.
    """
    config = FlightDesignConfig() if config is None else config
    spec, family = thesis_room(), FlightFamily()
    model = known_flights(rng, spec, family)
    intended = uniform_intended(rng, feasible_flights(spec, family), family)
    found = design_flight(model, spec, family, config, rng, intended, DRAG)
    exact, differences = _both_ways(rng, model, spec, family, config, starts, intended)
    return [
        Row("design_cpu_s", found.seconds, "s", "required at most", 3.0),
        Row("design_value", found.value, "1", "best of the random flights", found.baseline),
        Row("design_gradient_speedup", differences[0] / exact[0], "1", "required at least", 4.0),
        Row("design_gradient_value", exact[1], "1", "finite differences", differences[1]),
    ]


def _both_ways(
    rng: np.random.Generator,
    model: KnownFlights,
    spec: FlightSpec,
    family: FlightFamily,
    config: FlightDesignConfig,
    starts: int,
    intended: IntendedFlights,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """CPU in s and mean value reached by exact gradients and by finite differences, from the same starts."""
    feasible = feasible_flights(spec, family)
    points = uniform_parameters(rng, feasible, starts)
    results = []
    with threads_for(0):
        objective = flight_objective(model, spec, family, config, rng, intended, DRAG)
        for method in METHODS:
            options: dict[str, Any] = {"criterion": config.criterion, "steps": config.steps, "method": method}
            began = time.process_time()
            ends = [refine_flight(objective, feasible, point, **options) for point in points]
            results.append((time.process_time() - began, float(np.mean([end.value for end in ends]))))
    return results[0], results[1]


def _columns(states: FlightStates) -> Array:
    assert states.altitude is not None
    return np.column_stack([states.altitude, *(getattr(states, name) for name in COLUMNS)])
