"""How far a series uses its certified limits: the linear rows of a design, and scaling back onto them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError
from etude.robots.spec import RobotSpec
from etude.trajectories.certificate import OVERSAMPLING
from etude.trajectories.extremes import ROOM, grid
from etude.trajectories.family import TrajectoryFamily
from etude.trajectories.fourier import series
from etude.trajectories.ramp import PEAK_RATE

Array = NDArray[np.float64]

SHARPNESS = 48
"""Exponent of the p-norms of `smooth_gauge`."""


@dataclass(frozen=True)
class CertifiedRows:
    """Limits as rows in the coefficients, valid for all times: |row . x - middle| <= kappa * half width.

    Attributes:
        position, velocity, acceleration: (M, 2N+1) rows at omega0 = 1 without the constant q0; position
            amplitudes scale with 1/omega0 and accelerations with omega0.
        middle, half, speed, bend: (dof,) middle and kappa times half width of the position limits, and kappa
            times the velocity and acceleration limits.
        ramp_gain: (15/8)/Tr in 1/s, which adds to accelerations on a phase ramp, or 0.
    """

    position: Array
    velocity: Array
    acceleration: Array
    middle: Array
    half: Array
    speed: Array
    bend: Array
    ramp_gain: float

    def centre(self, harmonics: int) -> Array:
        """(2N+1, dof) coefficients at rest in the middle of the limits."""
        table = np.zeros((2 * harmonics + 1, len(self.middle)))
        table[0] = self.middle
        return table

    def gauge(self, coefficients: Array, omega0: float) -> Array:
        """Largest use of any limit by each joint (dof,); <= 1 means certified. Coefficients (2N+1, dof)."""
        position, velocity, acceleration = (np.abs(u).max(axis=0) for u in self._uses(coefficients, omega0))
        turned = acceleration + self._ramp_share * velocity
        return np.asarray(np.maximum(np.maximum(position, velocity), turned))

    def smooth_gauge(self, coefficients: Array, omega0: float) -> tuple[Array, Array, Array]:
        """A smooth upper bound of `gauge`, a few per cent above it: p-norms in place of maxima.

        Optima lie where several limits are touched at once, where the gauge itself has corners that stop a
        quasi-Newton search; so does a start that was scaled to the limits.

        Returns:
            bound (dof,), its derivative in the coefficients (2N+1, dof) and in omega0 (dof,).
        """
        uses = self._uses(coefficients, omega0)
        (q, in_q), (v, in_v), (a, in_a) = (_norm(use) for use in uses)
        total, (by_q, by_v, by_a) = _norm(np.array([q, v, a + self._ramp_share * v]))
        in_q, in_a = in_q * by_q, in_a * by_a
        in_v = in_v * (by_v + self._ramp_share * by_a)
        offset = np.zeros_like(coefficients)
        offset[0] = (in_q / self.half).sum(axis=0)
        gradient = offset + self.position.T @ (in_q / (omega0 * self.half))
        gradient += self.velocity.T @ (in_v / self.speed) + self.acceleration.T @ (in_a * omega0 / self.bend)
        wave = uses[0] - (coefficients[0] - self.middle) / self.half
        return total, gradient, ((in_a * uses[2]).sum(axis=0) - (in_q * wave).sum(axis=0)) / omega0

    @property
    def _ramp_share(self) -> Array:
        """Use of the acceleration limit on a ramp by a motion that uses the whole velocity limit, (dof,)."""
        return self.ramp_gain * self.speed / self.bend

    def _uses(self, coefficients: Array, omega0: float) -> tuple[Array, Array, Array]:
        """Signed uses (M, dof) of the position, velocity and acceleration limits at the grid's angles."""
        offset = coefficients[0] - self.middle
        return (
            (offset + self.position @ coefficients / omega0) / self.half,
            self.velocity @ coefficients / self.speed,
            self.acceleration @ coefficients * omega0 / self.bend,
        )

    def scale_to(self, coefficients: Array, omega0: float, *, enlarge: bool = False) -> Array:
        """The coefficients, each joint drawn towards rest in the middle just enough to be certified.

        With `enlarge`, joints inside their limits grow until they touch one.
        """
        use = self.gauge(coefficients, omega0)
        centre = self.centre((len(coefficients) - 1) // 2)
        return centre + (coefficients - centre) / (use if enlarge else np.maximum(use, 1.0))


def _norm(values: Array) -> tuple[Array, Array]:
    """p-norm over the first axis, never below the largest modulus, and its derivative."""
    peak = np.maximum(np.abs(values).max(axis=0), np.finfo(float).tiny)
    norm = peak * ((np.abs(values) / peak) ** SHARPNESS).sum(axis=0) ** (1.0 / SHARPNESS)
    return norm, np.sign(values) * (np.abs(values) / norm) ** (SHARPNESS - 1)


def certified_rows(
    spec: RobotSpec, family: TrajectoryFamily, oversampling: int = OVERSAMPLING
) -> CertifiedRows:
    """Rows of all position, velocity and acceleration limits of `spec` for the members of `family`.

    Raises:
        UnsafeTrajectoryError: limits that leave no room for any motion.
    """
    check_room(spec)
    angles, kappa = grid(family.harmonics, oversampling)
    position, velocity, acceleration, _ = series(angles, family.harmonics, 1.0)
    position[:, 0] = 0.0
    room = kappa * ROOM
    ramp_gain = PEAK_RATE / family.phase_ramp if family.phase_ramp > 0.0 else 0.0
    return CertifiedRows(
        position,
        velocity,
        acceleration,
        0.5 * (spec.upper + spec.lower),
        0.5 * room * (spec.upper - spec.lower),
        room * spec.velocity,
        room * spec.acceleration,
        ramp_gain,
    )


def check_room(spec: RobotSpec) -> None:
    """UnsafeTrajectoryError if some limit leaves no room to move, naming the joint and the limit."""
    for axis in spec.axes:
        limits = (
            ("position", axis.upper - axis.lower, f"{axis.lower:g}..{axis.upper:g}"),
            ("velocity", axis.velocity, f"{axis.velocity:g}"),
            ("acceleration", axis.acceleration, f"{axis.acceleration:g}"),
        )
        for quantity, width, text in limits:
            smallest = 1e-9 * max(1.0, abs(axis.lower), abs(axis.upper)) if quantity == "position" else 0.0
            if not width > smallest:
                raise UnsafeTrajectoryError(
                    f"the {quantity} limit {text} of joint '{axis.name}' leaves no room for any motion",
                    where=f"joint {axis.name}, {quantity}",
                    next_step="Widen the limit, or take the joint out of the robot file.",
                )
