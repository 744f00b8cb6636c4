"""The channels of a robot that nobody described, guessed from the headers of one of its logs."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from etude.errors import DataError
from etude.logs.columns.controllers import plain
from etude.logs.columns.headers import words_of
from etude.logs.columns.matching import match_columns
from etude.logs.columns.vocabulary import COMMANDS, PREFIXES, is_time, normal, split_suffix, split_unit
from etude.types import Array, Channel, Log

ROLES = (Channel("q", ("",), ("rad",)), Channel("qd", ("",), ("rad/s",)))
FEWEST = 1
UNIT = 1e-3  # a quaternion's length is 1, to the digits that logs have


def guessed_of(raw: Log) -> tuple[tuple[Channel, ...], str]:
    """The channels that raw columns seem to hold, and why there are none."""
    channels = guessed_channels(list(raw.values))
    if not channels:
        return (), "No header says position and command of a joint"
    try:
        columns = match_columns(list(raw.values), channels, raw.source).channels["q"]
    except DataError as error:
        return (), f"The headers do not tell which joints there are ({error.fact})"
    if _is_quaternion(np.hstack([raw[column.name] for column in columns])):
        names = ", ".join(column.name for column in columns)
        return (), f"{names} are an orientation, of length 1 throughout, and no joints"
    return channels, ""


def _is_quaternion(values: Array) -> bool:
    """Whether values (T, k) are four of length 1 in every row that holds numbers, and turn."""
    if values.shape[1] != 4:
        return False
    known = values[np.isfinite(values).all(axis=1)]
    size = np.linalg.norm(known, axis=1)
    return bool(len(known) and np.ptp(known) > 0.0 and (np.abs(size - 1.0) < UNIT).all())


def guessed_channels(headers: Sequence[str]) -> tuple[Channel, ...]:
    """Positions, velocities and commands of the joints that have a position and a command; none where no
    header says so.
    """
    positions, speeds = (_parts(headers, words_of(channel)) for channel in ROLES)
    unit, commands = _commanded(headers)
    own, fast = ({name for names in found for name in names} for found in (commands, speeds))
    names = tuple(dict.fromkeys(next((n for n in some if n in own), "") for some in positions))
    names = tuple(name for name in names if name)
    if len(names) < FEWEST:
        return ()
    size = len(names)
    found = [Channel("q", names, ("rad",) * size, required=True)]
    if all(name in fast for name in names):
        found.append(Channel("qd", names, ("rad/s",) * size, derivative_of="q"))
    command = Channel("command", names, (unit,) * size, "command", required=True, acts_on="q")
    return (*found, command)


def _commanded(headers: Sequence[str]) -> tuple[str, list[list[str]]]:
    """The unit whose words name most commands, and their joints."""
    words = {unit: (*own, "command", "tau", "u", "cmd") for unit, own in COMMANDS.items()}
    found = {unit: _parts(headers, own) for unit, own in words.items()}
    unit = max(found, key=lambda name: len(found[name]))
    return unit, found[unit]


def _parts(headers: Sequence[str], words: Sequence[str]) -> list[list[str]]:
    """Of each header that begins or ends with one of the words: what may be left of it, longest first."""
    found = []
    for header in [header for header in headers if not is_time(header)]:
        text = normal(split_suffix(split_unit(header)[0])[0])
        text = plain(text) or text
        left = {part for word in words if (part := _left(text, word))}
        found += [sorted(left, key=lambda part: (-len(part), part))] if left else []
    return found


def _left(text: str, word: str) -> str:
    """ "elbow" of "elbow_position"; "joint_3" of "q3"; "" if the word is not at either end."""
    for prefix in ("", *(f"{p}_" for p in PREFIXES)):
        rest = text.removeprefix(prefix)
        numbered = re.fullmatch(rf"{re.escape(word)}_?(?:joint_?|j)?(\d{{1,4}})", rest)
        if numbered:
            return f"joint_{numbered[1]}"
        for left in (rest.removeprefix(f"{word}_"), rest.removesuffix(f"_{word}")):
            if left != rest:
                return left
    return ""
