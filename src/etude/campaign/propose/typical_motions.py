"""Typical motions of a campaign: random ones and tasks, and the number of segments in a recording."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.abilities import SupportsLeadIn
from etude.campaign.record.folder import Campaign
from etude.deploy.trajectory_files import column_names
from etude.errors import UsageError
from etude.protocols import Family, Limit, Trajectory
from etude.trajectories.json_text import from_json
from etude.types import Array, Channel, Motion

if TYPE_CHECKING:
    from etude.design.chain_design import Approaches


def typical_motions(
    campaign: Campaign,
    rng: np.random.Generator,
    count: int,
    limits: Sequence[Limit] | None = None,
    *,
    grown: bool = False,
) -> list[Trajectory]:
    """Random trajectories as large as the limits allow.

    Args:
        campaign: the folder. rng: source of random numbers. count: of trajectories.
        limits: None: the robot's own, without margins.
        grown: enlarge each part again after limits that are not convex have shrunk it; for motions to be run.

    Raises:
        UnsafeTrajectoryError: the limits allow no motion.
    """
    from etude.design.candidates import Source

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    family, home = kind.family(spec, config), kind.home(spec)
    inside = tuple(campaign.limits() if limits is None else limits)
    source = Source(family, inside, home, config.design.sampler)
    return [drawn.trajectory for drawn in source.typical(rng, count, expanded=grown)]


def reference_motions(campaign: Campaign, rng: np.random.Generator) -> list[Trajectory]:
    """Motions that stand in for tasks: for an arm, as many moves between random postures as slow series.

    They have the same distribution as the tests of simulated campaigns, but other random numbers.
    """
    from etude.design.objective import MOTIONS

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    motions: list[Trajectory] = []
    while len(motions) < MOTIONS:
        drawn = kind.tests(spec, config, rng).values()
        if not drawn:
            break
        motions += drawn
    return motions


def segments_of(campaign: Campaign, family: Family) -> int:
    """Number of segments of the family that fill a recording; 1 if segments cannot be joined."""
    segment = family.trajectory(np.zeros(family.size))
    count = max(1, round(campaign.config.duration / segment.duration))
    if count == 1:
        return 1
    home = campaign.kind.home(campaign.spec)
    return count if approaches_of(campaign)(segment, home) is not None else 1


def from_rest(campaign: Campaign, motion: Trajectory, limits: Sequence[Limit]) -> Trajectory:
    """The motion as it is sent to the robot: with a lead-in from rest and a lead-out to rest where needed.

    Raises:
        UnsafeTrajectoryError: no lead-in or lead-out is proved.
    """
    from etude.limits.lead_ins import at_rest

    kind = campaign.kind
    needs_leads = isinstance(kind, SupportsLeadIn) and kind.from_rest(campaign.spec)
    return at_rest(motion, limits) if needs_leads else motion


def approaches_of(campaign: Campaign) -> Approaches:
    """The kind's approaches to a motion and returns from it."""
    return lambda motion, pose: campaign.kind.approaches(campaign.spec, motion, pose)


SMOOTH = 5
"""Degree of the spline: its fourth derivative, which inputs of vehicles look at, is still continuous."""


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A motion that samples give, made continuous by a spline; neither proved nor stored.

    Attributes:
        t: (n,) s.
        spline: of the path (k,) over t.
    """

    t: Array
    spline: Any

    @property
    def form(self) -> str:
        return "recorded"

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])

    def pieces(self) -> Sequence[tuple[float, str, Trajectory]]:
        return ((0.0, "segment", self),)

    def motion(self, t: Array, orders: int = 3) -> Motion:
        """Path and the spline's derivatives at t (T,) s from the motion's start; at rest outside it."""
        inside = np.clip(t, 0.0, self.duration) + self.t[0]
        moving = ((t >= 0.0) & (t <= self.duration))[:, None]
        path, *rates = (np.asarray(self.spline(inside, order)) for order in range(orders))
        return Motion(np.asarray(t), np.stack([path, *(np.where(moving, rate, 0.0) for rate in rates)]))

    def bound(self, order: int, degree: int) -> tuple[Array, Array, float]:  # noqa: ARG002
        raise UsageError("a recorded motion cannot be certified", next_step="Use it as a task only.")

    def slowed(self, factor: float) -> Trajectory:  # noqa: ARG002
        raise UsageError("a recorded motion cannot be slowed down", next_step="Use it as a task only.")

    def to_json(self) -> str:
        raise UsageError("a recorded motion cannot be stored", next_step="Use it as a task only.")


def load_tasks(path: Path, channel: Channel) -> tuple[Trajectory, ...]:
    """Motions in a file: a trajectory.json of Étude, or a table with a time and a column for each coordinate.

    Args:
        path: of the file.
        channel: the robot's path, with its coordinates.

    Raises:
        UsageError: the file is missing, is for another robot, or holds no motion.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"the task file cannot be read: {error.strerror}", where=str(path), next_step="Check the path."
        ) from None
    motion = from_json(data) if path.suffix == ".json" else _from_table(data, path, channel)
    axes = motion.motion(np.zeros(1), 1).orders.shape[2]
    if axes != len(channel.parts):
        raise UsageError(
            f"the task moves {axes} axes, the robot has {len(channel.parts)}",
            where=str(path),
            next_step="Give a motion of this robot.",
        )
    return (motion,)


def _from_table(data: bytes, path: Path, channel: Channel) -> RecordedMotion:
    from scipy.interpolate import make_interp_spline

    lines = [line for line in csv.reader(io.StringIO(data.decode(errors="replace"))) if any(line)]
    columns = ["time", *column_names(channel)]
    names = dict(zip(("t", *channel.parts), columns, strict=True))  # as `predict` reads them
    header = [names.get(cell.strip(), cell.strip()) for cell in lines[0]] if lines else []
    missing = [name for name in columns if name not in header]
    if missing:
        raise UsageError(
            f"the task table has no column {', '.join(missing)}",
            where=str(path),
            next_step=f"It needs the columns {', '.join(columns)}.",
        )
    try:
        rows = np.array([[float(line[header.index(name)]) for name in columns] for line in lines[1:]])
    except (ValueError, IndexError):
        raise UsageError(
            "a cell of the task table is not a number",
            where=str(path),
            next_step="Fill it, or leave its row out.",
        ) from None
    if len(rows) <= SMOOTH or not np.isfinite(rows).all() or not np.all(np.diff(rows[:, 0]) > 0):
        raise UsageError(
            f"a task needs at least {SMOOTH + 1} finite rows with increasing time",
            where=str(path),
            next_step="Leave out rows that repeat a time or have an empty cell.",
        )
    return RecordedMotion(rows[:, 0], make_interp_spline(rows[:, 0], rows[:, 1:], k=SMOOTH))
