"""Certificates: each limit with the extreme that is proved for all times, not only at samples."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.extremes import exact_range, grid, riesz_range
from etude.trajectories.fourier import FourierTrajectory, series
from etude.trajectories.moves import PEAK_ACCELERATION, PEAK_VELOCITY, PointToPoint
from etude.trajectories.ramp import PEAK_RATE
from etude.trajectories.samples import Trajectory
from etude.trajectories.trajectory_file import from_json

Array = NDArray[np.float64]
Ranges = dict[str, tuple[Array, Array]]
Method = Literal["riesz", "roots"]

OVERSAMPLING = 64
"""Samples per harmonic: the bound exceeds the true extreme by at most 0.12 %."""
REST_TOLERANCE = 1e-9
"""Speed at either end, as a fraction of the velocity limit, below which a trajectory is at rest."""


@dataclass(frozen=True)
class LimitProof:
    """One limit of one axis.

    Attributes:
        axis: joint name.
        quantity: "position" (rad), "velocity" (rad/s), "acceleration" (rad/s^2) or "box" (rad).
        lower, upper: the limit.
        proved_lower, proved_upper: interval that holds the quantity at every time.
        margin: smaller distance from the proved interval to the limit; negative if it is not met.
        method: how it was proved.
    """

    axis: str
    quantity: str
    lower: float
    upper: float
    proved_lower: float
    proved_upper: float
    margin: float
    method: str

    @property
    def use(self) -> float:
        """Fraction of the limit that is used, 1 where it is touched."""
        half = 0.5 * (self.upper - self.lower)
        return 1.0 - self.margin / half if half > 0.0 else np.inf


@dataclass(frozen=True)
class Certificate:
    """All limits of a trajectory, and rest at both ends.

    Attributes:
        rows: one proof per axis and quantity.
        end_speed: largest |qd| at the two ends as a fraction of the velocity limit.
        rest_needed: whether rest at both ends is one of the limits; a flight may start in motion.
    """

    rows: tuple[LimitProof, ...]
    end_speed: float
    rest_needed: bool = True

    @property
    def at_rest(self) -> bool:
        """Whether the trajectory starts and ends at rest."""
        return self.end_speed <= REST_TOLERANCE

    @property
    def ok(self) -> bool:
        """Whether every limit is proved, and rest at both ends where it is needed."""
        return (self.at_rest or not self.rest_needed) and all(row.margin >= 0.0 for row in self.rows)

    @property
    def worst(self) -> LimitProof:
        """The limit used most."""
        return max(self.rows, key=lambda row: row.use)

    def active(self, tolerance: float = 0.01) -> tuple[tuple[str, str], ...]:
        """(joint, quantity) of every limit that is used to within `tolerance` of its half width."""
        return tuple((row.axis, row.quantity) for row in self.rows if row.use >= 1.0 - tolerance)

    def to_json(self) -> str:
        """The certificate as JSON text."""
        rows = [asdict(row) for row in self.rows]
        content = {"ok": self.ok, "at_rest": self.at_rest, "end_speed": self.end_speed, "rows": rows}
        return json.dumps(content, indent=1) + "\n"


def certify(
    trajectory: Trajectory,
    spec: RobotSpec,
    *,
    method: Method = "riesz",
    box: tuple[Array, Array] | None = None,
) -> Certificate:
    """Prove the limits of `spec` for all times.

    Args:
        trajectory: a FourierTrajectory or PointToPoint.
        spec: the robot.
        method: for Fourier series, "riesz" (a bound from samples that holds at every time) or "roots" (exact
            extremes of the series from the roots of its derivative, to rounding).
        box: optional (lower, upper), each (dof,), a tighter region for the positions.

    Raises:
        UsageError: another number of joints, or a kind of trajectory without a certificate.
    """
    if trajectory.dof != spec.dof:
        raise UsageError(
            f"the trajectory moves {trajectory.dof} joints, the robot '{spec.name}' has {spec.dof}"
        )
    if isinstance(trajectory, FourierTrajectory):
        ranges, how = _fourier_ranges(trajectory, method)
    elif isinstance(trajectory, PointToPoint):
        ranges, how = _move_ranges(trajectory), "quintic extremes, exact"
    else:
        raise UsageError(f"there is no certificate for a {type(trajectory).__name__}")
    limits = [
        ("position", spec.lower, spec.upper),
        ("velocity", -spec.velocity, spec.velocity),
        ("acceleration", -spec.acceleration, spec.acceleration),
    ]
    if box is not None:
        limits.append(("box", np.asarray(box[0], dtype=float), np.asarray(box[1], dtype=float)))
        ranges["box"] = ranges["position"]
    rows = tuple(
        _proof(name, quantity, (low[j], high[j]), (ranges[quantity][0][j], ranges[quantity][1][j]), how)
        for j, name in enumerate(spec.names)
        for quantity, low, high in limits
    )
    ends = trajectory.sample(np.array([0.0, trajectory.duration])).qd
    return Certificate(rows, float(np.max(np.abs(ends) / spec.velocity)))


def certify_bytes(data: bytes, spec: RobotSpec) -> Certificate:
    """Certificate of the trajectory in a file's bytes, exactly as they were or will be written."""
    return certify(from_json(data), spec)


def require_certified(
    trajectory: Trajectory, spec: RobotSpec, *, box: tuple[Array, Array] | None = None
) -> Certificate:
    """The certificate, if every limit is proved.

    Raises:
        UnsafeTrajectoryError: names the joint, the quantity, the limit and the proved value.
    """
    certificate = certify(trajectory, spec, box=box)
    if certificate.ok:
        return certificate
    row = certificate.worst
    if row.margin < 0.0:
        over = (
            row.proved_upper
            if row.proved_upper - row.upper > row.lower - row.proved_lower
            else row.proved_lower
        )
        raise UnsafeTrajectoryError(
            f"{row.quantity} of joint '{row.axis}' may reach {over:.6g}, outside its limit "
            f"{row.lower:.6g}..{row.upper:.6g}",
            where=f"joint {row.axis}, {row.quantity}",
            next_step="Scale the trajectory down, or choose another one.",
        )
    raise UnsafeTrajectoryError(
        f"the trajectory starts or ends at {certificate.end_speed:.3g} of a velocity limit, not at rest",
        next_step="Use coefficients that start at rest and a whole number of periods, or a phase ramp.",
    )


def _proof(
    axis: str, quantity: str, limit: tuple[float, float], proved: tuple[float, float], method: str
) -> LimitProof:
    margin = min(limit[1] - proved[1], proved[0] - limit[0])
    low, high, at_least, at_most, spare = (float(x) for x in (*limit, *proved, margin))
    return LimitProof(axis, quantity, low, high, at_least, at_most, spare, method)


def _fourier_ranges(trajectory: FourierTrajectory, method: Method) -> tuple[Ranges, str]:
    ranges = series_ranges(trajectory.coefficients, trajectory.omega0, method)
    how = f"Riesz bound from {OVERSAMPLING} samples per harmonic" if method == "riesz" else "roots, exact"
    if trajectory.ramp > 0.0:
        # On the ramp qdd = p'' S^2 + p' S'/Tr with 0 <= S <= 1 and |S'| <= 15/8; off it qdd = p''.
        low, high = ranges["velocity"]
        extra = PEAK_RATE / trajectory.ramp * np.maximum(-low, high)
        ranges["acceleration"] = (ranges["acceleration"][0] - extra, ranges["acceleration"][1] + extra)
        how += ", plus phase ramp"
    return ranges, how


def series_ranges(
    coefficients: Array, omega0: float, method: Method = "riesz", oversampling: int = OVERSAMPLING
) -> Ranges:
    """Proved intervals (lower (dof,), upper (dof,)) of a series' position, velocity and acceleration."""
    harmonics = (len(coefficients) - 1) // 2
    if method == "roots":
        return _root_ranges(coefficients, omega0, harmonics)
    if method != "riesz":
        raise UsageError(f"the method of a certificate is 'riesz' or 'roots', not {method!r}")
    angles, kappa = grid(harmonics, oversampling)
    names = ("position", "velocity", "acceleration")
    return {
        name: riesz_range(rows @ coefficients, kappa, np.abs(rows).max(axis=0) @ np.abs(coefficients))
        for name, rows in zip(names, series(angles, harmonics, omega0)[:3], strict=True)
    }


def _root_ranges(coefficients: Array, omega0: float, harmonics: int) -> Ranges:
    w = omega0 * np.arange(1, harmonics + 1)[:, None]
    a, b = coefficients[1 : harmonics + 1], coefficients[harmonics + 1 :]
    zero = np.zeros(coefficients.shape[1])
    terms = {
        "position": (coefficients[0], -b / w, a / w),
        "velocity": (zero, a, b),
        "acceleration": (zero, b * w, -a * w),
    }
    ranges: Ranges = {}
    for name, (constant, cosine, sine) in terms.items():
        pairs = [exact_range(float(constant[j]), cosine[:, j], sine[:, j]) for j in range(len(zero))]
        low, high = np.array(pairs).T
        ranges[name] = (low, high)
    return ranges


def _move_ranges(moves: PointToPoint) -> Ranges:
    times = np.where(moves.times > 0.0, moves.times, 1.0)[:, None]
    step = np.diff(moves.waypoints, axis=0)
    speed = PEAK_VELOCITY * step / times
    bend = np.abs(PEAK_ACCELERATION * step / times**2).max(axis=0)
    zero = np.zeros(moves.dof)
    return {
        "position": (moves.waypoints.min(axis=0), moves.waypoints.max(axis=0)),
        "velocity": (np.minimum(speed.min(axis=0), zero), np.maximum(speed.max(axis=0), zero)),
        "acceleration": (-bend, bend),
    }
