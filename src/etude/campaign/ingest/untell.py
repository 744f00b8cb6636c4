"""untell and abandon: a log taken back; a trajectory whose log will never come or must not be used."""

from __future__ import annotations

from etude.campaign.learn.training import Learner, learn_pending
from etude.campaign.record.events import Abandoned, Untold
from etude.campaign.record.folder import Campaign, Say
from etude.errors import UsageError


def untell(
    campaign: Campaign, number: int, *, learner: Learner | None = None, say: Say = lambda _: None
) -> bool:
    """Takes the log of `number` back: an event, nothing is deleted, and the model is trained without it.

    A proposal waits for its log again; `abandon` gives it up instead. Told again, the log is taken in as if
    it had never been told. False if it was taken back before.

    Raises:
        UsageError: there is no such number, or no log of it was told.
        DataError, NumericalError: the logs that are left cannot be learned together; they wait.
    """
    with campaign.writing():
        before = campaign.round(number)
        if before.told is None and not before.untold:
            raise UsageError(
                f"no log of trajectory {number} was told",
                where=str(campaign.path),
                next_step=f"To give the trajectory up: etude abandon {campaign.path} {number}.",
            )
        if before.told is not None:
            campaign.commit(Untold(sha256=before.told.sha256), number)
        learn_pending(campaign, learner, say)
        return before.told is not None


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
            campaign.commit(Abandoned(had_log=before.told is not None), number)
        learn_pending(campaign, learner, say)
        return not before.abandoned
