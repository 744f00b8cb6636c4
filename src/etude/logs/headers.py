"""What each header of a file says: a part of a channel, by name, by number or by the part's bare name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from etude.contracts import Channel
from etude.errors import DataError
from etude.logs.controllers import doubles, plain
from etude.logs.words import (
    COMMANDS,
    PREFIXES,
    SETPOINTS,
    SYNONYMS,
    UNITS,
    UNITS_TO_USE,
    normal,
    split_unit,
)

NUMBERED = (
    r"(?P<word>[a-z_]*?)_?(?:joint_?|j)?(?P<number>\d{1,4})",
    r"(?:joint_?|j)(?P<number>\d{1,4})_(?P<word>[a-z_]+)",
)
LETTERS = set("wxyz")


@dataclass(frozen=True)
class Column:
    """One matched column.

    Attributes:
        name: its header in the file.
        factor: to SI, by the unit that the header states.
        stated: whether it states one.
        word: rank of the word that was used for its channel, 0 for the channel's own name.
    """

    name: str
    factor: float
    stated: bool
    word: int = 0


@dataclass
class Found:
    """What headers say, by channel: columns by part, by number, and by a part's bare name."""

    named: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    numbered: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    bare: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)


def read_headers(headers: Sequence[str], channels: Sequence[Channel], where: str) -> Found:
    """Every header's meaning. DataError: one has a meaning, and an unknown unit."""
    named, words = _named(channels), _words(channels)
    bare = _bare(channels)
    found = Found()
    again = doubles(headers)
    for header in headers:
        if header in again:
            found.ignored.append(header)
            continue
        text, unit = split_unit(header)
        rests = _rests(normal(text))
        hit = next((named[rest] for rest in rests if rest in named), None)
        number = None if hit else _number(rests, words)
        claims = () if hit or number else bare.get(rests[0], ())
        if not (hit or number or claims):
            found.ignored.append(header)
            continue
        if unit not in UNITS:
            raise DataError(
                f"unknown unit '{unit}'", where=f"{where}, column '{header}'", next_step=UNITS_TO_USE
            )
        column = Column(header, UNITS[unit], unit != "")
        if hit:
            _note(found.named, hit[0], hit[1], Column(header, UNITS[unit], unit != "", hit[2]))
        elif number:
            _note(found.numbered, number[0], number[1], column)
        for name, part in claims:
            _note(found.bare, name, part, column)
    return found


def _note(place: dict[str, dict[str, list[Column]]], channel: str, part: str, column: Column) -> None:
    place.setdefault(channel, {}).setdefault(part, []).append(column)


def _rests(text: str) -> list[str]:
    rests = [text, *(text.removeprefix(f"{p}_") for p in PREFIXES if text.startswith(f"{p}_"))]
    named = text.partition("_joint_states_")[2]  # in a robot's namespace, /left/joint_states/...
    return [*rests, *(rest for rest in (named, plain(text)) if rest)]


def words_of(channel: Channel) -> tuple[str, ...]:
    """The channel's own name, then what else it is called."""
    words = [normal(channel.name), *SYNONYMS.get(channel.name, ())]
    if channel.role == "command":
        words += COMMANDS.get(channel.units[0], ()) if channel.units else ()
        words += () if channel.acts_on else SETPOINTS
    return tuple(dict.fromkeys(words))


def _words(channels: Sequence[Channel]) -> dict[str, str]:
    """Word -> channel, own names first."""
    own = {normal(channel.name): channel.name for channel in channels}
    return {**{w: c.name for c in reversed(channels) for w in words_of(c)}, **own}


def _named(channels: Sequence[Channel]) -> dict[str, tuple[str, str, int]]:
    """Every normalised header that names a part -> (channel, part, rank of the word); own names first."""
    named: dict[str, tuple[str, str, int]] = {}
    ranked = [(rank, word, c) for c in channels for rank, word in enumerate(words_of(c))]
    for rank, word, channel in sorted(ranked, key=lambda row: row[0] > 0):
        for alias, part in _aliases(channel).items():
            for text in (f"{word}_{alias}", f"{alias}_{word}") if alias else (word,):
                named.setdefault(text, (channel.name, part, rank))
            if set(channel.parts) <= LETTERS:
                named.setdefault(f"{word}{alias}", (channel.name, part, rank))
        if len(channel.parts) == 1:
            named.setdefault(word, (channel.name, channel.parts[0], rank))
    return named


def _aliases(channel: Channel) -> dict[str, str]:
    """Normalised spellings of each part: its name, and the name without a final `_joint` where unique."""
    exact = {normal(part): part for part in channel.parts}
    short = [normal(part).removesuffix("_joint") for part in channel.parts]
    unique = {s: part for s, part in zip(short, channel.parts, strict=True) if short.count(s) == 1}
    return {**unique, **exact}


def _bare(channels: Sequence[Channel]) -> dict[str, tuple[tuple[str, str], ...]]:
    """A part's bare name -> (channel, part) that it may mean: `roll`, `front_right`; never a joint's."""
    own = [c for c in channels if c.role in ("command", "aside") and not c.acts_on]
    bare: dict[str, tuple[tuple[str, str], ...]] = {}
    for channel in own:
        if sum(c.parts == channel.parts and c.role not in ("plan", "truth") for c in channels) == 1:
            for part in channel.parts:
                if len(part) > 1:
                    bare[normal(part)] = (*bare.get(normal(part), ()), (channel.name, part))
    return bare


def _number(rests: list[str], words: dict[str, str]) -> tuple[str, str] | None:
    """(channel, number) of a normalised header such as `q_3`; None if it is none."""
    for rest in rests:
        for pattern in NUMBERED:
            found = re.fullmatch(pattern, rest)
            if found is not None and found["word"] in words:
                return words[found["word"]], found["number"]
    return None


def other_unit(channel: Channel, headers: Sequence[str]) -> tuple[str, str] | None:
    """The first header that names a part of this command in another unit, and that unit."""
    if channel.role != "command" or not channel.acts_on:
        return None
    for unit in COMMANDS:
        other = replace(channel, units=(unit,) * len(channel.parts))
        named, words = _named([other]), _words([other])
        for header in headers:
            rests = _rests(normal(split_unit(header)[0]))
            if any(rest in named for rest in rests) or _number(rests, words):
                return header, unit
    return None


def settle_bare(found: Found, channels: dict[str, Channel], where: str) -> None:
    """Adds bare names to the one channel that needs them and gets whole by them.

    Raises:
        DataError: a column may be either of two channels.
    """
    whole: dict[str, list[str]] = {}
    for name, columns in found.bare.items():
        have = found.named.get(name, {})
        missing = [part for part in channels[name].parts if part not in have]
        if missing and name not in found.numbered and all(part in columns for part in missing):
            for part in missing:
                whole.setdefault(columns[part][0].name, []).append(name)
    for header, names in whole.items():
        if len(names) > 1:
            raise DataError(
                f"column '{header}' may be of the channel {' or '.join(names)}",
                where=where,
                next_step=f"Name it {' or '.join(f'{name}_{normal(header)}' for name in names)}.",
            )
    for name in {n for names in whole.values() for n in names}:
        mine = found.named.setdefault(name, {})
        mine |= {part: own for part, own in found.bare[name].items() if part not in mine}
