"""Control of a motion, planned and used; tracking margins are measured for each control separately."""

from __future__ import annotations

from collections.abc import Sequence

from etude.campaign.record.events import Constrained, Exported, Ingested
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.errors import UsageError

FEEDBACK, FILE, LEARNED = "feedback", "file", "learned"
IN_WORDS = {
    FEEDBACK: "feedback alone",
    FILE: "feedforward of the robot file's model",
    LEARNED: "learned feedforward",
}


def required(control: str, effort: bool = False) -> str:
    """The control that a motion is proposed for.

    Args:
        control: its name; "": `effort` decides.
        effort: whether the learned command is sent with the motion.

    Raises:
        UsageError: the control is unknown, or the learned command is sent with another control.
    """
    if control and control not in IN_WORDS:
        raise UsageError(f"there is no control {control!r}", where="--control", next_step=_list_controls())
    if effort and control not in ("", LEARNED):
        raise UsageError(
            f"a motion with the learned command in its file cannot be planned for {IN_WORDS[control]}",
            where="--control",
            next_step="Leave out --control, or --effort.",
        )
    return LEARNED if effort else control or FEEDBACK


def asked_under(fact: Constrained | None) -> tuple[str, ...]:
    """Controls that a proposal was made for; () for proposals without this field."""
    return () if fact is None else fact.controls


def require_same(control: str, fact: Constrained | None, number: int) -> None:
    """Raises UsageError if `control` is named and the open proposal `number` is for another one."""
    controls = asked_under(fact)
    if control and controls and control not in controls:
        raise UsageError(
            f"trajectory {number} is open, and its tracking margins are for {in_words(controls)}",
            where="--control",
            next_step="Ingest its log first, or write another one with --new.",
        )


def require_learned(control: str, state: State) -> None:
    """Raises UsageError if a motion needs learned feedforward and nothing was learned."""
    if control == LEARNED and not state.trained:
        raise UsageError(
            f"there is no model yet for the {IN_WORDS[LEARNED]}",
            where="--control",
            next_step="Run the first motions under feedback alone, and ingest their logs.",
        )


def run_under(campaign: Campaign, number: int, control: str) -> str:
    """The control of a proposal's run.

    The user's word comes first. Otherwise it is learned feedforward if the proposal was written with the
    learned command, else the control of the proposal. "" for proposals without this field: such a log counts
    for every control.
    """
    if control:
        return required(control)
    written = (e.fact for e in campaign.events() if e.number == number)
    if any(fact.effort for fact in written if isinstance(fact, Exported)):
        return LEARNED
    controls = asked_under(campaign.round(number).asked)
    return controls[0] if len(controls) == 1 else ""


def speaks_of(ingested: Ingested, control: str) -> bool:
    """Whether a log is evidence about motions under that control; one with unknown control is evidence for
    all.
    """
    return ingested.control in ("", control)


def in_words(controls: Sequence[str]) -> str:
    """The controls as certificates name them: "feedback alone or learned feedforward"; "" if unknown."""
    return " or ".join(IN_WORDS[control] for control in controls)


def _list_controls() -> str:
    return f"Known: {', '.join(IN_WORDS)}."
