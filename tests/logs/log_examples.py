"""A small robot, motions of it, and files made from them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from etude.logs.log import RobotLog
from etude.robots.spec import Axis, RobotSpec
from etude.trajectories.samples import TrajectorySamples

Array = NDArray[np.float64]

SPEC = RobotSpec(
    "arm",
    (
        Axis("pan_joint", -1.0, 1.0, 2.0, 8.0, 40.0),
        Axis("lift_joint", -2.0, 1.0, 2.0, 8.0, 60.0),
        Axis("elbow_joint", -1.5, 1.5, 3.0, 9.0, 20.0),
    ),
    "N m",
    100.0,
)


@dataclass(frozen=True)
class Sines:
    """Each joint a sum of two sines at rest at both ends, as a Trajectory."""

    frequencies: tuple[float, ...] = (0.2, 0.3, 0.35)
    amplitudes: tuple[float, ...] = (0.8, 0.7, 0.9)
    duration: float = 20.0

    @property
    def dof(self) -> int:
        return len(self.frequencies)

    def sample(self, t: Array) -> TrajectorySamples:
        omega = 2 * np.pi * np.array(self.frequencies)
        phase = np.clip(t, 0.0, self.duration)[:, None] * omega
        size = np.array(self.amplitudes)
        q = size * (np.sin(phase) - np.sin(2 * phase) / 2) / 1.3
        qd = size * omega * (np.cos(phase) - np.cos(2 * phase)) / 1.3
        qdd = size * omega**2 * (-np.sin(phase) + 2 * np.sin(2 * phase)) / 1.3
        qddd = size * omega**3 * (-np.cos(phase) + 4 * np.cos(2 * phase)) / 1.3
        return TrajectorySamples(np.asarray(t), q, qd, qdd, qddd)


MOTION = Sines()


def make_log(
    motion: Sines = MOTION, rate: float = 100.0, noise: float = 1e-4, start: float = 0.0
) -> RobotLog:
    """A log of the motion: position with white noise, command of a damped mass."""
    rng = np.random.default_rng(0)
    t = start + np.arange(0.0, motion.duration - start, 1.0 / rate)
    samples = motion.sample(t)
    tau = 0.5 * samples.qdd + 3.0 * samples.qd + 5.0 * samples.q
    return RobotLog(
        SPEC.names,
        SPEC.command_unit,
        t,
        samples.q + noise * rng.standard_normal(samples.q.shape),
        tau,
        source="log",
    )


def columns_of(log: RobotLog, pattern: str = "{channel}_{joint}") -> dict[str, Array]:
    """Header -> column, of t, q and tau."""
    columns = {"t": log.t}
    for channel, values in (("q", log.q), ("tau", log.tau)):
        for j, joint in enumerate(log.names):
            columns[pattern.format(channel=channel, joint=joint)] = values[:, j]
    return columns


def write_csv(path: Path, columns: dict[str, Array], separator: str = ",") -> Path:
    """The columns as CSV with every digit."""
    rows = np.column_stack(list(columns.values()))
    lines = [separator.join(columns), *(separator.join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path
