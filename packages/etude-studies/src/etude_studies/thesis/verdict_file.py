"""One claim's verdict, the committed file of all of them, and what differs between two such files."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from etude.errors import DataError
from etude_studies.thesis.part_verdicts import NOT_RUN, UNTESTED, PartVerdict


class Verdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one claim.

    Attributes:
        claim: its id. word: one of WORDS.
        parts: of the claim, or of those that it says again.
        exploratory: corrected for by Benjamini and Hochberg at 10 %, not by Holm at 5 %.
        simulated: a claim about hardware that simulation answers.
        reason: why it cannot be tested, or how many seeds would decide.
        same_as: ids of the claims that it says again.
        asks: seeds that would decide it; None where none would, or it needs none. block: seeds of its block,
            once that has been run, else 0.
    """

    claim: str
    word: str
    parts: tuple[PartVerdict, ...] = ()
    exploratory: bool = False
    simulated: bool = False
    reason: str = ""
    same_as: tuple[str, ...] = ()
    asks: int | None = None
    block: int = 0


def shown(verdict: Verdict) -> str:
    """Its word, or that its runs are missing or not complete."""
    waits = verdict.word == UNTESTED and verdict.reason.startswith(NOT_RUN)
    return NOT_RUN if waits else verdict.word


def changed(old: Mapping[str, Verdict], new: Mapping[str, Verdict]) -> list[str]:
    """Sentences on what differs: a word, or an estimate outside the earlier 95 % interval. Empty: nothing."""
    out = [
        f"{claim}: there was no verdict before, now {new[claim].word}" for claim in new if claim not in old
    ]
    out += [
        f"{claim}: {old[claim].word} before, now there is no verdict" for claim in old if claim not in new
    ]
    for claim in (claim for claim in new if claim in old):
        before, now = old[claim], new[claim]
        if before.word != now.word:
            out.append(f"{claim}: {before.word} before, now {now.word}")
        out += [f"{claim}, {sentence}" for sentence in _moved(before, now)]
    return out


def to_json(verdicts: Mapping[str, Verdict]) -> str:
    """The committed file: one object by claim id, indented, with a final newline."""
    encoded = msgspec.json.format(msgspec.json.encode(dict(verdicts)), indent=1)
    return encoded.decode() + "\n"


def from_json(text: str) -> dict[str, Verdict]:
    """What `to_json` wrote. DataError: the text is something else."""
    try:
        return msgspec.json.decode(text, type=dict[str, Verdict])
    except msgspec.DecodeError as error:
        raise DataError(
            f"no file of verdicts: {error}", next_step="Make it again from the results."
        ) from error


def _moved(before: Verdict, now: Verdict) -> list[str]:
    if len(before.parts) != len(now.parts):
        return [f"{len(before.parts)} parts before, now {len(now.parts)}"]
    out = []
    for old, new in zip(before.parts, now.parts, strict=True):
        name = f"part {new.part + 1}" + (f" at {new.k}" if new.k is not None else "")
        if old.word != new.word:
            out.append(f"{name}: {old.word} before, now {new.word}")
        elif old.estimate is not None and new.estimate is not None and not _within(old, new.estimate):
            out.append(f"{name}: {new.estimate:.3g}, outside {old.low:.3g} .. {old.high:.3g} before")
    return out


def _within(old: PartVerdict, estimate: float) -> bool:
    assert old.low is not None
    assert old.high is not None
    return bool(np.nextafter(old.low, -np.inf) <= estimate <= np.nextafter(old.high, np.inf))
