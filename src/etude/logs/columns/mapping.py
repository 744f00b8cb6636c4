"""Column mapping: the table [log.columns] of campaign.toml, applied to a log or written for one.

    [log.columns]
    "q_shoulder [deg]" = "ActPos1"

reads the column ActPos1 as if its header were `q_shoulder [deg]`. Left is a header as `columns` understands
it (what to write there is listed in `vocabulary`), right the header in the file. A scale or a sign may stand
before it, and a word for the columns of all joints:

    "tau_elbow" = "-0.061 * Cur3"
    "command" = "TorqueSm"
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from etude.errors import DataError, did_you_mean
from etude.logs.columns.families import members
from etude.logs.columns.header_units import NUMBER, unit_in
from etude.logs.columns.headers import HeaderMeanings, read_headers
from etude.logs.columns.vocabulary import NUMBERED, as_written, is_time, normal, split_unit, unit_of
from etude.logs.config import LogConfig
from etude.types import Channel, Log

NEAR, ALIKE = 3, 0.5
"""Headers that are offered for a part that has none, and how much they must resemble it."""
OPTIONAL = "optional"
HEAD = """\
# For the end of campaign.toml, in place of its table [log.columns]. Left: the quantity of the column,
# with its unit in brackets if the file does not state it. Right: its header in the file.
[log.columns]
"""


def mapped(raw: Log, config: LogConfig) -> Log:
    """The raw columns, renamed by the mapping.

    A log that has none of the mapping's headers, and all of the names that they are to be read as, stays as
    it is: a simulated log of the same campaign, for example. A sentence says so.

    Raises:
        DataError: another header of the mapping is not in the file, or the file has no header and the
            mapping names none of its columns.
    """
    return _with_times(_rename(raw, config), config.rate)


def _with_times(raw: Log, rate: float) -> Log:
    """The log with times of equally spaced rows, if it has none and the config states a rate."""
    counted = np.arange(len(raw))
    if not rate or any(is_time(name) for name in raw.values) or not np.array_equal(raw.t, counted):
        return raw
    sentence = (
        f"The log has no times: its rate is {rate:g} rows a second by [log] rate; pauses are not detected."
    )
    return replace(raw, t=counted / rate).repaired(sentence)


def _rename(raw: Log, config: LogConfig) -> Log:
    available = {name: values for name, values in raw.values.items() if name not in config.ignored}
    named = _sources(config.columns, available)
    _check_unique(named, raw.source)
    used = {to: source for to, source in named.items() if source.header in available}
    if not used:
        _check_header(raw)
        if all(_has_column(available, to) for to in named):
            return _with_columns(raw, available).repaired(*([AS_NAMED] if named else []))
    missing = [source.header for source in named.values() if source.header not in available]
    if missing:
        hint = did_you_mean(missing[0], available)
        hint = 'Write a factor first, with a decimal point: "-0.15 * HEADER". ' if "*" in missing[0] else hint
        raise DataError(
            f"there is no column {missing[0]!r}, which [log.columns] names",
            where=raw.source,
            next_step=f"{hint}Correct it in campaign.toml; the file has {', '.join(list(available)[:40])}.",
        )
    read = {_with_unit(to, source): source.scale * available[source.header] for to, source in used.items()}
    taken = {source.header for source in used.values()}
    unnamed = {name: values for name, values in available.items() if name not in taken and name not in read}
    pairs = ", ".join(f"{source.term} as {to}" for to, source in used.items())
    return _with_columns(raw, {**read, **unnamed}).repaired(f"By [log.columns], {pairs} were read.")


def _check_unique(named: Mapping[str, _Source], where: str) -> None:
    """Raises a DataError if one column of the file is to be read as two."""
    first: dict[str, str] = {}
    for to, source in named.items():
        other = first.setdefault(source.header, to)
        if other != to:
            raise DataError(
                f"[log.columns] reads the column {source.header!r} as {other} and as {to}",
                where=where,
                next_step="Correct one of the two lines in campaign.toml.",
            )


AS_NAMED = "The log has none of the headers of [log.columns], so its own headers were used."


def _has_column(headers: Collection[str], to: str) -> bool:
    """Whether a file has a column that is named as a column is to be read, in any unit."""
    if is_time(to):
        return any(is_time(header) for header in headers)
    name = normal(split_unit(to)[0])
    return any(normal(split_unit(header)[0]) == name for header in headers) or bool(members(headers, name))


class _Source(NamedTuple):
    """A column of the file, and its factor."""

    header: str
    scale: float = 1.0

    @property
    def term(self) -> str:
        return self.header if self.scale == 1.0 else f"{self.scale:g} * {self.header}"


SCALED = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*\*\s*(.+)")
TURNED = re.compile(r"\s*-\s*(.+)")


def _sources(columns: Mapping[str, str], headers: Collection[str]) -> dict[str, _Source]:
    """Name of each column -> its source in the file; a word for all joints gives one entry for each joint."""
    sources: dict[str, _Source] = {}
    for to, text in columns.items():
        header, scale = _source(text, headers)
        parts = {} if header in headers else members(headers, header)
        bare, unit = split_unit(to)
        unit = f" [{unit}]" if unit else ""
        entries = {f"{bare}_{part}{unit}": _Source(name, scale) for part, name in parts.items()}
        sources |= entries or {to: _Source(header, scale)}
    return sources


def _source(text: str, headers: Collection[str]) -> _Source:
    """ "0.5 * Cur1" or "-Cur1"; a header that is in the file as it stands is one."""
    scaled, turned = SCALED.fullmatch(text), TURNED.fullmatch(text)
    if text in headers or not (scaled or turned):
        return _Source(text)
    if scaled:
        return _Source(scaled[2].strip(), float(scaled[1]))
    assert turned is not None
    return _Source(turned[1].strip(), -1.0)


def _check_header(raw: Log) -> None:
    """Raises a DataError if the file has no header, so that its columns have no meaning."""
    if f"{NUMBERED} 1" in raw.values:
        raise DataError(
            f"the file has no header, only {len(raw.values)} columns of numbers",
            where=raw.source,
            next_step="Name them in the table [log.columns] of campaign.toml, as in "
            f'"t" = "{NUMBERED} 1", or add a header row such as t,q_<joint>,tau_<joint>.',
        )


def mapping_text(headers: Sequence[str], channels: Sequence[Channel], where: str = "") -> str:
    """TOML of a mapping for a log with these headers: what is understood, and a blank for what is needed.

    Args:
        headers: of the raw log, `list(readers.read_raw(path).values)`.
        channels: of the robot, `kind.channels(spec)`.
        where: the file, for messages.

    Raises:
        DataError: a header has a meaning and an unknown unit.
    """
    meanings = read_headers([name for name in headers if not is_time(name)], channels, where)
    times = [_entry("t", name) for name in headers if is_time(name)][:1] or [_blank("t", headers)]
    lines = [line for channel in channels for line in _lines(channel, meanings)]
    unused = [f"# Not understood: {', '.join(map(_quoted, meanings.ignored))}"] if meanings.ignored else []
    return HEAD + "\n".join([*times, *lines, *unused]) + "\n"


def _lines(channel: Channel, meanings: HeaderMeanings) -> list[str]:
    """A line for each part of a channel that the log has, must have, or that may be a model input."""
    named = meanings.named.get(channel.name, {})
    numbered = meanings.numbered.get(channel.name, {})
    if not named and len(numbered) == len(channel.parts):
        numbers = sorted(numbered, key=int)
        named = {part: numbered[n] for part, n in zip(channel.parts, numbers, strict=True)}
    whole = all(part in named for part in channel.parts)
    if not (whole or channel.required or channel.role == "state"):
        return []
    note = "" if channel.required else OPTIONAL
    return [
        _entry(f"{channel.name}_{part}", named[part][0].name)
        if part in named
        else _blank(f"{channel.name}_{part}", meanings.ignored, note)
        for part in channel.parts
    ]


def _entry(to: str, header: str) -> str:
    return f"{_quoted(to)} = {_quoted(header)}"


def _blank(to: str, headers: Sequence[str], note: str = "") -> str:
    near = difflib.get_close_matches(to, headers, NEAR, cutoff=ALIKE)
    hint = f"{' or '.join(_quoted(header) for header in headers if header in near)}?" if near else ""
    comment = ", ".join(part for part in (note, hint) if part)
    return f"# {_quoted(to)} = {_quoted('')}" + (f"  # {comment}" if comment else "")


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _with_unit(to: str, source: _Source) -> str:
    """The name with the file's unit, unless another is stated, or a scale converts counts or fractions."""
    unit = unit_of(source.header)
    parsed = unit_in(unit)
    whole = parsed is None or not (parsed.counted or parsed.dimension == NUMBER)
    keeps_unit = unit and not split_unit(to)[1] and (whole or abs(source.scale) == 1.0)
    return f"{to} [{as_written(source.header, unit)}]" if keeps_unit else to


def _with_columns(raw: Log, values: Mapping[str, object]) -> Log:
    channels = {name: Channel(name, ("",), ("",), "aside") for name in values}
    return replace(raw, channels=channels, values=dict(values))  # type: ignore[arg-type]
