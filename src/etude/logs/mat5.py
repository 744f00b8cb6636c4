"""MATLAB's binary format, versions 5 to 7.2, as far as logs need it: arrays of numbers, and structs of them.

Read here since SciPy's reader ends the program on some damaged files. The format is published by MathWorks
("MAT-File Format"): elements of a type, a length and data, padded to 8 bytes; variables are elements of such.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from etude.logs.unpacking import Room
from etude.types import Array

HEADER = 128
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
STRUCT, NUMERIC = 2, range(6, 16)
"""Classes of arrays."""
DEEPEST = 8
"""Structs within structs."""

Variable = Array | Mapping[str, Any]


def variables(data: bytes, room: Room) -> dict[str, Variable]:
    """Name -> (rows, columns) numbers, or a mapping of such for a struct; all else is left out.

    Raises:
        ValueError, struct.error, zlib.error: damaged, or another format. DataError: they have no room.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("it does not begin as one")
    found = {}
    for kind, content in _elements(data[HEADER:], order):
        for name, value in _variable(kind, content, order, room):
            found[name] = value
    return found


def _variable(kind: int, content: bytes, order: str, room: Room) -> Iterator[tuple[str, Variable]]:
    if kind == COMPRESSED:
        unpacked = zlib.decompressobj().decompress(content, room.left + 1)
        room.take(len(unpacked))
        for inner, own in _elements(unpacked, order):
            if inner != COMPRESSED:
                yield from _variable(inner, own, order, room)
    elif kind == MATRIX:
        name, value = _matrix(content, order, 0, room)
        if value is not None:
            yield name, value


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of each element in turn."""
    place = 0
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # a small one, whose data stand in the length's place
            kind, size, start, place = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            place = start + (size if kind == COMPRESSED else -(-size // 8) * 8)
        if start + size > len(data):
            raise ValueError("an element is longer than what is left")
        yield kind, data[start : start + size]


def _matrix(content: bytes, order: str, depth: int, room: Room) -> tuple[str, Variable | None]:
    """Name and value of an array; None for what is neither numbers nor a single struct of them."""
    parts = _elements(content, order)
    flags = _numbers(*_next(parts), order)
    dimensions = [int(n) for n in _numbers(*_next(parts), order)]
    name = _next(parts)[1].decode(errors="replace")
    kind, count = int(flags[0]) & 0xFF, int(np.prod(dimensions, dtype=object))
    if kind == STRUCT and count == 1 and depth < DEEPEST:
        return name, _struct(parts, order, depth, room)
    if kind not in NUMERIC or len(dimensions) != 2 or not count:
        return name, None
    kind, content = _next(parts)
    room.take(count * np.dtype(np.float64).itemsize)
    values = _numbers(kind, content, order)
    if len(values) != count:
        raise ValueError("an array is not as long as its dimensions say")
    return name, values.reshape(dimensions, order="F")


def _struct(parts: Iterator[tuple[int, bytes]], order: str, depth: int, room: Room) -> dict[str, Any]:
    length = int(_numbers(*_next(parts), order)[0])
    text = _next(parts)[1]
    if length < 1:
        raise ValueError("a struct has fields without names")
    names = [text[i : i + length].split(b"\0")[0] for i in range(0, len(text), length)]
    found = {}
    for field in (name.decode(errors="replace") for name in names):
        kind, content = _next(parts)
        value = _matrix(content, order, depth + 1, room)[1] if kind == MATRIX and content else None
        if value is not None:
            found[field] = value
    return found


def _next(parts: Iterator[tuple[int, bytes]]) -> tuple[int, bytes]:
    part = next(parts, None)
    if part is None:
        raise ValueError("an array ends too early")
    return part


def _numbers(kind: int, content: bytes, order: str) -> Array:
    """(n,) of an element of numbers, at least one."""
    if kind not in NUMBERS:
        raise ValueError(f"type {kind} is no number")
    values = np.frombuffer(content, dtype=np.dtype(order + NUMBERS[kind]))
    if not len(values):
        raise ValueError("an element without numbers")
    return np.asarray(values, dtype=np.float64)
