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


@dataclass(frozen=True)
class CertifiedRows:
    """Limits as rows in the coefficients, valid for all times: |row . x - middle| <= kappa * half width.

    Attributes:
        position, velocity, acceleration: (M, 2N+1) rows at omega0 = 1; position amplitudes scale with
            1/omega0 and accelerations with omega0.
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

    def gauge(self, coefficients: Array, omega0: float) -> tuple[Array, Array, Array]:
        """Largest use of any limit per joint; <= 1 means certified.

        Args:
            coefficients: (2N+1, dof).
            omega0: rad/s.

        Returns:
            gauge (dof,), its derivative in the coefficients (2N+1, dof) and in omega0 (dof,). Where several
            rows are equally used the derivative is that of one of them.
        """
        joints = np.arange(coefficients.shape[1])
        series_part = coefficients.copy()
        series_part[0] = 0.0
        wave = self.position @ series_part / omega0
        at_q, q, _ = _peak(coefficients[0] - self.middle + wave)
        at_v, v, _ = _peak(self.velocity @ coefficients)
        at_a, a, _ = _peak(omega0 * (self.acceleration @ coefficients))
        sign_q, sign_v, sign_a = np.sign(q), np.sign(v), np.sign(a)
        uses = np.array(
            [
                np.abs(q) / self.half,
                np.abs(v) / self.speed,
                (np.abs(a) + self.ramp_gain * np.abs(v)) / self.bend,
            ]
        )
        row_q = self.position[at_q] / omega0
        row_q[:, 0] = 1.0
        row_v = sign_v[:, None] * self.velocity[at_v]
        row_a = sign_a[:, None] * self.acceleration[at_a] * omega0
        gradients = np.array(
            [
                sign_q[:, None] * row_q / self.half[:, None],
                row_v / self.speed[:, None],
                (row_a + self.ramp_gain * row_v) / self.bend[:, None],
            ]
        )
        in_omega0 = np.array(
            [-sign_q * wave[at_q, joints] / (omega0 * self.half), 0.0 * q, np.abs(a) / (omega0 * self.bend)]
        )
        which = uses.argmax(axis=0)
        return uses[which, joints], gradients[which, joints].T, in_omega0[which, joints]

    def scale_back(self, coefficients: Array, omega0: float) -> Array:
        """The coefficients, each joint drawn towards rest in the middle just enough to be certified."""
        use, _, _ = self.gauge(coefficients, omega0)
        centre = self.centre((len(coefficients) - 1) // 2)
        return centre + (coefficients - centre) / np.maximum(use, 1.0)


def _peak(values: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Row of the largest modulus of each column, the signed value there, and all values."""
    at = np.abs(values).argmax(axis=0)
    return at, values[at, np.arange(values.shape[1])], values


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
