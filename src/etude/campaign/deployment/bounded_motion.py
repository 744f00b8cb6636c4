"""The motion that a model is exported along, and what it may not exceed."""

from __future__ import annotations

from pathlib import Path

from etude.campaign.propose.tracking import kept_now, kept_under
from etude.campaign.record.controls import LEARNED
from etude.campaign.record.folder import Campaign
from etude.campaign.record.proposals import stored_trajectory
from etude.deploy.along import Bounded
from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.json_text import from_json


def bounded_motion(campaign: Campaign, motion: str | Path | Trajectory | None) -> Bounded:
    """A motion with its limits, less the margins of tracking with the learned feedforward.

    Args:
        motion: a trajectory.json, or it read; None: the newest proposal.

    Raises:
        UsageError: no such file, none was proposed, or its file was changed.
    """
    return _proposed(campaign) if motion is None else _given(campaign, motion)


def _given(campaign: Campaign, motion: str | Path | Trajectory) -> Bounded:
    if isinstance(motion, str | Path):
        place = Path(motion)
        if not place.is_file():
            raise UsageError("there is no such motion", where=str(place), next_step="Check the path.")
        try:
            motion = from_json(place.read_bytes())
        except UsageError as problem:
            raise UsageError(
                problem.fact,
                where=str(place),
                next_step="Name a trajectory.json: those in proposals/NUMBER hold the motion's coefficients, "
                "tables (CSV) do not.",
            ) from None
    kept = kept_now(campaign, campaign.state(), LEARNED)
    return Bounded(motion, kept.limits_as_played(campaign, motion), kept.control)


def _proposed(campaign: Campaign) -> Bounded:
    """The newest proposal, whether its log was told or not."""
    asked = [own for _, own in sorted(campaign.state().rounds.items()) if own.asked is not None]
    if not asked:
        raise UsageError(
            "nothing was proposed yet", where=str(campaign.path), next_step="--set motion=trajectory.json"
        )
    newest = asked[-1]
    motion = stored_trajectory(campaign, newest.number)
    kept = kept_under(campaign, newest.number, LEARNED)
    return Bounded(motion, kept.limits_as_played(campaign, motion, described=True), kept.control)
