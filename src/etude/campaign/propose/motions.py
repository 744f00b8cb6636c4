"""Motions of a campaign: random ones, those that stand in for tasks, and how many make a recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.protocols import Family, Limit, Trajectory

if TYPE_CHECKING:
    from etude.design.chain import Ways


def typical_motions(
    campaign: Campaign,
    rng: np.random.Generator,
    count: int,
    limits: Sequence[Limit] | None = None,
    *,
    grown: bool = False,
) -> list[Trajectory]:
    """Random trajectories inside the limits, as large as these allow.

    Args:
        campaign: whose. rng: source. count: of them.
        limits: None: the robot's own, without margins.
        grown: enlarge each part again after what is not convex has taken its share: for motions to be run.

    Raises:
        UnsafeTrajectoryError: the limits leave no room.
    """
    from etude.design.candidates import Source

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    family, home = kind.family(spec, config), kind.home(spec)
    inside = tuple(campaign.limits() if limits is None else limits)
    source = Source(family, inside, home, config.design.sampler)
    return [drawn.trajectory for drawn in source.typical(rng, count, grown=grown)]


def reference_motions(campaign: Campaign, rng: np.random.Generator) -> list[Trajectory]:
    """Motions that stand in for tasks: of an arm as many moves between random postures as slow series.

    They are drawn as the tests of simulated campaigns are, and are others.
    """
    from etude.design.objective import MOTIONS

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    found: list[Trajectory] = []
    while len(found) < MOTIONS:
        drawn = kind.tests(spec, config, rng).values()
        if not drawn:
            break
        found += drawn
    return found


def segments_of(campaign: Campaign, family: Family) -> int:
    """How many segments of the family fill a recording; one where no way leads from one to the next."""
    segment = family.trajectory(np.zeros(family.size))
    count = max(1, round(campaign.config.duration / segment.duration))
    if count == 1:
        return 1
    home = campaign.kind.home(campaign.spec)
    return count if ways_of(campaign)(segment, home) is not None else 1


def from_rest(campaign: Campaign, motion: Trajectory, limits: Sequence[Limit]) -> Trajectory:
    """The motion as this robot is sent it: with a lead-in from rest and a lead-out to rest if it needs them.

    Raises:
        UnsafeTrajectoryError: none is proved.
    """
    from etude.limits.lead_ins import at_rest

    wanted = getattr(campaign.kind, "from_rest", None)  # protocols.SupportsLeadIn
    return at_rest(motion, limits) if wanted is not None and wanted(campaign.spec) else motion


def ways_of(campaign: Campaign) -> Ways:
    """The kind's ways to a motion and back."""
    return lambda motion, pose: campaign.kind.ways(campaign.spec, motion, pose)
