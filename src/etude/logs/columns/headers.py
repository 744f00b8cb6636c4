"""Meanings of a file's headers: a part of a channel, by name, by number or by the part's bare name.

Of a ROS 2 controller's state PlotJuggler writes `/arm_controller/controller_state/feedback/positions[0]`, or
`.../actual/positions.0` of older releases and of older PlotJugglers; the joints then have numbers, in the
controller's order.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from etude.errors import DataError
from etude.logs.columns.header_units import NUMBER, UNITS_TO_USE, same_dimension, unit_in
from etude.logs.columns.vocabulary import (
    COMMANDS,
    PREFIXES,
    SETPOINTS,
    SYNONYMS,
    as_written,
    normal,
    split_suffix,
    split_unit,
)
from etude.types import Channel

NUMBERED = (
    r"(?P<word>[a-z_]*?)_?(?:joint_?|j)?(?P<number>\d{1,4})_(?P<rest>[a-z_]+)",
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
        unit: that it states; "" if none.
        word: rank of the word that was used for its channel, 0 for the channel's own name.
    """

    name: str
    factor: float
    unit: str
    word: int = 0

    @property
    def written_unit(self) -> str:
        """The unit as its header spells it: mNm, where `unit` is in small letters."""
        return as_written(self.name, self.unit)

    @property
    def stated(self) -> bool:
        """Whether its header states a unit."""
        return self.unit != ""


@dataclass(frozen=True)
class Claim:
    """A possible meaning of a header.

    Attributes:
        place: "named", "numbered" or "bare": of `HeaderMeanings`. channel: its name.
        part: of the channel, or its number. word: rank of the word, as in `Column`.
    """

    place: str
    channel: str
    part: str
    word: int = 0


@dataclass
class HeaderMeanings:
    """Meanings of headers, by channel: columns by part, by number, and by a part's bare name."""

    named: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    numbered: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    bare: dict[str, dict[str, list[Column]]] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)

    def of(self, claim: Claim) -> dict[str, list[Column]]:
        """The columns of the claim's channel, in its place."""
        places: dict[str, dict[str, dict[str, list[Column]]]] = vars(self)
        return places[claim.place].setdefault(claim.channel, {})

    def note(self, claim: Claim, header: str, unit: str) -> None:
        """Adds a column."""
        parsed = unit_in(unit)
        assert parsed is not None
        column = Column(header, parsed.factor, unit, claim.word)
        self.of(claim).setdefault(claim.part, []).append(column)

    def columns(self) -> Iterator[Column]:
        """All columns."""
        for place in (self.named, self.numbered, self.bare):
            for parts in place.values():
                for columns in parts.values():
                    yield from columns


@dataclass(frozen=True)
class _Vocabulary:
    """Names that headers may have for the required channels."""

    named: Mapping[str, tuple[str, str, int]]
    channel_of: dict[str, str]
    bare: Mapping[str, tuple[tuple[str, str], ...]]

    def claims(self, text: str) -> tuple[Claim, ...]:
        """Meanings of a header without its unit: the part that it names, else its number, else those of its
        bare name.
        """
        variants = _header_variants(normal(text))
        hit = next((self.named[candidate] for candidate in variants if candidate in self.named), None)
        if hit:
            return (Claim("named", *hit),)
        number = _numbered_part(variants, self.channel_of)
        if number:
            return (Claim("numbered", *number),)
        return tuple(Claim("bare", *meaning) for meaning in self.bare.get(variants[0], ()))


COLUMN = re.compile(
    r"(?:.*_)?controller_state_(?:joints?_(?P<before>.+)_)?(?P<point>feedback|actual|reference|desired|output)_"
    r"(?P<word>position|velocit|acceleration|effort)(?:ies|y|s)?(?:_(?P<after>.+))?"
)
WORDS = {"velocit": "velocity"}
MEASURED, DESIRED_POINTS = ("feedback", "actual"), ("reference", "desired")
OUTPUT = "output"
"""Fields of the controller's output; only its efforts are learned commands."""


def plain(text: str) -> str:
    """ "position_0" of such a normalised header, "position_desired_0" of what was wanted; "" of any other."""
    match = COLUMN.fullmatch(text)
    joint = "" if match is None else match["before"] or match["after"]
    if match is None or not joint:
        return ""
    word, point = WORDS.get(match["word"], match["word"]), match["point"]
    if (word == "effort") != (point == OUTPUT) and point not in MEASURED:
        return ""
    return f"{word}{'_desired' if point in DESIRED_POINTS else ''}_{joint}"


def doubles(headers: Sequence[str]) -> set[str]:
    """Headers that repeat another: Humble fills `actual` beside `feedback`, and measured efforts may stand
    beside those that are sent. The first is taken: feedback, actual, reference, desired, output.
    """
    ranks = {point: rank for rank, point in enumerate((*MEASURED, *DESIRED_POINTS, OUTPUT))}
    by_meaning: dict[str, list[tuple[int, str]]] = {}
    for header in headers:
        text = normal(split_unit(header)[0])
        match = COLUMN.fullmatch(text)
        if match is not None and plain(text):
            by_meaning.setdefault(plain(text), []).append((ranks[match["point"]], header))
    return {header for same in by_meaning.values() for _, header in sorted(same)[1:]}


def read_headers(headers: Sequence[str], channels: Sequence[Channel], where: str) -> HeaderMeanings:
    """Meanings of all headers. DataError: a header has a meaning and an unknown unit.

    A unit at the end without brackets, `q1_deg`, counts where nothing else names that part, and where the
    channel is whole with it: such a column is no reason to refuse what is whole without it.
    """
    vocabulary = _Vocabulary(_part_headers(channels), _channels_by_word(channels), _bare_names(channels))
    described = {channel.name: channel for channel in channels}
    duplicates, meanings, unmatched = doubles(headers), HeaderMeanings(), []
    written = {name: (c.name, p) for c in channels for name, p in zip(column_names(c), c.parts, strict=True)}
    for header in headers:
        # as Étude writes it, whatever is in the part's name
        if header in written and header not in duplicates:
            meanings.note(Claim("named", *written[header], 0), header, "")
            continue
        text, unit = split_unit(header)
        claims = () if header in duplicates else vocabulary.claims(text)
        claims = tuple(claim for claim in claims if _may_be(unit, described[claim.channel]))
        if claims and unit_in(unit) is None:
            raise DataError(
                f"unknown unit '{as_written(header, unit)}'",
                where=f"{where}, column '{header}'",
                next_step=UNITS_TO_USE,
            )
        for claim in claims:
            meanings.note(claim, header, unit)
        unmatched += [] if claims else [header]
    _add_suffixed(
        meanings,
        [h for h in unmatched if h not in duplicates and not split_unit(h)[1]],
        vocabulary,
        described,
    )
    taken = {column.name for column in meanings.columns()}
    meanings.ignored += [header for header in unmatched if header not in taken]
    return meanings


def _may_be(unit: str, channel: Channel) -> bool:
    """Whether a header in brackets may be of a channel: a desired torque is no desired position."""
    stated = unit_in(unit)
    if channel.role != "plan" or stated is None or stated.dimension == NUMBER:
        return True
    return any(same_dimension(unit, other) for other in dict.fromkeys(channel.units))


def _add_suffixed(
    meanings: HeaderMeanings,
    headers: Sequence[str],
    vocabulary: _Vocabulary,
    described: Mapping[str, Channel],
) -> None:
    """Add columns whose headers end with a unit; of two for one part, the one in SI."""
    suffixed = HeaderMeanings()
    for header in sorted(headers, key=_not_si):
        text, unit = split_suffix(header)
        for claim in vocabulary.claims(text) if unit else ():
            units = dict.fromkeys(described[claim.channel].units)
            if any(same_dimension(unit, other) for other in units) and claim.part not in suffixed.of(claim):
                suffixed.note(claim, header, unit)
    for place in ("named", "numbered", "bare"):
        for name, columns in getattr(suffixed, place).items():
            present = getattr(meanings, place).get(name, {})
            elsewhere = any(name in getattr(meanings, p) for p in ("named", "numbered", "bare") if p != place)
            if len({*present, *columns}) == len(described[name].parts) and not elsewhere:
                getattr(meanings, place)[name] = {**columns, **present}


def _not_si(header: str) -> bool:
    unit = unit_in(split_suffix(header)[1])
    return unit is None or unit.factor != 1.0


def column_names(channel: Channel) -> list[str]:
    """The headers of a channel as Étude writes them; a part without a name is the channel itself."""
    return [f"{channel.name}_{part}" if part else channel.name for part in channel.parts]


def _header_variants(text: str) -> list[str]:
    variants = [text, *(text.removeprefix(f"{p}_") for p in PREFIXES if text.startswith(f"{p}_"))]
    named = text.partition("_joint_states_")[2]  # in a robot's namespace, /left/joint_states/...
    return [*variants, *(candidate for candidate in (named, plain(text)) if candidate)]


def words_of(channel: Channel) -> tuple[str, ...]:
    """The channel's own name, then its synonyms."""
    synonyms = [normal(channel.name), *SYNONYMS.get(channel.name, ())]
    if channel.role == "command":
        synonyms += [word for unit in dict.fromkeys(channel.units) for word in COMMANDS.get(unit, ())]
        synonyms += () if channel.acts_on else SETPOINTS
    return tuple(dict.fromkeys(synonyms))


def _channels_by_word(channels: Sequence[Channel]) -> dict[str, str]:
    """Word -> channel, own names first."""
    names = {normal(channel.name): channel.name for channel in channels}
    return {**{w: c.name for c in reversed(channels) for w in words_of(c)}, **names}


def _part_headers(channels: Sequence[Channel]) -> dict[str, tuple[str, str, int]]:
    """Every normalised header that names a part -> (channel, part, rank of the word); own names first."""
    named: dict[str, tuple[str, str, int]] = {}
    ranked = [(rank, word, c) for c in channels for rank, word in enumerate(words_of(c))]
    for rank, word, channel in sorted(ranked, key=lambda row: row[0] > 0):
        for alias, part in _aliases(channel).items():
            for text in _word_placements(word, alias) if alias else [word]:
                named.setdefault(text, (channel.name, part, rank))
            if set(channel.parts) <= LETTERS:
                named.setdefault(f"{word}{alias}", (channel.name, part, rank))
        if len(channel.parts) == 1:
            named.setdefault(word, (channel.name, channel.parts[0], rank))
    return named


def _word_placements(word: str, alias: str) -> list[str]:
    """A word before a part, after it, and around it: `q_des_elbow`, `elbow_q_des`, `q_elbow_des`."""
    tokens = word.split("_")
    within = ["_".join([*tokens[:i], alias, *tokens[i:]]) for i in range(1, len(tokens))]
    return [f"{word}_{alias}", f"{alias}_{word}", *within]


def _aliases(channel: Channel) -> dict[str, str]:
    """Normalised spellings of each part: its name, and the name without a final `_joint` where unique."""
    exact = {normal(part): part for part in channel.parts}
    short = [normal(part).removesuffix("_joint") for part in channel.parts]
    unique = {s: part for s, part in zip(short, channel.parts, strict=True) if short.count(s) == 1}
    return {**unique, **exact}


def part_names(channel: Channel) -> list[str]:
    """Normalised names of its parts, as headers may spell them; longest first."""
    return sorted(_aliases(channel), key=len, reverse=True)


def _bare_names(channels: Sequence[Channel]) -> dict[str, tuple[tuple[str, str], ...]]:
    """A part's bare name -> (channel, part) that it may mean: `roll`, `front_right`; never a joint's."""
    commands = [c for c in channels if c.role in ("command", "aside") and not c.acts_on]
    bare: dict[str, tuple[tuple[str, str], ...]] = {}
    for channel in commands:
        if sum(c.parts == channel.parts and c.role not in ("plan", "truth") for c in channels) == 1:
            for part in channel.parts:
                if len(part) > 1:
                    bare[normal(part)] = (*bare.get(normal(part), ()), (channel.name, part))
    return bare


def _numbered_part(variants: list[str], channel_of: dict[str, str]) -> tuple[str, str] | None:
    """(channel, number) of a normalised header such as `q_3`; None if it is none."""
    for text in variants:
        for pattern in NUMBERED:
            match = re.fullmatch(pattern, text)
            if match is None:
                continue
            word = "_".join(filter(None, (match["word"], match.groupdict().get("rest"))))
            if word in channel_of:
                return channel_of[word], match["number"]
    return None


def other_unit(channel: Channel, headers: Sequence[str]) -> tuple[str, str] | None:
    """The first header that names a part of this command in another unit, and that unit."""
    if channel.role != "command" or not channel.acts_on:
        return None
    for unit in COMMANDS:
        other = replace(channel, units=(unit,) * len(channel.parts))
        named, channel_of = _part_headers([other]), _channels_by_word([other])
        for header in headers:
            variants = _header_variants(normal(split_unit(header)[0]))
            if any(text in named for text in variants) or _numbered_part(variants, channel_of):
                return header, unit
    return None


def settle_bare(meanings: HeaderMeanings, channels: dict[str, Channel], where: str) -> None:
    """Adds bare names to the one channel that they complete.

    Raises:
        DataError: a column may be either of two channels.
    """
    whole: dict[str, list[str]] = {}
    for name, columns in meanings.bare.items():
        named = meanings.named.get(name, {})
        missing = [part for part in channels[name].parts if part not in named]
        if missing and name not in meanings.numbered and all(part in columns for part in missing):
            for part in missing:
                whole.setdefault(columns[part][0].name, []).append(name)
    for header, names in whole.items():
        if len(names) > 1:
            raise DataError(
                f"column '{header}' may belong to the channel {' or '.join(names)}",
                where=where,
                next_step=f"Name it {' or '.join(f'{name}_{normal(header)}' for name in names)}.",
            )
    for name in {n for names in whole.values() for n in names}:
        by_part = meanings.named.setdefault(name, {})
        by_part |= {part: columns for part, columns in meanings.bare[name].items() if part not in by_part}
