"""What leaves for the robot: exact coefficients, a table at the robot's rate, and the certificate of both."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.spec import RobotSpec
from etude.storage import write_atomic
from etude.trajectories.certificate import Certificate, certify_bytes, require_certified
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint
from etude.trajectories.trajectory_file import from_json

Array = NDArray[np.float64]
COEFFICIENTS, TABLE, CERTIFICATE = "trajectory.json", "trajectory.csv", "certificate.json"
SPEEDS = (25, 50, 100)
"""Per cent: the ladder on which a motion is tried for the first time."""


@dataclass(frozen=True)
class TrajectoryFiles:
    """The bytes of one trajectory's files, certified as they are.

    Attributes:
        trajectory: what `coefficients` says.
        certificate: proved from `coefficients`, not from the object they were made of.
        coefficients, table, proof: contents of trajectory.json, trajectory.csv and certificate.json.
    """

    trajectory: FourierTrajectory | PointToPoint
    certificate: Certificate
    coefficients: bytes
    table: bytes
    proof: bytes

    def write(self, folder: Path) -> list[Path]:
        """Writes the three files, the certificate last; returns their paths."""
        contents = {COEFFICIENTS: self.coefficients, TABLE: self.table, CERTIFICATE: self.proof}
        for name, data in contents.items():
            write_atomic(folder / name, data)
        return [folder / name for name in contents]


def render(trajectory: FourierTrajectory | PointToPoint, spec: RobotSpec) -> TrajectoryFiles:
    """The files of a trajectory, verified from their own bytes.

    Raises:
        UnsafeTrajectoryError: a limit is not proved; there is then nothing to write.
    """
    coefficients = trajectory.to_json().encode()
    written = from_json(coefficients)
    require_certified(written, spec)
    certificate = certify_bytes(coefficients, spec)
    table = csv_bytes(written, spec)
    _check_table(table, spec)
    proof = {"trajectory": COEFFICIENTS, "robot": spec.name, **json.loads(certificate.to_json())}
    text = json.dumps(proof, indent=1) + "\n"
    return TrajectoryFiles(written, certificate, coefficients, table, text.encode())


def csv_bytes(trajectory: FourierTrajectory | PointToPoint, spec: RobotSpec) -> bytes:
    """`time, q_<axis>.., qd_<axis>.., qdd_<axis>..` at the robot's rate; every float reads back exactly."""
    count = math.floor(trajectory.duration * spec.rate + 1e-9) + 1
    samples = trajectory.sample(np.arange(count) / spec.rate)
    header = ["time", *(f"{kind}_{name}" for kind in ("q", "qd", "qdd") for name in spec.names)]
    rows = np.column_stack([samples.t, samples.q, samples.qd, samples.qdd])
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows.tolist())]
    return ("\n".join(lines) + "\n").encode()


def read_table(data: bytes) -> tuple[list[str], Array]:
    """Header and numbers of a table that `csv_bytes` made."""
    header, *lines = data.decode().splitlines()
    return header.split(","), np.array([[float(cell) for cell in line.split(",")] for line in lines])


def at_speed(trajectory: FourierTrajectory, per_cent: float) -> FourierTrajectory:
    """The same path run at a fraction of the speed: q(t s), with s = per_cent / 100.

    In the product form of thesis (3.5) the coefficients a, b and omega0 scale with s, times with 1/s.

    Raises:
        UsageError: the speed is not above 0 and at most 100 %, or the trajectory is not a Fourier series.
    """
    if not isinstance(trajectory, FourierTrajectory):
        raise UsageError("only Fourier trajectories have a speed ladder")
    if not 0 < per_cent <= 100:
        raise UsageError(f"the speed must be above 0 and at most 100 per cent, not {per_cent}")
    s = per_cent / 100
    coefficients = trajectory.coefficients.copy()
    coefficients[1:] *= s
    return replace(
        trajectory,
        coefficients=coefficients,
        omega0=trajectory.omega0 * s,
        duration=trajectory.duration / s,
        ramp=trajectory.ramp / s,
    )


def _check_table(table: bytes, spec: RobotSpec) -> None:
    """Reads the table back and holds every row against the limits; the coefficients are proved elsewhere."""
    _, rows = read_table(table)
    q, qd, qdd = np.split(rows[:, 1:], 3, axis=1)
    low = np.concatenate([spec.lower, -spec.velocity, -spec.acceleration])
    high = np.concatenate([spec.upper, spec.velocity, spec.acceleration])
    values = np.hstack([q, qd, qdd])
    outside = (values < low) | (values > high)
    if bool(outside.any()) or not bool(np.isfinite(values).all()):
        row = int(np.flatnonzero(outside.any(axis=1))[0]) if outside.any() else 0
        raise UnsafeTrajectoryError(
            f"row {row + 2} of the table leaves the limits of '{spec.name}'", where=TABLE
        )
