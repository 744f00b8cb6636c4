"""Learns what was told and not learned yet, one commit per log."""

from __future__ import annotations

from functools import partial
from typing import Any

from etude.campaign.folder import Campaign
from etude.campaign.journal import require_intact
from etude.campaign.kind_of import kind_of
from etude.campaign.kinds import RobotKind
from etude.campaign.learner import Learned, Learner, Say
from etude.campaign.state import State
from etude.errors import DataError, NumericalError, UsageError


def learn_pending(campaign: Campaign, learner: Learner | None = None, say: Say = lambda _: None) -> list[int]:
    """Learns every log that was told and not learned, in the order of their numbers; returns the numbers.

    A log that cannot be learned by itself (an axis that never moved) waits for the next one. The caller holds
    the lock.

    Raises:
        DataError, NumericalError: not even all logs together can be learned.
    """
    pending = [r.number for r in campaign.state().pending]
    if learner is None:
        learner = partial(_learn, kind_of(campaign.spec), say)
    done: list[int] = []
    failure: DataError | NumericalError | None = None
    for number in pending:
        say(f"Learning log {number}.")
        try:
            learned = learner(campaign, campaign.state(), number)
        except (DataError, NumericalError) as error:
            failure = error
            continue
        campaign.commit("trained", number, learned.files, **learned.facts)
        failure = None
        done.append(number)
    if failure is not None:
        raise failure
    return done


def newest_model(campaign: Campaign, state: State) -> Any:
    """The model in use: the chosen one of the last training.

    Raises:
        UsageError: nothing was learned yet, or a file of the model is missing or was changed.
    """
    if not state.trained:
        raise UsageError(
            "nothing has been learned yet", where=str(campaign.path), next_step="Tell a log first."
        )
    check_models(campaign, state)
    return kind_of(campaign.spec).load_model(campaign.model_folder(state.trained[-1].number))


def check_models(campaign: Campaign, state: State) -> None:
    """Holds the files of the last training, if any, against the journal: a damaged model may still load.

    Raises:
        UsageError: one is missing or was changed.
    """
    if not state.trained:
        return
    number = state.trained[-1].number
    trained = [e for e in campaign.events() if e.event == "trained" and e.number == number]
    advice = (
        f"Restore it from a copy, or learn anew: etude abandon {campaign.path} {number}, "
        "then tell its log again."
    )
    require_intact(campaign.path, trained[-1:], advice)


def _learn(kind: RobotKind, say: Say, campaign: Campaign, state: State, number: int) -> Learned:
    check_models(campaign, state)
    return kind.learn(campaign, state, number, say)
