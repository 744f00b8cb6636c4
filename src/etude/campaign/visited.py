"""What a campaign's motions have visited of where its robot can be."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from etude.campaign.folder import Campaign
from etude.campaign.motions import segments_of
from etude.campaign.proposals import FULL, stored_trajectory
from etude.contracts import Family, Reachable, Trajectory
from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.design.coverage import Visited
    from etude.design.roaming import Roam


def reachable(campaign: Campaign) -> Reachable | None:
    """Where the robot can be; None of kinds that do not know."""
    asked = getattr(campaign.kind, "reachable", None)
    return None if asked is None else asked(campaign.spec)


def roam_of(campaign: Campaign, family: Family, open_ones: Sequence[Trajectory]) -> Roam | None:
    """Where the next motion is looked for; None where nothing has to be kept clear of.

    Args:
        campaign: the folder. family: of its segments.
        open_ones: proposals that wait for their logs.
    """
    from etude.design.roaming import Roam

    reach = reachable(campaign)
    if reach is None or not len(reach.poses):
        return None
    visited = visited_by(campaign, reach).adding(open_ones)
    segment = family.trajectory(np.zeros(family.size)).duration
    return Roam(reach, visited, visited.total + segments_of(campaign, family) * segment)


def visited_by(campaign: Campaign, reach: Reachable) -> Visited:
    """What motions with a log have visited, as they were planned; of foreign logs the log itself."""
    from etude.design.coverage import Visited

    found = Visited.nothing(reach)
    for told in campaign.state().told:
        if told.asked is not None and not (told.told or {}).get("foreign", False):
            with contextlib.suppress(UsageError):
                found = found.adding([stored_trajectory(campaign, told.number, FULL)])
            continue
        with contextlib.suppress(UsageError):
            from etude.logs.log_file import read_log_file

            log = read_log_file(campaign.run_file(told.number))
            found = found.adding_poses(log[campaign.kind.path], float(np.ptp(log.t)))
    return found
