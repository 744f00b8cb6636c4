"""Is a Parquet file whole? Its own counts and sizes are checked before a decoder trusts them.

A decoder that believes a damaged count asks for more memory than there is, which no exception tells of: the
program ends. So footer and page headers are read here first, as far as they count something.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from etude.logs.readers.unpacking import BESIDE, Room

MAGIC = b"PAR1"
DEEPEST = 32  # structs within structs
DATA, DICTIONARY, DATA_V2 = 0, 2, 3  # types of pages
LARGEST_RATIO = 2**17  # of a page's size to its compressed size: run lengths of zeros
NUMBER = 8  # bytes of a value in memory, of run lengths too
OF_LIST = 24  # and of one in a list, which is held as a table and as an array at once
LEAST = 2**20  # bytes of a page that are always believed


def check_shape(data: bytes, room: Room) -> None:
    """Checks the counts and sizes in a Parquet file.

    Raises:
        ValueError: with what does not fit. DataError: there is no room for its values.
    """
    if len(data) < 12 or data[:4] != MAGIC or data[-4:] != MAGIC:
        raise ValueError("it does not begin and end as a Parquet file")
    length = int.from_bytes(data[-8:-4], "little")
    if length > len(data) - 12:
        raise ValueError("its footer is longer than the file")
    end = len(data) - 8 - length
    footer, _ = _struct(data, end, len(data) - 8)
    groups = footer.get(4, [])
    if sum(group[3] for group in groups) != footer.get(3, 0):
        raise ValueError("its row groups do not add up to its rows")
    room.take(BESIDE * max(int(footer.get(3, 0)), 0))
    for group in groups:
        for chunk in group[1]:
            whole = NUMBER if len(chunk[3][3]) == 1 else OF_LIST
            room.take(whole * max(int(chunk[3][5]), 0))
            _check_chunk(data, end, chunk[3], group[3])


def _check_chunk(data: bytes, end: int, chunk: Mapping[int, Any], rows: int) -> None:
    """Walks the pages of one column in one row group."""
    values, size = chunk[5], chunk[7]
    if values == 0:
        return
    start = min(chunk[9], chunk.get(11) or chunk[9])
    if not (4 <= start <= start + size <= end) or values < 1 or (len(chunk[3]) == 1 and values != rows):
        raise ValueError("a column is not where the footer says, or not as long")
    stop, seen = start + size, 0
    while seen < values:
        header, start = _struct(data, start, stop)
        packed, unpacked = header[3], header[2]
        if not (0 <= packed <= stop - start and 0 <= unpacked <= max(LEAST, LARGEST_RATIO * packed)):
            raise ValueError("a page is longer than its column")
        seen += _values(header, unpacked)
        start += packed
    if seen != values:
        raise ValueError("the pages of a column do not add up to its values")


def _values(header: Mapping[int, Any], unpacked: int) -> int:
    """Values of a data page; 0 of others."""
    kind = header[1]
    if kind == DICTIONARY:
        if not 0 <= header[7][1] <= unpacked:
            raise ValueError("a dictionary counts more values than it can hold")
        return 0
    if kind not in (DATA, DATA_V2):
        return 0
    own = header[5 if kind == DATA else 8]
    count = int(own[1])
    levels = own.get(5, 0) + own.get(6, 0) if kind == DATA_V2 else 0
    nulls = own.get(2, 0) if kind == DATA_V2 else 0
    if count < 0 or not 0 <= nulls <= count or not 0 <= levels <= unpacked:
        raise ValueError("a page counts more values than it can hold")
    return count


def _struct(data: bytes, place: int, stop: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Fields by number of a struct in Thrift's compact protocol, and the place behind it."""
    if depth > DEEPEST:
        raise ValueError("its footer is nested too deeply")
    fields: dict[int, Any] = {}
    number = 0
    while True:
        byte, place = _byte(data, place, stop), place + 1
        if byte == 0:
            return fields, place
        if byte >> 4:
            number += byte >> 4
        else:
            number, place = _signed(data, place, stop)
        kind = byte & 15
        if kind in (1, 2):
            fields[number] = kind == 1
        else:
            fields[number], place = _value(kind, data, place, stop, depth)


def _value(kind: int, data: bytes, place: int, stop: int, depth: int) -> tuple[Any, int]:
    if kind in (1, 2, 3):
        return _byte(data, place, stop), place + 1
    if kind in (4, 5, 6):
        return _signed(data, place, stop)
    if kind == 7:
        return None, _within(place + 8, stop)
    if kind == 8:
        length, place = _varint(data, place, stop)
        return None, _within(place + length, stop)
    if kind in (9, 10):
        return _list(data, place, stop, depth)
    if kind == 12:
        return _struct(data, place, stop, depth + 1)
    raise ValueError("its footer cannot be read")


def _list(data: bytes, place: int, stop: int, depth: int) -> tuple[list[Any], int]:
    head, place = _byte(data, place, stop), place + 1
    count, kind = head >> 4, head & 15
    if count == 15:
        count, place = _varint(data, place, stop)
    if count > stop - place:
        raise ValueError("its footer is cut")
    found = []
    for _ in range(count):
        item, place = _value(kind, data, place, stop, depth + 1)
        found.append(item)
    return found, place


def _byte(data: bytes, place: int, stop: int) -> int:
    if place >= stop:
        raise ValueError("its footer is cut")
    return data[place]


def _within(place: int, stop: int) -> int:
    if place > stop:
        raise ValueError("its footer is cut")
    return place


def _varint(data: bytes, place: int, stop: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte, place = _byte(data, place, stop), place + 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, place
        shift += 7
        if shift > 63:
            raise ValueError("its footer cannot be read")


def _signed(data: bytes, place: int, stop: int) -> tuple[int, int]:
    value, place = _varint(data, place, stop)
    return (value >> 1) ^ -(value & 1), place
