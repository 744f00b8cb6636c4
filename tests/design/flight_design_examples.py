"""A vehicle in its box and a model that has seen two flights of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.models.contracts import Posterior
from etude.models.gp.exact import ExactGP
from etude.models.gp.kernels import SquaredExponential
from etude.robots.flight_spec import FlightSpec
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible import feasible_flights
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.flight.samplers import uniform_parameters
from etude.trajectories.flight.states import FlightStates, join_states

DRAG = (0.6, 0.5, 0.1)
PARTS = ("altitude", "specific_force", "rates", "angular_acceleration", "velocity")
SIZES = dict(zip((*PARTS, "acceleration"), (1.5, 1.0, 0.1, 0.1, 2.0, 1.0), strict=True))


@dataclass(frozen=True)
class Columns:
    """Some quantities side by side, each divided by a typical size."""

    parts: tuple[str, ...] = PARTS

    @property
    def scales(self) -> np.ndarray:
        return np.concatenate([np.full(1 if name == "altitude" else 3, SIZES[name]) for name in self.parts])

    def transform(self, states: FlightStates) -> np.ndarray:
        return np.column_stack([getattr(states, name) for name in self.parts]) / self.scales

    def pullback(self, states: FlightStates, G: np.ndarray) -> FlightStates:
        zero, found, place = np.zeros((len(G), 3)), {}, 0
        for name in self.parts:
            width = 1 if name == "altitude" else 3
            block = (G / self.scales)[:, place : place + width]
            found[name], place = block[:, 0] if name == "altitude" else block, place + width
        rest = dict.fromkeys(("specific_force", "rates", "angular_acceleration"), zero)
        return FlightStates(**({"altitude": None} | rest | found))


@dataclass(frozen=True)
class FlightModel:
    features: Columns
    posteriors: tuple[Posterior, ...]


def box(**changes) -> FlightSpec:
    given = {
        "name": "example",
        "lower": (-10.0, -10.0, 0.3),
        "upper": (10.0, 10.0, 5.0),
        "speed": 5.0,
        "command_names": ("m1", "m2", "m3", "m4"),
        "command_unit": "V",
        "command_lower": (0.0,) * 4,
        "command_upper": (11.1,) * 4,
        "rate": 10.0,
    }
    return FlightSpec(**(given | changes))


def flight_model(features: Columns | None = None, points: int = 40, outputs: int = 2) -> FlightModel:
    """Processes of different amplitude and lengths, from two uniform flights of the thesis's family."""
    features, family = features or Columns(), FlightFamily()
    rng, feasible = np.random.default_rng(11), feasible_flights(box(), FlightFamily())
    t = np.linspace(0.5, 29.5, points // 2)
    flights = [family.trajectory(p) for p in uniform_parameters(rng, feasible, 2, 50)]
    X = features.transform(join_states([flat_motion(motion_of(f, t), DRAG).states for f in flights]))
    kernel = SquaredExponential(tuple(range(X.shape[1])))
    made = []
    for j in range(outputs):
        theta = kernel.initial(np.full(X.shape[1], 2.0 + j), 1.0 + 2.0 * j)
        made.append(
            ExactGP(kernel, theta, np.log(0.2)).condition(X, np.sin(X[:, j]) - np.sin(X[:, j]).mean())
        )
    return FlightModel(features, tuple(made))
