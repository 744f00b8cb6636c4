"""Task motions: what the robot will do with the model, so that trajectories are designed for that."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import Trajectory, TrajectorySamples
from etude.trajectories.trajectory_file import from_json

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A motion given by samples, made continuous by a cubic spline (implements `Trajectory`)."""

    t: Array
    spline: Any

    @property
    def dof(self) -> int:
        return int(self.spline.c.shape[2])

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])

    def sample(self, t: Array) -> TrajectorySamples:
        """Positions and the spline's derivatives at t (T,) s from the motion's start; at rest outside it."""
        inside = np.clip(t, 0.0, self.duration) + self.t[0]
        moving = ((t >= 0.0) & (t <= self.duration))[:, None]
        q, *rates = (self.spline(inside, order) for order in range(4))
        return TrajectorySamples(np.asarray(t), q, *(np.where(moving, rate, 0.0) for rate in rates))


def load_tasks(path: Path, spec: RobotSpec) -> tuple[Trajectory, ...]:
    """The motions of a file: a trajectory.json of Étude, or a table with a time and q_<axis> columns.

    Raises:
        UsageError: no such file, another robot's, or not a motion.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"the task file cannot be read: {error.strerror}", where=str(path)) from None
    motion: Trajectory = from_json(data) if path.suffix == ".json" else _from_table(data, path, spec)
    if motion.dof != spec.dof:
        raise UsageError(f"the task moves {motion.dof} joints, the robot has {spec.dof}", where=str(path))
    return (motion,)


def _from_table(data: bytes, path: Path, spec: RobotSpec) -> RecordedMotion:
    from scipy.interpolate import CubicSpline

    lines = [line.split(",") for line in data.decode(errors="replace").split("\n") if line.strip()]
    header = [cell.strip() for cell in lines[0]] if lines else []
    wanted = ["time", *(f"q_{name}" for name in spec.names)]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise UsageError(
            f"the task table has no column {', '.join(missing)}",
            where=str(path),
            next_step=f"It needs the columns {', '.join(wanted)}.",
        )
    try:
        rows = np.array([[float(line[header.index(name)]) for name in wanted] for line in lines[1:]])
    except (ValueError, IndexError):
        raise UsageError("a cell of the task table is not a number", where=str(path)) from None
    if len(rows) < 4 or not np.isfinite(rows).all() or not np.all(np.diff(rows[:, 0]) > 0):
        raise UsageError("a task needs 4 finite rows or more, with increasing time", where=str(path))
    return RecordedMotion(rows[:, 0], CubicSpline(rows[:, 0], rows[:, 1:]))
