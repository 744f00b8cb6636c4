"""Configuration tables [trajectory] and [data] of a vehicle's campaign: flights, and use of logs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from etude.errors import UsageError
from etude.trajectories.config import FourierConfig
from etude_quadrotor.inputs import Acceleration, QuadrotorInputs


@dataclass(frozen=True)
class FlightConfig:
    """Fourier flights: x and y without a constant term, z with one (thesis (3.3)).

    Attributes:
        harmonics: N; at least 2 with `rest`.
        duration: s.
        omega0: rad/s; None for 2 pi/duration, one period.
        start: state at the start. "hover": at rest at the first position, so that the plan's first velocity
            is a step (the thesis). "moving": with the plan's velocity. The plan is the same.
        rest: the plan itself starts and ends at rest (two equalities per axis, whole periods).
        free_centre: x and y also have a constant term, which the limits bound.
        centre: constant terms of x and y if they are not free, m.
        tilt: largest angle of the planned thrust from the vertical, rad, besides the vehicle's own limit;
            None: the vehicle's alone.
        lean: simulated flights compensate the drag that earlier flights taught.

    Raises:
        UsageError: a value is out of range, or `rest` has no whole number of periods.
    """

    harmonics: int = 2
    duration: float = 30.0
    omega0: float | None = None
    start: Literal["hover", "moving"] = "hover"
    rest: bool = False
    free_centre: bool = False
    centre: tuple[float, float] = (0.0, 0.0)
    tilt: float | None = None
    lean: bool = False

    def __post_init__(self) -> None:
        if self.start not in ("hover", "moving"):
            raise UsageError(f"a flight starts in 'hover' or 'moving', not {self.start!r}")
        if not all(math.isfinite(c) for c in self.centre):
            raise UsageError(f"the centre must be two finite numbers in m, not {self.centre}")
        if self.tilt is not None and not 0.0 < self.tilt < 0.5 * math.pi:
            raise UsageError(f"the tilt is an angle between 0 and pi/2 rad, not {self.tilt}")
        _ = self.series  # refuses what makes no series

    @property
    def described(self) -> FlightConfig:
        """The configuration without choices beyond the description; earlier plans are checked against it."""
        return replace(self, tilt=None)

    @property
    def series(self) -> FourierConfig:
        """The configuration of the Fourier family."""
        rest: Literal["nullspace", "none"] = "nullspace" if self.rest else "none"
        return FourierConfig(self.harmonics, self.duration, self.omega0, rest)


@dataclass(frozen=True)
class FlightData:
    """Preprocessing of a flight into samples, and inputs of the model.

    Attributes:
        averaged: samples are means over their interval, which prevents aliasing of noise; False: single
            samples (the thesis).
        lag_s: lag of the motion behind the commands, s. "auto" measures it in logs of at least `FAST` times
            the model's rate, or of `FAST_HZ`, and is 0 without such logs.
        first_s, last_s: trimmed from both ends, s.
        altitude, acceleration, body_velocity, battery_voltage: the inputs, see `QuadrotorInputs`.
        trims: the identified physics have a constant for each motor, besides drag, ground effect, back-EMF
            and gains.
    """

    averaged: bool = True
    lag_s: float | Literal["auto"] = "auto"
    first_s: float = 0.0
    last_s: float = 0.0
    altitude: bool = True
    acceleration: Acceleration = "specific_force"
    body_velocity: bool = True
    battery_voltage: bool = True
    trims: bool = True

    def __post_init__(self) -> None:
        for name in ("lag_s", "first_s", "last_s"):
            value = getattr(self, name)
            if value == "auto" and name == "lag_s":
                continue
            if isinstance(value, str) or not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} must be a number of seconds, 0 or more, not {value!r}", where=name)
        self.inputs()

    def inputs(self) -> QuadrotorInputs:
        """The configured inputs, before any flight."""
        return QuadrotorInputs(
            self.altitude, self.acceleration, self.body_velocity, battery_voltage=self.battery_voltage
        )
