"""Has the robot changed? Each log is held against the model in use before it is learned, and a person asked.

A model that has learned two robots knows neither, and nothing tells the two apart afterwards. So a log that
speaks of another robot is stored and waits: the model in use stays as it is until there is an answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from etude.campaign.record.events import Changed
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import CHANGED, State
from etude.campaign.record.stored_models import stored_model
from etude.errors import DataError, UsageError
from etude.logs.cleaning.filters import duration
from etude.models.change.diagnosis import SENSOR, Cause
from etude.models.change.evidence import judged
from etude.models.learned_model import LearnedModel
from etude.types import Finding, Log, Samples

Answer = Literal["new", "forget", "same"]
ANSWERS: tuple[Answer, ...] = ("new", "forget", "same")
FLAG = "--changed"
LEAST_LOGS = 2
"""Of the model in use, before which nothing is said of a change."""
CAUSES: dict[Cause, str] = {
    "load": "a load was taken up or put down: the errors follow gravity and inertia",
    "friction": "friction has changed: the errors follow the sign of the velocity",
    "offset": "the errors are constant: a sensor or a current has a new offset, or a load acts on one axis "
    "in poses much alike",
    "gain": "a sensor of one command is out of scale: the errors are in proportion to that command",
    "encoder": "a position sensor has a new offset: the errors are what all commands change by with it",
    "stuck": "a sensor is stuck: it shows the same value while the joint moves",
    "unknown": "which part of it cannot be told from the errors",
}
KINDS: dict[Cause, str] = {"load": "payload", "friction": "friction", **dict.fromkeys(SENSOR, "sensor")}
"""In a word; what is not in it is unknown."""
STEP = (
    f"Say what it is: {FLAG} new learns from this log and those to come alone, {FLAG} forget sets this log "
    f"aside (the change was for a while), {FLAG} same learns it with the others."
)


def change_found(campaign: Campaign, state: State, log: Log) -> Finding | None:
    """The finding that this log is not of the robot that the model in use knows; None if nothing says so.

    The log is aligned, and not stored yet. Nothing can be said without a model, or where the log lacks what
    the model looks at.
    """
    if state.newest is None or len(state.newest.logs) < LEAST_LOGS:
        return None
    group = np.zeros(len(log), dtype=np.int64)
    samples = campaign.kind.samples(campaign.spec, campaign.config, [log], [group])
    try:
        model = stored_model(campaign, state.trained[-1].number)
        return _finding(model, samples, duration(log))
    # an input that this log lacks; of a damaged model learning speaks
    except (KeyError, DataError, UsageError):
        return None


def _finding(model: LearnedModel, samples: Samples, seconds: float) -> Finding | None:
    found, t = judged(model, samples), samples.t
    if found.alarm is None:
        return None
    at = float(t[found.alarm])
    place = "" if found.output is None else f", nearly all of it in {model.commands[found.output]}"
    sentence = (
        f"the robot is not the one that the model knows: after {at - t[0]:.0f} s of {seconds:.0f} s the "
        f"errors were beyond chance (squared, {found.z2:.3g} times the predicted variance{place}); "
        f"{CAUSES[found.cause]}"
    )
    return Finding(CHANGED, "red", sentence, STEP, FLAG, ((at, float(t[-1])),))


def answer(campaign: Campaign, state: State, choice: str, numbers: Sequence[int]) -> bool:
    """Records what became of the robot; False if there is nothing left to record. The caller holds the lock.

    Args:
        choice: one of `ANSWERS`.
        numbers: of the logs that the answer came with; it speaks of those that wait, too.

    Raises:
        UsageError: another word, or there is no log that the answer could speak of.
    """
    if choice not in ANSWERS:
        raise UsageError(f"{FLAG} {choice}: no such answer", next_step=f"Answers: {', '.join(ANSWERS)}.")
    waiting = [r.number for r in state.awaiting_answer]
    meant = sorted({*waiting, *numbers} & {r.number for r in state.ingested})
    if not waiting and not numbers:
        raise UsageError(
            "no log waits for the answer to whether the robot has changed",
            where=str(campaign.path),
            next_step=f"Give {FLAG} together with the log it speaks of.",
        )
    others = [r.number for r in state.ingested if r.number not in meant]
    excluded = {"new": others, "forget": meant, "same": []}[choice]
    if not meant or not (waiting or excluded):
        return False
    campaign.commit(Changed(choice=choice, logs=tuple(meant), aside=tuple(excluded)), max(meant))
    return True
