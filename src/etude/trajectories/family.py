"""TrajectoryFamily: which Fourier trajectories may be proposed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.fourier import FourierTrajectory, rest_nullspace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrajectoryFamily:
    """All Fourier trajectories of a given length and number of harmonics that start and end at rest.

    Attributes:
        harmonics: N; at least 2 with rest = "nullspace".
        duration: s.
        omega0: base frequency in rad/s: a number, a range (low, high) that may be searched, or None for
            2 pi/duration, one period.
        rest: "nullspace", two linear equalities per joint and a whole number of periods; or "ramp", a phase
            ramp at both ends, for any coefficients and any omega0.
        ramp: length of each phase ramp in s (only with rest = "ramp").

    Raises:
        UsageError: values out of range, or no whole number of periods with rest = "nullspace".
    """

    harmonics: int = 5
    duration: float = 60.0
    omega0: tuple[float, float] | float | None = None
    rest: Literal["nullspace", "ramp"] = "nullspace"
    ramp: float = 2.0

    def __post_init__(self) -> None:
        if self.rest not in ("nullspace", "ramp"):
            raise UsageError(f"rest must be 'nullspace' or 'ramp', not {self.rest!r}")
        low, high = self.omega0_range
        if self.harmonics < 1 or not (math.isfinite(high) and 0.0 < low <= high):
            raise UsageError(
                f"a family needs harmonics >= 1 and 0 < omega0, not {self.harmonics} and {low}..{high} rad/s"
            )
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise UsageError(f"the duration must be a positive number of seconds, not {self.duration}")
        if self.rest == "ramp" and not 0.0 < 2.0 * self.ramp <= self.duration:
            raise UsageError(f"two ramps of {self.ramp} s do not fit into {self.duration} s")
        if self.rest == "nullspace":
            rest_nullspace(self.harmonics)
            if not self.whole_periods:
                raise UsageError(
                    f"no whole number of periods lasts {self.duration} s, omega0 in {low:g}..{high:g} rad/s",
                    next_step="Widen the range of omega0, change the duration, or use rest = 'ramp'.",
                )

    @property
    def omega0_range(self) -> tuple[float, float]:
        """Lowest and highest omega0, rad/s."""
        if self.omega0 is None:
            one_period = 2.0 * math.pi / self.duration if self.duration > 0.0 else math.nan
            return one_period, one_period
        if isinstance(self.omega0, tuple | list):
            low, high = self.omega0
            return float(low), float(high)
        return float(self.omega0), float(self.omega0)

    @property
    def whole_periods(self) -> tuple[float, ...]:
        """The values of omega0 in range for which the duration is a whole number of periods."""
        low, high = self.omega0_range
        one_period = 2.0 * math.pi / self.duration
        first, last = math.ceil(low / one_period - 1e-9), math.floor(high / one_period + 1e-9)
        return tuple(k * one_period for k in range(max(first, 1), last + 1))

    @property
    def omega0_is_free(self) -> bool:
        """Whether omega0 may vary continuously (rest by ramp and a range)."""
        low, high = self.omega0_range
        return self.rest == "ramp" and high > low

    @property
    def phase_ramp(self) -> float:
        """Ramp length of the family's trajectories, s; 0 with rest = "nullspace"."""
        return self.ramp if self.rest == "ramp" else 0.0

    @property
    def free_basis(self) -> Array:
        """(2N+1, P) basis of the coefficients that are allowed, for one joint."""
        if self.rest == "nullspace":
            return rest_nullspace(self.harmonics)
        return np.eye(2 * self.harmonics + 1)

    def draw_omega0(self, rng: np.random.Generator) -> float:
        """One omega0 in range, uniformly."""
        if self.rest == "nullspace":
            return float(rng.choice(self.whole_periods))
        return float(rng.uniform(*self.omega0_range))

    def trajectory(self, coefficients: Array, omega0: float) -> FourierTrajectory:
        """The member of the family with these coefficients (2N+1, dof)."""
        return FourierTrajectory(coefficients, omega0, self.duration, self.phase_ramp)


def suited_to(family: TrajectoryFamily, spec: RobotSpec) -> TrajectoryFamily:
    """The family with omega0 chosen for a robot, if it was left open.

    At one period in `duration` a fast robot would use a few per cent of its velocity limits, and show
    nothing of its inertia. So the motion makes as many whole periods as the joint with the longest way for
    its speed allows: a joint that swings over its range in the middle harmonics then comes near its limits
    of position and of velocity (or acceleration) alike.
    """
    if family.omega0 is not None:
        return family
    half_range, middle = 0.5 * (spec.upper - spec.lower), 0.5 * max(family.harmonics, 2)
    by_velocity = spec.velocity / half_range / middle
    by_acceleration = np.sqrt(spec.acceleration / half_range) / middle
    omega0 = float(np.min(np.minimum(by_velocity, by_acceleration)))
    periods = max(1, round(omega0 * family.duration / (2.0 * math.pi)))
    return replace(family, omega0=2.0 * math.pi * periods / family.duration)
