"""The files of a flight: exact coefficients, a table of set-points, and the certificate of both."""

from __future__ import annotations

import json
import math

import numpy as np
from numpy.typing import NDArray

from etude.deploy.trajectory_files import COEFFICIENTS, TABLE, TrajectoryFiles, read_table
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.robots.flight_spec import FlightSpec
from etude.robots.spec import RobotSpec
from etude.trajectories.flight.certificate import require_flight_certified
from etude.trajectories.flight.flatness import flat_motion
from etude.trajectories.flight.motion import motion_of
from etude.trajectories.fourier import FourierTrajectory

Array = NDArray[np.float64]
TABLE_RATE = 50.0
"""Hz of the table: what an autopilot takes set-points at."""
ROUNDING = 1e-9


def render_flight(trajectory: FourierTrajectory, spec: RobotSpec) -> TrajectoryFiles:
    """The files of a flight, verified from their own bytes.

    Raises:
        UnsafeTrajectoryError: a limit is not proved; there is then nothing to write.
        UsageError: the robot does not fly.
    """
    if spec.flight is None:
        raise UsageError(f"'{spec.name}' does not fly")
    coefficients = trajectory.to_json().encode()
    written = FourierTrajectory.from_json(coefficients)
    certificate = require_flight_certified(written, spec.flight)
    table = flight_csv(written)
    _check_table(table, spec.flight)
    proof = {"trajectory": COEFFICIENTS, "robot": spec.name, **json.loads(certificate.to_json())}
    return TrajectoryFiles(
        written, certificate, coefficients, table, (json.dumps(proof, indent=1) + "\n").encode()
    )


def flight_csv(trajectory: FourierTrajectory) -> bytes:
    """`time, x, y, z, vx .., ax .., roll, pitch, yaw, wx .., thrust` at `TABLE_RATE`: SI, thrust per mass.

    Attitude, rates and thrust are those of a vehicle without drag, heading 0; floats read back exactly.
    """
    from scipy.spatial.transform import Rotation

    count = math.floor(trajectory.duration * TABLE_RATE + ROUNDING) + 1
    motion = motion_of(trajectory, np.minimum(np.arange(count) / TABLE_RATE, trajectory.duration))
    flat = flat_motion(motion)
    yaw, pitch, roll = Rotation.from_matrix(flat.R_world_body).as_euler("ZYX").T
    rows = [motion.t, *motion.position.T, *motion.velocity.T, *motion.acceleration.T]
    rows += [roll, pitch, yaw, *flat.states.rates.T, flat.thrust]
    names = ["time", *(f"{p}{a}" for p in ("", "v", "a") for a in "xyz")]
    names += ["roll", "pitch", "yaw", "wx", "wy", "wz", "thrust"]
    lines = [",".join(names), *(",".join(map(repr, row)) for row in np.stack(rows, axis=1).tolist())]
    return ("\n".join(lines) + "\n").encode()


def _check_table(table: bytes, spec: FlightSpec) -> None:
    """Reads the table back and holds every row against box and speed; the proof is of the coefficients."""
    names, rows = read_table(table)
    place = {name: rows[:, j] for j, name in enumerate(names)}
    position = np.stack([place[a] for a in "xyz"], axis=1)
    speed = np.linalg.norm(np.stack([place[f"v{a}"] for a in "xyz"], axis=1), axis=1)
    inside = (position >= np.array(spec.lower)).all(axis=1) & (position <= np.array(spec.upper)).all(axis=1)
    good = inside & (speed <= spec.speed * (1.0 + ROUNDING)) & np.isfinite(rows).all(axis=1)
    if not good.all():
        row = int(np.flatnonzero(~good)[0])
        raise UnsafeTrajectoryError(
            f"row {row + 2} of the table leaves the limits of '{spec.name}'", where=TABLE
        )
