"""Proposal as a motion in space: parts of the robot, its surroundings, and the distances between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from etude.abilities import SupportsNearby, SupportsSolids
from etude.report.record import Facts, Record
from etude.report.scene import Path, figure_along, room_of, things_of
from etude.types import Array, Figure, Mask, Motion, Nearby, Solid, Thing

if TYPE_CHECKING:
    from etude.campaign.record.folder import Campaign
    from etude.protocols import Trajectory


RATE, MOST_FRAMES = 25.0, 2000
"""Hz of the poses that are stored, between which a browser turns and moves straight on, and how many at most:
a point 1 m out at 3 rad/s is then within 2 mm of where it is."""
LINES, ASKED = 3, 8
"""Distances that are drawn at a time, and that are asked for: some are left out."""
STILL_M, ROOM_M = 0.003, 0.02
"""m by which a distance varies at most, and m that are left of it at least, to be left out: a shoulder turns
above its floor."""
SMALLEST = 0.1
"""Part of the motion's extent that a robot is drawn with at least, where nobody looks at its distances."""
RING = 48  # corners of a round room


@dataclass(frozen=True, eq=False)
class Replay:
    """A log at the times of its motion.

    A vehicle is drawn level, because a log has its position alone.

    Attributes:
        q: (T, k) rad or m. placed: (T, B, 3, 4) frames of parts, m. points: (T, P, 3) of sticks, m.
        ends: start and end of the log, s.
    """

    q: Array
    placed: Array
    points: Array
    ends: tuple[float, float]


@dataclass(frozen=True, eq=False)
class MotionInSpace:
    """A motion to be shown.

    Attributes:
        title: of the motion. folder: of its files. pieces: start of each, s, and its label.
        certificate: of the shown file; None if it cannot be read. proved_from: start of that file, s.
        t: (T,) s. motion: at these times.
        solids: B parts. placed: (T, B, 3, 4) their frames, m.
        figure: as sticks, with the surroundings.
        nearby: distances at the same times; None for robots without a distance limit.
        measured: the log of the motion; None without one.
    """

    title: str
    folder: str
    pieces: Sequence[tuple[float, str]]
    certificate: Facts | None
    t: Array
    motion: Motion
    solids: Sequence[Solid]
    placed: Array
    figure: Figure
    nearby: Nearby | None
    measured: Replay | None
    proved_from: float = 0.0

    @property
    def tips(self) -> list[Array]:
        """Paths of the tips, (T, 3) m each."""
        return [self.figure.points[:, tip] for tip in self.figure.tips]

    @cached_property
    def silent(self) -> Mask:
        """Mask (R,) of rows that are not shown: neighbours, which always pass closely, and constant large
        distances.
        """
        near = self.nearby
        assert near is not None
        still = (np.ptp(near.distance, axis=0) < STILL_M) & ((near.distance - near.kept).min(axis=0) > ROOM_M)
        return np.asarray(near.neighbours | still)

    @property
    def enlarged(self) -> int:
        """Factor by which a small robot is enlarged, so that it is visible along its path."""
        if self.nearby is not None or len(self.solids) != 1:
            return 1
        extent = np.linalg.norm(np.ptp(self.placed[:, 0, :, 3], axis=0))
        return max(1, round(SMALLEST * float(extent) / float(np.ptp(self.solids[0].points, axis=0).max())))

    @property
    def closest(self) -> tuple[int, int] | None:
        """Time step and row of the least distance beyond its margin, without neighbours; None without such a
        row.
        """
        near = self.nearby
        if near is None or self.silent.all():
            return None
        slack = np.where(self.silent, np.inf, near.distance - near.kept)
        k, row = np.unravel_index(int(slack.argmin()), slack.shape)
        return int(k), int(row)

    @property
    def nearest(self) -> Facts | None:
        """The least distance in figures: the pair, its distance and margin in m, the time in s."""
        if self.closest is None or self.nearby is None:
            return None
        (k, row), near = self.closest, self.nearby
        apart, margin = float(near.distance[k, row]), float(near.kept[row])
        return {"pair": list(near.pairs[row]), "distance": apart, "kept": margin, "time": float(self.t[k])}


def in_space(record: Record, proposal: int, approach: Trajectory | None = None) -> MotionInSpace | None:
    """The motion of a proposal, with its approach and return if requested; None without a drawing. With an
    `approach`, this one precedes the motion instead.
    """
    trajectory, certificate, folder = record.whole(proposal, approach)
    campaign = record.campaign
    if trajectory is None or campaign is None:
        return None
    count = int(min(MOST_FRAMES, max(2, np.ceil(trajectory.duration * RATE) + 1)))
    t = np.linspace(0.0, trajectory.duration, count)
    motion = trajectory.motion(t, 2)
    solids, placed = placed_parts(campaign, motion)
    figure = figure_along(record, motion.orders[0])
    if figure is None and not solids:
        return None
    figure = figure or _of_point(record, t, placed[:, -1, :, 3])
    nearby = [
        limit.nearby(motion.orders[0], ASKED) for limit in record.limits if isinstance(limit, SupportsNearby)
    ]
    pieces = [(start, label) for start, label, _ in trajectory.pieces()]
    pose = folder.partition("from_")[2]
    title = f"trajectory {proposal}" + (f" with approach from and return to {pose}" if pose else "")
    title += " with the approach from the current pose" if approach is not None else ""
    began = 0.0 if approach is None else approach.duration
    replay, near = _replay(record, proposal, t, pieces), nearby[0] if nearby else None
    shown = solids, placed, figure
    return MotionInSpace(title, folder, pieces, certificate, t, motion, *shown, near, replay, began)


def placed_parts(campaign: Campaign, motion: Motion) -> tuple[Sequence[Solid], Array]:
    """The B solid parts, possibly none, and their frames (T, B, 3, 4) m."""
    kind, none = campaign.kind, np.zeros((motion.orders.shape[1], 0, 3, 4))
    if not isinstance(kind, SupportsSolids):
        return (), none
    solids = kind.solids(campaign.spec)
    return solids, kind.placed(campaign.spec, motion) if solids else none


def _replay(record: Record, proposal: int, t: Array, pieces: Sequence[tuple[float, str]]) -> Replay | None:
    """The log of a proposal at times (T,) s of the motion with its approach; None without one."""
    entry, path = record.state.rounds[proposal], record.path
    log = record.log(proposal) if entry.ingested is not None and not entry.untold else None
    if (
        log is None
        or path is None
        or path.name not in log
        or entry.ingested is None
        or record.campaign is None
    ):
        return None
    start = min((begun for begun, label in pieces if label != "approach"), default=0.0)
    factor = 0.01 * entry.ingested.speed
    inside = start + factor * log.t
    q = np.stack([np.interp(t, inside, column) for column in log[path.name].T], axis=1)
    placed = placed_parts(record.campaign, Motion(t, q[None]))[1]
    figure = figure_along(record, q)
    points = figure.points if figure is not None else np.zeros((len(t), 0, 3))
    return Replay(q, placed, points, (max(0.0, float(inside[0])), float(inside[-1])))


def _of_point(record: Record, t: Array, place: Array) -> Figure:
    """A point that moves in a room (T, 3) m, with the room."""
    room = room_of(record.limits, [Path(t, place)])
    things = [replace(Thing.box("room", room.lower, room.upper), kind="inside"), *things_of(record.limits)]
    if room.radius is not None:
        turn = 2.0 * np.pi * np.arange(RING) / RING
        ring = room.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        points = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (room.lower[2], room.upper[2])])
        rings = tuple(range(RING)), tuple(range(RING, 2 * RING))
        things.append(Thing("cylinder", "inside", points[None], rings))
    things.append(Thing.plane("bottom of the room", [0.0, 0.0, room.lower[2]], [0.0, 0.0, 1.0]))
    return Figure(place[:, None], np.zeros((0, 2), dtype=np.int64), (0,), tuple(things))
