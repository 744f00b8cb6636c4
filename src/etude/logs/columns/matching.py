"""Matching of a file's columns to parts of channels: by name, in any order.

A header is read as CHANNEL and PART (a joint, an axis, a motor) in either order, joined by any punctuation,
in any case, with an optional unit: `q_elbow`, `elbow.position`, `/joint_states/elbow/effort`, `gyro.x`,
`Elbow Velocity [deg/s]`. Instead of the part's name, its number is accepted (`q0` .. or `position_1` ..), in
the channel's order, or as the numbers at the end of the parts' names. Words are rows of `vocabulary`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from etude.errors import DataError
from etude.logs.columns.families import answer, family_of, rivals
from etude.logs.columns.header_units import NUMBER, UNITS_TO_USE, same_dimension, unit_in
from etude.logs.columns.headers import Column, HeaderMeanings, other_unit, read_headers, settle_bare, words_of
from etude.logs.columns.vocabulary import SENSORS, split_unit
from etude.types import Channel

LISTED = 12  # columns in a message


@dataclass(frozen=True)
class Matching:
    """Meanings of the headers of a file.

    Attributes:
        channels: the columns of each channel in the order of its parts.
        ignored: headers without a meaning. repairs: sentences to report.
        families: of the commands, if others than those in `channels` may be meant: the columns of each
            family, that in `channels` first.
    """

    channels: dict[str, tuple[Column, ...]]
    ignored: tuple[str, ...]
    repairs: tuple[str, ...]
    families: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def match_columns(
    headers: Sequence[str], channels: Sequence[Channel], where: str, mapped: Collection[str] = ()
) -> Matching:
    """Finds the columns of every channel; optional channels may be absent.

    Args:
        mapped: headers from [log.columns]: a part that one of them names has no other column.

    Raises:
        DataError: a required channel lacks a part, a part has two columns, a unit is unknown, or the
            numbering does not fit; names the file, the columns, the parts expected and what to do.
    """
    meanings = read_headers(headers, channels, where)
    settle_bare(meanings, {c.name: c for c in channels}, where)
    matched: dict[str, tuple[Column, ...]] = {}
    repairs: list[str] = []
    for channel in sorted(channels, key=lambda c: not c.required):
        columns = _of_channel(channel, _prefer_mapped(meanings, channel, mapped), repairs, where)
        if columns is not None:
            matched[channel.name] = columns
    used = {column.name for columns in matched.values() for column in columns}
    ignored = tuple(header for header in headers if header not in used)
    if ignored:
        repairs.append(f"Unknown columns were ignored: {', '.join(ignored)}.")
    families = _families(channels, matched, ignored, mapped)
    matched = {c.name: matched[c.name] for c in channels if c.name in matched}
    return Matching(matched, ignored, tuple(repairs), families)


def _prefer_mapped(meanings: HeaderMeanings, channel: Channel, mapped: Collection[str]) -> HeaderMeanings:
    """The columns, in which parts named by [log.columns] have no other candidates."""
    if not mapped:
        return meanings

    def chosen(of: Mapping[str, dict[str, list[Column]]]) -> dict[str, dict[str, list[Column]]]:
        preferred = {
            p: [c for c in cs if c.name in mapped] or cs for p, cs in of.get(channel.name, {}).items()
        }
        return {**of, channel.name: preferred} if preferred else dict(of)

    named, numbered = chosen(meanings.named), chosen(meanings.numbered)
    numbers = [c for cs in numbered.get(channel.name, {}).values() for c in cs if c.name in mapped]
    if numbers and not any(c.name in mapped for cs in named.get(channel.name, {}).values() for c in cs):
        named.pop(channel.name, None)
    return replace(meanings, named=named, numbered=numbered)


def _families(
    channels: Sequence[Channel],
    matched: Mapping[str, tuple[Column, ...]],
    ignored: Sequence[str],
    mapped: Collection[str],
) -> dict[str, tuple[str, ...]]:
    """All families that may be the command of coordinates, if there are several."""
    for channel in channels:
        names = [column.name for column in matched.get(channel.name, ())]
        if channel.role != "command" or not channel.acts_on or not names or set(names) & set(mapped):
            continue
        others = rivals(channel, names, ignored)
        if others:
            return {family_of(names[0], channel)[0]: tuple(names), **others}
    return {}


def _of_channel(
    channel: Channel, meanings: HeaderMeanings, repairs: list[str], where: str
) -> tuple[Column, ...] | None:
    """The channel's columns in the order of its parts; None if the file has none, or too few of an aside."""
    by_part = meanings.named.get(channel.name, {})
    if channel.name in SENSORS or channel.role == "plan":
        by_part = _first_spelling(by_part, channel)
    numbered = meanings.numbered.get(channel.name, {})
    if numbered and not by_part and _uses_numbers(channel, numbered):
        by_part = _by_number(channel, numbered, repairs, where)
    missing = [part for part in channel.parts if part not in by_part]
    if not missing:
        by_part = _in_its_unit(channel, by_part)
        _check_single(channel, by_part, where)
        columns, sentences = _in_drive_units(
            channel, tuple(by_part[part][0] for part in channel.parts), where
        )
        repairs += sentences
        return columns
    if channel.required or (by_part and channel.role == "state" and channel.name not in SENSORS):
        raise DataError(
            f"no column for channel '{channel.name}' of {', '.join(missing)}",
            where=where,
            next_step=_advice(channel, missing[0], meanings.ignored),
        )
    if by_part:
        repairs.append(f"Channel {channel.name} lacks {', '.join(missing)} and was ignored.")
    return None


def _first_spelling(by_part: dict[str, list[Column]], channel: Channel) -> dict[str, list[Column]]:
    """The columns of the first word that has them all, each once; as they are if none has."""
    for word in sorted({column.word for columns in by_part.values() for column in columns}):
        spelled = {part: [c for c in columns if c.word == word][:1] for part, columns in by_part.items()}
        if all(spelled.get(part) for part in channel.parts):
            return spelled
    return by_part


def _uses_numbers(channel: Channel, numbered: dict[str, list[Column]]) -> bool:
    """Whether numbered columns are used or refused; those of optional channels may be ignored."""
    needed = channel.required or (channel.role == "state" and channel.name not in SENSORS)
    return needed or len(numbered) == len(channel.parts)


def _by_number(
    channel: Channel, numbered: dict[str, list[Column]], repairs: list[str], where: str
) -> dict[str, list[Column]]:
    part_of = {match.group(): part for part in channel.parts if (match := re.search(r"\d+$", part))}
    if len(part_of) == len(channel.parts) and set(part_of) == set(numbered):
        return {part_of[number]: columns for number, columns in numbered.items()}
    numbers = sorted(numbered, key=int)
    first = int(numbers[0])
    if first not in (0, 1) or [int(n) for n in numbers] != list(range(first, first + len(channel.parts))):
        raise DataError(
            f"the columns of channel '{channel.name}' are numbered {', '.join(numbers[:LISTED])}, which are "
            f"not the {len(channel.parts)} parts {', '.join(channel.parts)}",
            where=where,
            next_step=f"Put the part's name into each header, for example {channel.name}_{channel.parts[0]}.",
        )
    names = ", ".join(numbered[number][0].name for number in numbers)
    repairs.append(f"Columns {names} were read as {', '.join(channel.parts)}, in this order.")
    return {part: numbered[number] for part, number in zip(channel.parts, numbers, strict=True)}


def _in_its_unit(channel: Channel, by_part: dict[str, list[Column]]) -> dict[str, list[Column]]:
    """The columns, and of a part that has several the one whose header states a unit of the channel."""
    selected = dict(by_part)
    for part, unit in zip(channel.parts, channel.units, strict=True):
        candidates = [c for c in by_part[part] if c.stated and same_dimension(c.unit, unit)]
        if len(by_part[part]) > 1 and len(candidates) == 1:
            selected[part] = candidates
    return selected


def _check_single(channel: Channel, by_part: dict[str, list[Column]], where: str) -> None:
    double = [[c.name for c in columns] for columns in by_part.values() if len(columns) > 1]
    if double:
        families = [family_of(name, channel)[0] for name in double[0]]
        which = f"{answer(channel, families)} " if all(families) and len(channel.parts) > 1 else ""
        raise DataError(
            f"columns {' and '.join(double[0])} mean the same thing (channel '{channel.name}')",
            where=where,
            next_step=f'{which}Remove one of them, rename it, or ignore it: ignored = ["header"] in [log].',
        )


def _in_drive_units(
    channel: Channel, columns: Sequence[Column], where: str
) -> tuple[tuple[Column, ...], list[str]]:
    """The columns, those in a unit of the drive (counts, %) as they are; a sentence names these.

    Such a unit has no known factor to the channel's.

    Raises:
        DataError: a command is stated in the unit of another quantity, some commands are in a unit of the
            drive and others are not, or the coordinates are in counts.
    """
    if not channel.acts_on and channel.role == "command":
        return tuple(columns), []
    taken = tuple(_in_drive_unit(channel, c, u, where) for c, u in zip(columns, channel.units, strict=True))
    changed = [column.name for column, before in zip(taken, columns, strict=True) if column is not before]
    if changed and len(changed) < len(columns):
        others = [column.name for column in columns if column.name not in changed]
        raise _mixed_units(channel, changed, others, where)
    advice = "[log.columns] of campaign.toml accepts a scale"
    sentence = f"Commands stay in the unit of the drive: {', '.join(changed)}; {advice}."
    return taken, [sentence] if changed else []


def _in_drive_unit(channel: Channel, column: Column, unit: str, where: str) -> Column:
    stated, expected = unit_in(column.unit), unit_in(unit)
    if not column.unit or stated is None or expected is None or stated.dimension == expected.dimension:
        return column
    if channel.role == "command" and (stated.counted or stated.dimension == NUMBER):
        return replace(column, factor=1.0)
    if stated.counted or channel.role == "command":
        raise _other_unit(channel, column, unit, where)
    return column


def _mixed_units(channel: Channel, drive: Sequence[str], others: Sequence[str], where: str) -> DataError:
    factor = f'"{split_unit(drive[0])[0]}" = "FACTOR * HEADER"'
    return DataError(
        f"commands in a unit of the drive ({', '.join(drive)}) stand beside others ({', '.join(others)})",
        where=where,
        next_step="State in the table [log.columns] of campaign.toml what one is in "
        f"{channel.units[0]}, as in {factor}. HEADER is the file's, and FACTOR the number "
        f"of {channel.units[0]} in one of its units, negative if the column has the opposite sign.",
    )


def _other_unit(channel: Channel, column: Column, unit: str, where: str) -> DataError:
    to = f'"{channel.name}_{channel.parts[0]} [{unit}]" = "0.01 * {column.name}"'
    return DataError(
        f"the column is in {column.written_unit}, but {channel.name} is in {unit}",
        where=f"{where}, column '{column.name}'",
        next_step=f"State the scale to {unit} in the table [log.columns] of campaign.toml, as in {to}; or "
        f"correct the header or the robot file. {UNITS_TO_USE}",
    )


def _advice(channel: Channel, part: str, ignored: list[str]) -> str:
    examples = dict.fromkeys(f"{word}_{part}" for word in words_of(channel)[:2])
    near = difflib.get_close_matches(f"{channel.name}_{part}", ignored, n=3, cutoff=0.5)
    more = f" and {len(ignored) - LISTED} more" if len(ignored) > LISTED else ""
    others = f" Not understood: {', '.join(ignored[:LISTED])}{more}." if ignored else ""
    hint = f" Perhaps {' or '.join(near)} means {channel.name}_{part}." if near else ""
    unit = other_unit(channel, ignored)
    unit_advice = (
        f' {unit[0]} and similar units are read if the robot file states command_unit = "{unit[1]}".'
        if unit
        else ""
    )
    return (
        f"Expected {', '.join(channel.parts)}, in headers such as "
        f"{', '.join(examples)}.{others}{unit_advice}{hint} Rename the columns, correct the names in the "
        "robot file, or map the columns in [log.columns]: etude inspect LOG --robot ROBOT "
        "--write-mapping."
    )
