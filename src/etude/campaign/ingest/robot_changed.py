"""Detection of a changed robot: each log is compared with the model in use before training.

A model trained on two different robots fits neither, and their data cannot be separated afterwards. So a log
of a changed robot is stored and waits: the model in use stays unchanged until the user answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from etude.campaign.ingest.command_decisions import ingested_logs
from etude.campaign.ingest.questions import MOST_BY_FILE, body_of, path_and_body
from etude.campaign.record.events import Changed
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import CHANGED, State
from etude.campaign.record.stored_models import stored_model
from etude.errors import DataError, UsageError
from etude.logs.cleaning.filters import duration
from etude.models.change.diagnosis import SENSOR, Cause
from etude.models.change.evidence import ChangeTest, change_test
from etude.models.learned_model import LearnedModel
from etude.types import Array, Finding, Log, Samples

Answer = Literal["new", "forget", "same"]
ANSWERS: tuple[Answer, ...] = ("new", "forget", "same")
FLAG = "--changed"
LEAST_LOGS = 2
"""Of the model in use, from which all evidence counts."""
ENORMOUS, MUCH_LEFT = 100.0, 0.2
"""Nats needed after a single log, and the limit on what the estimated change may leave. After one log,
unvisited states are predicted badly, but such errors look neither like a load nor like a factor.
"""
OTHER = "the robot differs from the one that the model was trained on"
CAUSES: dict[Cause, str] = {
    "load": "a load was taken up or put down: the errors follow gravity and inertia",
    "friction": "friction has changed: the errors follow the sign of the velocity",
    "offset": "the errors are constant: a sensor or a current has a new offset, or a load acts on one "
    "axis in similar poses",
    "gain": "a sensor of one command has a wrong scale: the errors are proportional to that command",
    "encoder": "a position sensor has a new offset: the errors are those that this offset causes in all "
    "commands",
    "stuck": "a sensor is frozen: it shows the same value while the joint moves",
    "unknown": "the errors do not determine the cause",
}
KINDS: dict[Cause, str] = {"load": "payload", "friction": "friction", **dict.fromkeys(SENSOR, "sensor")}
"""Kind of change by cause; other causes are unknown."""
STEP = (
    f"Answer the question: {FLAG} new learns from this log and later ones only; {FLAG} forget excludes this "
    f"log (a temporary change); {FLAG} same learns it with the others."
)


def change_of_robot(campaign: Campaign, state: State, log: Log, samples: Samples) -> Finding | None:
    """The finding that the robot of this log differs from that of the model in use; None without evidence.

    The log is aligned, and not stored yet. The test needs a model, and a log with the model's inputs. If the
    errors give no evidence, a model file may, since it covers states outside of all logs.
    samples: of the log.
    """
    return _by_errors(campaign, state, log, samples) or _by_file(campaign, state, log)


def _by_file(campaign: Campaign, state: State, log: Log) -> Finding | None:
    newest = state.newest
    path_body = None if newest is None else path_and_body(campaign.kind, campaign.spec, log)
    if newest is None or path_body is None:
        return None
    from etude.logs.evidence.contradictions import contradiction

    earlier = ingested_logs(campaign, state)
    numbers = [n for n in newest.logs if n in earlier][-MOST_BY_FILE:]
    logs, names = [*(earlier[n] for n in numbers), log], [*(f"log {n}" for n in numbers), "this log"]
    finding = contradiction(logs, *path_body, names, len(numbers))
    if finding is None:
        return None
    return Finding(CHANGED, "red", f"{OTHER}: {finding.sentence[:-1]}", STEP, FLAG)


def _by_errors(campaign: Campaign, state: State, log: Log, samples: Samples) -> Finding | None:
    if state.newest is None:
        return None
    try:
        model = stored_model(campaign, state.trained[-1].number)
        test = change_test(model, samples, body_of(campaign.kind, campaign.spec))
        few = len(state.newest.logs) < LEAST_LOGS
        return None if few and not _is_enormous(test) else _finding(model, test, samples.t, duration(log))
    # an input that this log lacks; training reports a damaged model
    except (KeyError, DataError, UsageError):
        return None


def _is_enormous(test: ChangeTest) -> bool:
    return (
        float(test.evidence.max(initial=0.0)) > ENORMOUS
        and test.size is not None
        and test.size.left < MUCH_LEFT
    )


def _finding(model: LearnedModel, test: ChangeTest, t: Array, seconds: float) -> Finding | None:
    if test.alarm is None:
        return None
    at = float(t[test.alarm])
    place = "" if test.output is None else f", nearly all of it in {model.commands[test.output]}"
    sentence = (
        f"{OTHER}: after {at - t[0]:.0f} s of {seconds:.0f} s the errors were not due to chance (squared, "
        f"{test.z2:.3g} times the predicted variance{place}); {CAUSES[test.cause]}{_figure(model, test)}"
    )
    return Finding(CHANGED, "red", sentence, STEP, FLAG, ((at, float(t[-1])),))


TURNED = -0.5  # a factor below is an inverted sign


def _figure(model: LearnedModel, test: ChangeTest) -> str:
    """Text such as ", 0.46 +- 0.02 kg at the last link"; "" where the cause has no number."""
    size = test.size
    if size is None:
        return ""
    value = f"{size.value:.2g} +- {max(size.deviation, 0.0):.1g}"
    if test.cause == "load":
        return f", {value} kg at the last link (etude payload weighs it)"
    if test.cause == "friction":
        return f", {size.value:.2f} times what was learned"
    if size.joint is None:
        return ""
    if test.cause == "gain":
        inverted = ", inverted" if size.value < TURNED else ""
        return f", {size.value:.3g} times what was learned{inverted} in {model.commands[size.joint]}"
    return f", {size.value:.2g} at {model.commands[size.joint]}"


def answer(campaign: Campaign, state: State, choice: str, numbers: Sequence[int]) -> bool:
    """Record the answer on a changed robot; False if it was recorded before. The caller holds the lock.

    Args:
        choice: one of `ANSWERS`.
        numbers: of the logs that the answer was given with; it also applies to waiting logs.

    Raises:
        UsageError: an unknown answer, or no log that it could apply to.
    """
    if choice not in ANSWERS:
        raise UsageError(f"{FLAG} {choice}: no such answer", next_step=f"Answers: {', '.join(ANSWERS)}.")
    waiting = [r.number for r in state.awaiting_answer]
    meant = sorted({*waiting, *numbers} & {r.number for r in state.ingested})
    if not waiting and not numbers:
        raise UsageError(
            "no log waits for an answer about a change of the robot",
            where=str(campaign.path),
            next_step=f"Give {FLAG} together with that log.",
        )
    others = [r.number for r in state.ingested if r.number not in meant]
    excluded = {"new": others, "forget": meant, "same": []}[choice]
    if not meant or not (waiting or excluded):
        return False
    campaign.commit(Changed(choice=choice, logs=tuple(meant), aside=tuple(excluded)), max(meant))
    return True
