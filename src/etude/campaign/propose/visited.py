"""What a campaign's motions have visited of where its robot can be."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.campaign.propose.motions import segments_of
from etude.campaign.record.folder import Campaign
from etude.campaign.record.proposals import FULL, stored_trajectory
from etude.errors import UsageError
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array, Reachable

if TYPE_CHECKING:
    from etude.design.pose_candidates import Roam, Visited


SMALL = 0.1
"""Of each axis's range: where no axis sweeps more, a motion teaches hardly anything."""
WHOLE = 0.95
"""Of a range: nothing is missing from it."""
LOOKED_AT = 400
"""Instants of each segment."""
AHEAD = (0.1, 0.3, 0.6, 1.0)
"""Parts of what is left of a range at which it is asked what stands there."""
NO_TIME = "nothing: its time is over"


@dataclass(frozen=True)
class Swept:
    """What the segments of a motion sweep of one axis, of 20 bins those with half a percent of their time.

    Attributes:
        axis: its name.
        of_range: part of its range, of a hinge one turn at most.
        of_clear: part of what lies between its extreme clear poses.
        held: what stands in the way where its way ends, on the side where more of the range is left.
    """

    axis: str
    of_range: float
    of_clear: float
    held: str


def swept(campaign: Campaign, trajectory: Trajectory, limits: Sequence[Limit]) -> tuple[Swept, ...]:
    """Of each axis; nothing of kinds that do not know where their robots can be, and of motions without
    segments.
    """
    from etude.design.pose_candidates import Visited

    reach = reachable(campaign)
    pieces = [piece for _, label, piece in trajectory.pieces() if label == "segment"]
    if reach is None or not pieces:
        return ()
    whole = replace(reach, poses=reach.poses[:0])
    of_range, of_clear = (Visited.nothing(own).adding([trajectory]).share() for own in (whole, reach))
    times = [piece.duration * np.linspace(0.0, 1.0, LOOKED_AT) for piece in pieces]
    way = np.concatenate([p.motion(t, 1).orders[0] for p, t in zip(pieces, times, strict=True)])
    held = [_held(reach, way, j, limits, pieces[0].form) for j in range(len(of_range))]
    rows = zip(campaign.axes, of_range.tolist(), of_clear.tolist(), held, strict=True)
    return tuple(Swept(axis, r, c, "" if r >= WHOLE else why) for axis, r, c, why in rows)


def _held(reach: Reachable, way: Array, j: int, limits: Sequence[Limit], form: str) -> str:
    """What the pose runs into at which an axis is farthest out, if it goes on by itself."""
    room = way[:, j].min() - reach.lower[j], reach.upper[j] - way[:, j].max()
    at = int(way[:, j].argmin() if room[0] > room[1] else way[:, j].argmax())
    end = reach.lower[j] if room[0] > room[1] else reach.upper[j]
    for part in AHEAD:
        pose = way[at].copy()
        pose[j] += part * (end - pose[j])
        for limit in limits:
            asked = getattr(limit, "blocked", None)
            if asked is not None and (found := asked(form, pose)):
                return str(found)
    return NO_TIME


def as_facts(rows: Sequence[Swept]) -> list[dict[str, Any]]:
    """For certificates and machines."""
    return [asdict(row) for row in rows]


def teaches_little(rows: Sequence[Swept]) -> tuple[str, ...]:
    """What is said first of a motion that goes nowhere."""
    if not rows or max(row.of_range for row in rows) > SMALL:
        return ()
    held = dict.fromkeys(row.held for row in rows if row.held and row.held != NO_TIME)
    why = f" In the way: {', '.join(held)}." if held else ""
    return (
        f"This motion teaches next to nothing: no joint sweeps more than "
        f"{100.0 * max(row.of_range for row in rows):.0f} % of its range.{why}",
    )


def reachable(campaign: Campaign) -> Reachable | None:
    """Where the robot can be; None of kinds that do not know."""
    asked = getattr(campaign.kind, "reachable", None)
    found: Reachable | None = None if asked is None else asked(campaign.spec)
    return found


def roam_of(campaign: Campaign, family: Family, open_ones: Sequence[Trajectory]) -> Roam | None:
    """Where the next motion is looked for; None where nothing has to be kept clear of.

    Args:
        campaign: the folder. family: of its segments.
        open_ones: proposals that wait for their logs.
    """
    from etude.design.pose_candidates import Roam

    reach = reachable(campaign)
    if reach is None or not len(reach.poses):
        return None
    visited = visited_by(campaign, reach).adding(open_ones)
    segment = family.trajectory(np.zeros(family.size)).duration
    return Roam(reach, visited, visited.total + segments_of(campaign, family) * segment)


def visited_by(campaign: Campaign, reach: Reachable) -> Visited:
    """What motions with a log have visited, as they were planned; of foreign logs the log itself."""
    from etude.design.pose_candidates import Visited

    found = Visited.nothing(reach)
    for told in campaign.state().told:
        if told.asked is not None and not (told.told or {}).get("foreign", False):
            with contextlib.suppress(UsageError):
                found = found.adding([stored_trajectory(campaign, told.number, FULL)])
            continue
        with contextlib.suppress(UsageError):
            from etude.logs.readers.log_file import read_log_file

            log = read_log_file(campaign.run_file(told.number))
            found = found.adding_poses(log[campaign.kind.path], float(np.ptp(log.t)))
    return found
