"""Position of a flight and its derivatives up to snap, linear in the coefficients of thesis (3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.trajectories.fourier import FourierTrajectory, series

Array = NDArray[np.float64]

ORDERS = ("position", "velocity", "acceleration", "jerk", "snap")


@dataclass(frozen=True)
class FlightMotion:
    """Motion of the vehicle's centre in the world frame, z up.

    Attributes:
        t: (T,) s.
        position, velocity, acceleration, jerk, snap: (T, 3) m and s.
    """

    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    snap: Array


def motion_rows(t: Array, harmonics: int, omega0: float) -> tuple[Array, ...]:
    """Rows (T, 2N+1) that give position, velocity, acceleration, jerk and snap from the coefficients.

    Args:
        t: (T,) s.
        harmonics: N.
        omega0: rad/s.
    """
    first = series(omega0 * t, harmonics, omega0)
    w2 = (omega0 * np.arange(1, harmonics + 1)) ** 2
    # two more derivatives of a harmonic only multiply it by -w^2
    return (*first, -np.concatenate([[0.0], w2, w2]) * first[2])


def motion_of(trajectory: FourierTrajectory, t: Array) -> FlightMotion:
    """The motion at times t (T,) in [0, duration].

    Raises:
        UsageError: not three axes, a phase ramp (snap jumps there), or times outside the flight.
    """
    t = np.asarray(t, dtype=float)
    if trajectory.dof != 3 or trajectory.ramp > 0.0:
        raise UsageError(
            f"a flight has 3 axes and no phase ramp, not {trajectory.dof} and {trajectory.ramp} s",
            next_step="Use a member of a FlightFamily.",
        )
    if t.size and not (t.min() >= 0.0 and t.max() <= trajectory.duration):
        raise UsageError(f"the times {t.min():g}..{t.max():g} s leave 0..{trajectory.duration:g} s")
    rows = motion_rows(t, trajectory.harmonics, trajectory.omega0)
    return FlightMotion(t, *(row @ trajectory.coefficients for row in rows))
