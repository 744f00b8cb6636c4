"""FlightModelConfig: every choice in making an inverse model of a vehicle, named and visible."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from etude.errors import UsageError
from etude.models.flight.features import Acceleration, FlightFeatures
from etude.trajectories.flight.states import FlightStates

FlightKind = Literal["nominal", "identified", "gp", "nominal+gp", "identified+gp"]
FLIGHT_KINDS: tuple[FlightKind, ...] = ("nominal", "identified", "gp", "nominal+gp", "identified+gp")
PHYSICS_KINDS: tuple[FlightKind, ...] = ("nominal", "identified")
"""Kinds that predict without a process."""
LEAST_FLIGHTS = 4
"""Flights from which held-out ones tell how wrong a new one will be; with fewer a model is uncalibrated."""

FLOORS = (0.4, 0.25, 0.15)
"""Noise floors tried with noise_floor = "auto". Training goes down them, each from the optimum of the last: a
high floor has one smooth optimum, where a low one may fall for lengths that are too short."""


@dataclass(frozen=True)
class FlightModelConfig:
    """How flights become an inverse model.

    Attributes:
        kind: one of `FLIGHT_KINDS`, or "auto": the ladder trains them and chooses.
        altitude, acceleration, body_velocity: the inputs, see `FlightFeatures`.
        kernel: "shared": one kernel for the four commands, one factorisation for all; or "separate".
        hyperparameters: "first_flight": fitted once, to the first flight (thesis 5); or "refit" to all.
        trims: whether the identified physics have a constant for each motor, beside drag, ground effect,
            back-EMF and gains.
        points: samples that the processes are conditioned on, at most.
        fit_points: samples for the hyperparameters, at most.
        fit_spacing_s: the latter are at least this far apart: nearer ones repeat each other, and the
            likelihood takes their agreement for precision. At 10 Hz that cost a factor of four in error.
        steps, starts: of the training by L-BFGS; the best end wins.
        prior: "weak" log-normal priors on the hyperparameters, or "none" (maximum likelihood).
        noise_floor: least noise deviation, as a part of the deviation of what a process learns; "auto"
            chooses among `FLOORS` by how well each flight is predicted from the others.
        calibrate: multiply variances by the held-out z² where that exceeds 1.
        student_t: fit the tails of the held-out errors, for the reported density.
    """

    kind: FlightKind | Literal["auto"] = "auto"
    altitude: bool = True
    acceleration: Acceleration = "specific_force"
    body_velocity: bool = True
    kernel: Literal["shared", "separate"] = "shared"
    hyperparameters: Literal["first_flight", "refit"] = "refit"
    trims: bool = True
    points: int = 1200
    fit_points: int = 300
    fit_spacing_s: float = 0.5
    steps: int = 60
    starts: int = 3
    prior: Literal["weak", "none"] = "weak"
    noise_floor: float | Literal["auto"] = "auto"
    calibrate: bool = True
    student_t: bool = True

    def __post_init__(self) -> None:
        _one_of("kind", self.kind, (*FLIGHT_KINDS, "auto"))
        _one_of("kernel", self.kernel, ("shared", "separate"))
        _one_of("hyperparameters", self.hyperparameters, ("first_flight", "refit"))
        _one_of("prior", self.prior, ("weak", "none"))
        self.features()
        for name, least in {"points": 2, "fit_points": 2, "steps": 0, "starts": 1}.items():
            if getattr(self, name) < least:
                raise UsageError(f"{name} must be at least {least}", where=f"{name} = {getattr(self, name)}")
        for name in ("fit_spacing_s", "noise_floor"):
            value = getattr(self, name)
            if name == "noise_floor" and value == "auto":
                continue
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0):
                raise UsageError(f"{name} must be a number >= 0", where=f"{name} = {value!r}")

    @property
    def floors(self) -> tuple[float, ...]:
        """The noise floors to try."""
        return FLOORS if self.noise_floor == "auto" else (self.noise_floor,)

    def features(self) -> FlightFeatures:
        """The map from states to the processes' inputs."""
        return FlightFeatures(self.altitude, self.acceleration, self.body_velocity)

    def suited_to(self, states: FlightStates) -> FlightModelConfig:
        """The same without the inputs that no state tells: altitude and velocity, where they are None."""
        return replace(
            self,
            altitude=self.altitude and states.altitude is not None,
            body_velocity=self.body_velocity and states.velocity is not None,
        )


def _one_of(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise UsageError(f"{name} must be one of {', '.join(allowed)}", where=f"{name} = {value!r}")


PRESETS = {
    "default": FlightModelConfig(),
    "thesis": FlightModelConfig(
        kind="gp",
        acceleration="kinematic",
        body_velocity=False,
        hyperparameters="first_flight",
        fit_spacing_s=0.0,
        starts=1,
        steps=100,
        prior="none",
        # the thesis does not say; without a floor the first flight alone puts the noise at nothing, and every
        # further flight makes the model worse
        noise_floor=0.2,
        calibrate=False,
    ),
}
