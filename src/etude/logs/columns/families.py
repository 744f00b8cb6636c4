"""Families of equivalent columns: measured torques, commanded torques, and torques from currents.

A family is a word with a column for each part of a channel: `TorqueSm1`, `TorqueSm2`, or `elbow.effort_raw`
and `hip.effort_raw`. Names do not decide which of several families to learn, so Étude asks. The answer is in
[log.columns]: `command = "TorqueSm"` names a whole family. Desired values are no family.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from etude.logs.columns.header_units import same_dimension
from etude.logs.columns.headers import COLUMN, part_names, words_of
from etude.logs.columns.vocabulary import DESIRED, normal, split_suffix, split_unit, unit_of
from etude.types import Channel

LEAST_LETTERS = 3  # of a word for commands inside of another word
OTHER_QUANTITIES = (
    *DESIRED,
    *("limit", "lim", "max", "min", "error", "err", "temp", "temperature", "rate", "dot", "offset", "bias"),
    *("const", "constant", "std", "var", "status", "enable", "enabled", "mode", "ff", "fb", "feedforward"),
    *("feedback", "gain", "ratio", "id", "flag", "ext", "external", "friction", "gravity", "coriolis"),
)
"""Words in a header that mark a torque as another quantity, or as a part of one."""


def members(headers: Iterable[str], family: str) -> dict[str, str]:
    """The columns of a family by the part's number or name; empty if there are none."""
    word, headers_of = re.escape(normal(family)), {}
    for header in headers:
        text = normal(split_suffix(split_unit(header)[0])[0])
        hit = re.fullmatch(rf"{word}_?(?:joint_?|j)?(\d+)|{word}_(.+)|(.+)_{word}", text)
        if hit:
            headers_of[next(group for group in hit.groups() if group)] = header
    return headers_of


def family_of(header: str, channel: Channel) -> tuple[str, str]:
    """The family of a header as written there, and its part of the channel; "" without a family."""
    text = split_suffix(split_unit(header)[0])[0]
    for part in part_names(channel):
        for pattern in (rf"(.+)_{re.escape(part)}", rf"{re.escape(part)}_(.+)"):
            hit = re.fullmatch(pattern, normal(text))
            if hit:
                return hit[1], part
    hit = re.fullmatch(r"(.*[^\W\d_])[\W_]*?(?:joint_?|j)?[\W_]*(\d{1,4})\W*", text, re.IGNORECASE)
    return (hit[1], hit[2]) if hit else ("", "")


def rivals(channel: Channel, used: Sequence[str], left: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Columns, in the order of the headers, of each family that may be the command in place of those `used`.

    Args:
        left: headers that mean nothing else.
    """
    synonyms = [word for word in words_of(channel) if len(word) >= LEAST_LETTERS]
    columns_of: dict[str, dict[str, str]] = {}
    for header in left:
        family, part = family_of(header, channel)
        if family and _may_be(header, normal(family), synonyms, channel):
            columns_of.setdefault(family, {})[part] = header
    families = [family_of(header, channel) for header in used]
    whole = {part for _, part in families}
    return {name: tuple(columns.values()) for name, columns in columns_of.items() if set(columns) == whole}


def _may_be(header: str, family: str, synonyms: Sequence[str], channel: Channel) -> bool:
    unit = unit_of(header)
    if COLUMN.fullmatch(normal(header)) or (unit and not same_dimension(unit, channel.units[0])):
        return False
    tokens = family.split("_")
    if any(token in OTHER_QUANTITIES for token in tokens) or family.endswith(OTHER_QUANTITIES):
        return False
    return any(family.startswith(word) or word in tokens for word in synonyms)


def answer(channel: Channel, families: Iterable[str]) -> str:
    """The next step: the line to write, and its file."""
    lines = " or ".join(f'{channel.name} = "{family}"' for family in families)
    return f"Name the right one in the table [log.columns] of campaign.toml, once for all logs: {lines}."
