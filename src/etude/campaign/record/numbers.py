"""Which number a log may have: that of its proposal, or a free one."""

from __future__ import annotations

from pathlib import Path

from etude.campaign.record.state import Round, State
from etude.errors import UsageError


def check_same_number(known: Round, number: int | None, path: Path) -> None:
    if number is not None and number != known.number:
        raise UsageError(
            f"this log was told before, as the answer to trajectory {known.number}, not {number}",
            where=str(path),
            next_step=f"To take that back: etude untell FOLDER {known.number}.",
        )


def check_asked(state: State, number: int) -> None:
    found = state.rounds.get(number)
    if found is None or found.asked is None:
        known = ", ".join(str(r.number) for r in state.rounds.values() if r.asked) or "none"
        raise UsageError(f"trajectory {number} was never asked for", next_step=f"Asked for: {known}.")
    if found.confirms:
        raise UsageError(
            f"trajectory {number} confirms, nothing is learned from it",
            next_step="Say which run its log is of: --confirm without, or --confirm with.",
        )
    if found.told is not None and not found.abandoned:
        raise UsageError(
            f"trajectory {number} has a log already",
            next_step=f"To replace it: etude untell FOLDER {number}, then tell again.",
        )


def free_number(state: State, number: int | None) -> int:
    if number is None:
        return state.next_number
    if number in state.rounds:
        raise UsageError(f"number {number} is taken", next_step=f"The next free one is {state.next_number}.")
    return number
