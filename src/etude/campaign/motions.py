"""Random motions of a campaign: to begin with, and to say where a model will be asked."""

from __future__ import annotations

import numpy as np

from etude.campaign.folder import Campaign
from etude.contracts import Trajectory


def typical_motions(
    campaign: Campaign, rng: np.random.Generator, count: int, *, grown: bool = False
) -> list[Trajectory]:
    """Random trajectories inside the limits, as large as these allow.

    Args:
        campaign: whose. rng: source. count: of them.
        grown: enlarge each part again after what is not convex has taken its share: for motions to be run.

    Raises:
        UnsafeTrajectoryError: the limits leave no room.
    """
    from etude.design.candidates import Source

    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    family, home = kind.family(spec, config), kind.home(spec)
    source = Source(family, tuple(campaign.limits()), home, config.design.sampler)
    return [drawn.trajectory for drawn in source.typical(rng, count, grown=grown)]
