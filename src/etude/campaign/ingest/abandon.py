"""abandon: a trajectory whose log will never come, or must not be used."""

from __future__ import annotations

from etude.campaign.learn.training import Learner, learn_pending
from etude.campaign.record.folder import Campaign, Say


def abandon(
    campaign: Campaign, number: int, *, learner: Learner | None = None, say: Say = lambda _: None
) -> bool:
    """Gives trajectory `number` up; a log that was learned is unlearned by training again without it.

    The files stay. Telling a log of it later takes the abandoning back. False if it was abandoned before.

    Raises:
        UsageError: there is no such trajectory.
    """
    with campaign.writing():
        before = campaign.round(number)
        if not before.abandoned:
            campaign.commit("abandoned", number, [], had_log=before.told is not None)
        learn_pending(campaign, learner, say)
        return not before.abandoned
