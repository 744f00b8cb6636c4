"""Configuration of a family of Fourier series: the [trajectory] table of a campaign."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from etude._runtime.rounding import whole_down, whole_up
from etude.errors import UsageError


@dataclass(frozen=True)
class FourierConfig:
    """The numbers that choose a family.

    Attributes:
        harmonics: N; at least 2 with rest = "nullspace".
        duration: s, of a recording.
        omega0: base frequency in rad/s: a number, a range (low, high) that is drawn from, or None for
            2 pi/duration, one period; arms then split the recording into segments (`suited_to`).
        rest: "nullspace", two linear equalities per axis and a whole number of periods; "ramp", a phase ramp
            at both ends, for any coefficients and any omega0; or "none", for vehicles that start in motion.
        ramp: length of each phase ramp in s (only with rest = "ramp").

    Raises:
        UsageError: values out of range, or no whole number of periods with rest = "nullspace".
    """

    harmonics: int = 5
    duration: float = 60.0
    omega0: tuple[float, float] | float | None = None
    rest: Literal["nullspace", "ramp", "none"] = "nullspace"
    ramp: float = 2.0

    def __post_init__(self) -> None:
        if self.rest not in ("nullspace", "ramp", "none"):
            raise UsageError(f"rest must be 'nullspace', 'ramp' or 'none', not {self.rest!r}")
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise UsageError(f"the duration must be a positive number of seconds, not {self.duration}")
        low, high = self.omega0_range
        if self.harmonics < 1 or not (math.isfinite(high) and 0.0 < low <= high):
            raise UsageError(
                f"a family needs harmonics >= 1 and 0 < omega0, not {self.harmonics} and {low}..{high} rad/s"
            )
        if self.rest == "ramp" and not 0.0 < 2.0 * self.ramp <= self.duration:
            raise UsageError(f"two ramps of {self.ramp} s do not fit into {self.duration} s")
        if self.rest == "nullspace":
            require_rest(self.harmonics)
            if not self.whole_periods:
                raise UsageError(
                    f"no whole number of periods lasts {self.duration} s, omega0 in {low:g}..{high:g} rad/s",
                    next_step="Widen the range of omega0, change the duration, or use rest = 'ramp'.",
                )

    @property
    def omega0_range(self) -> tuple[float, float]:
        """Lowest and highest omega0, rad/s."""
        if self.omega0 is None:
            return 2.0 * math.pi / self.duration, 2.0 * math.pi / self.duration
        if isinstance(self.omega0, tuple | list):
            low, high = self.omega0
            return float(low), float(high)
        return float(self.omega0), float(self.omega0)

    @property
    def whole_periods(self) -> tuple[float, ...]:
        """The values of omega0 in range for which the duration is a whole number of periods."""
        low, high = self.omega0_range
        one_period = 2.0 * math.pi / self.duration
        first, last = whole_up(low / one_period), whole_down(high / one_period)
        return tuple(k * one_period for k in range(max(first, 1), last + 1))

    @property
    def phase_ramp(self) -> float:
        """Ramp length of the family's trajectories, s; 0 unless rest = "ramp"."""
        return self.ramp if self.rest == "ramp" else 0.0

    @property
    def choices(self) -> tuple[float, ...]:
        """The base frequencies: each whole number of periods, or the ends of the range, rad/s."""
        return self.whole_periods if self.rest == "nullspace" else self.omega0_range

    def draw_omega0(self, rng: np.random.Generator) -> float:
        """One omega0 in range, uniformly; with rest = "nullspace", one of the whole periods."""
        if self.rest == "nullspace":
            return float(rng.choice(self.whole_periods))
        return float(rng.uniform(*self.omega0_range))


def require_rest(harmonics: int) -> None:
    """Raise UsageError for fewer than two harmonics: rest by equalities then leaves no motion."""
    if harmonics < 2:
        raise UsageError(
            f"rest by equalities needs at least 2 harmonics, not {harmonics}",
            next_step="Use rest = 'ramp' instead.",
        )
