"""The control of a motion, planned and used: tracking margins are measured for each control by itself."""

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
    """The control that a motion is asked for: its word, or what its files say.

    Args:
        control: its word; "": what is sent decides.
        effort: whether the learned command is sent with it.

    Raises:
        UsageError: no such control, or the learned command is sent with another.
    """
    if control and control not in IN_WORDS:
        raise UsageError(f"there is no control {control!r}", where="--control", next_step=_known())
    if effort and control not in ("", LEARNED):
        raise UsageError(
            f"a motion that is sent with the learned command is not run under {IN_WORDS[control]}",
            where="--control",
            next_step="Leave out --control, or --effort.",
        )
    return LEARNED if effort else control or FEEDBACK


def asked_under(asked: Constrained | None) -> tuple[str, ...]:
    """The controls that a proposal was made for; none are known of those that are older than this fact."""
    return () if asked is None else asked.controls


def require_same(control: str, asked: Constrained | None, number: int) -> None:
    """UsageError if a control was named that the open proposal `number` is not for."""
    own = asked_under(asked)
    if control and own and control not in own:
        raise UsageError(
            f"trajectory {number} is open, and its margins are those of {in_words(own)}",
            where="--control",
            next_step="Tell its log first, or ask for another one with --new.",
        )


def require_learned(control: str, state: State) -> None:
    """UsageError if a motion is asked for that is fed forward what was learned, and nothing was."""
    if control == LEARNED and not state.trained:
        raise UsageError(
            f"nothing has been learned yet that could be the {IN_WORDS[LEARNED]}",
            where="--control",
            next_step="Run the first motions under feedback alone, and tell their logs.",
        )


def run_under(campaign: Campaign, number: int, given: str) -> str:
    """The control that the log of a proposal was run under.

    As its teller says; else learned feedforward if the proposal was written with the learned command, else
    what it was asked for. "" where it is older than this fact: its log then counts for each control.
    """
    if given:
        return required(given)
    written = (e.fact for e in campaign.events() if e.number == number)
    if any(fact.effort for fact in written if isinstance(fact, Exported)):
        return LEARNED
    own = asked_under(campaign.round(number).asked)
    return own[0] if len(own) == 1 else ""


def speaks_of(ingested: Ingested, control: str) -> bool:
    """Whether a log tells of motions under that control; one whose control is unknown tells of each."""
    return ingested.control in ("", control)


def in_words(controls: Sequence[str]) -> str:
    """As certificates call them: "feedback alone or learned feedforward"; nothing if none are known."""
    return " or ".join(IN_WORDS[own] for own in controls)


def _known() -> str:
    return f"Known: {', '.join(IN_WORDS)}."
