"""MATLAB's binary format, versions 5 to 7.2, as far as logs need it: arrays of numbers, and structs of them.

Read here since SciPy's reader ends the program on some damaged files. The format is published by MathWorks
("MAT-File Format"): elements of a type, a length and data, padded to 8 bytes; variables are elements of such.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from etude.logs.readers.unpacking import BLOCK, Room, as_float
from etude.types import Array

HEADER = 128
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
STRUCT, NUMERIC = 2, range(6, 16)
"""Classes of arrays."""
DEEPEST = 8
"""Structs within structs."""

Variable = Array | Mapping[str, Any]


def variables(file: BinaryIO, room: Room) -> dict[str, Variable]:
    """Name -> (rows, columns) numbers, or a mapping of such for a struct; all else is left out.

    Nothing of the file is held but the numbers: what is packed is unpacked block by block.

    Raises:
        ValueError, struct.error, zlib.error: damaged, or another format. DataError: they have no room.
    """
    head, size = file.read(HEADER), file.seek(0, os.SEEK_END)
    file.seek(HEADER)
    order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
    if order is None:
        raise ValueError("it does not begin as one")
    found = {}
    for kind, content in _elements(Part(file.read, size - HEADER), order):
        for name, value in _variable(kind, content, order, room):
            found[name] = value
    return found


@dataclass
class Part:
    """Bytes that are read in turn.

    Attributes:
        source: gives at most so many of them. left: how many there are; None: until it ends.
        counted: whether they took their room already, as they were unpacked.
    """

    source: Callable[[int], bytes]
    left: int | None
    counted: bool = False

    def read(self, size: int) -> bytes:
        """Exactly so many. ValueError: there are not."""
        if self.left is not None and size > self.left:
            raise ValueError("an element is longer than what is left")
        data = self.source(size)
        if len(data) < size:
            raise ValueError("an element is longer than what is left")
        if self.left is not None:
            self.left -= size
        return data

    def head(self) -> bytes:
        """The next 8; nothing where it ends before."""
        data = b"" if self.left is not None and self.left < 8 else self.source(8)
        if self.left is not None and len(data) == 8:
            self.left -= 8
        return data if len(data) == 8 else b""

    def short(self) -> bytes:
        """All of it, which is a name or a few numbers. ValueError: it is not."""
        if self.left is None or self.left > BLOCK:
            raise ValueError("a name or a size is too long")
        return self.read(self.left)

    def skip(self) -> None:
        """Leaves what was not read."""
        while self.left is None and self.source(BLOCK):
            pass
        while self.left:
            self.read(min(BLOCK, self.left))


class Inflated:
    """What a part is once it is unpacked; counted as it comes."""

    def __init__(self, packed: Part, room: Room) -> None:
        self._packed, self._room = packed, room
        self._unpacker, self._ahead = zlib.decompressobj(), bytearray()

    def read(self, size: int) -> bytes:
        """At most so many bytes: less at the end."""
        while len(self._ahead) < size and self._more():
            pass
        data = bytes(self._ahead[:size])
        del self._ahead[:size]
        return data

    def _more(self) -> bool:
        if self._unpacker.eof:
            return False
        packed = self._unpacker.unconsumed_tail or self._packed.read(min(BLOCK // 64, self._packed.left or 0))
        block = self._unpacker.decompress(packed, BLOCK)
        self._room.take(len(block))
        self._ahead += block
        return bool(packed or block)


def _variable(kind: int, content: Part, order: str, room: Room) -> Iterator[tuple[str, Variable]]:
    if kind == COMPRESSED:
        inner = Part(Inflated(content, room).read, None, counted=True)
        for own, part in _elements(inner, order):
            if own != COMPRESSED:
                yield from _variable(own, part, order, room)
        inner.skip()  # to where its checksum stands
    elif kind == MATRIX:
        name, value = _matrix(content, order, 0, room)
        if value is not None:
            yield name, value


def _elements(part: Part, order: str) -> Iterator[tuple[int, Part]]:
    """Type and content of each element in turn; what is not read of one is left behind for the next."""
    while head := part.head():
        kind, size = struct.unpack(f"{order}II", head)
        if not kind:  # no type: zeros that fill the end
            return
        if kind >> 16:  # a small one, whose data stand in the length's place
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise ValueError("an element is longer than what is left")
            yield kind, Part(io.BytesIO(head[4:]).read, size)
            continue
        if part.left is not None and size > part.left:
            raise ValueError("an element is longer than what is left")
        own = Part(part.read, size, part.counted)
        yield kind, own
        own.skip()
        padding = 0 if kind == COMPRESSED else -size % 8
        if padding and (part.left is None or part.left >= padding):
            part.read(padding)


def _matrix(content: Part, order: str, depth: int, room: Room) -> tuple[str, Variable | None]:
    """Name and value of an array; None for what is neither numbers nor a single struct of them."""
    parts = _elements(content, order)
    flags = _numbers(*_next(parts), order)
    dimensions = [int(n) for n in _numbers(*_next(parts), order)]
    name = _next(parts)[1].short().decode(errors="replace")
    kind, count = int(flags[0]) & 0xFF, int(np.prod(dimensions, dtype=object))
    if kind == STRUCT and count == 1 and depth < DEEPEST:
        return name, _struct(parts, order, depth, room)
    if kind not in NUMERIC or len(dimensions) != 2 or not count:
        return name, None
    values = _values(*_next(parts), count, order, room)
    return name, values.reshape(dimensions, order="F")


def _values(kind: int, content: Part, count: int, order: str, room: Room) -> Array:
    """(count,) of an element that is as long."""
    number, size = _number(kind, order), content.left
    if size != count * number.itemsize:
        raise ValueError("an array is not as long as its dimensions say")
    whole = count * np.dtype(np.float64).itemsize
    room.require(whole)  # before anything of it is unpacked
    room.take(max(whole - size, 0) if content.counted else whole)
    return as_float(content.read, count, number)


def _struct(parts: Iterator[tuple[int, Part]], order: str, depth: int, room: Room) -> dict[str, Any]:
    length = int(_numbers(*_next(parts), order)[0])
    text = _next(parts)[1].short()
    if length < 1:
        raise ValueError("a struct has fields without names")
    names = [text[i : i + length].split(b"\0")[0] for i in range(0, len(text), length)]
    found = {}
    for field in (name.decode(errors="replace") for name in names):
        kind, content = _next(parts)
        value = _matrix(content, order, depth + 1, room)[1] if kind == MATRIX and content.left else None
        if value is not None:
            found[field] = value
    return found


def _next(parts: Iterator[tuple[int, Part]]) -> tuple[int, Part]:
    part = next(parts, None)
    if part is None:
        raise ValueError("an array ends too early")
    return part


def _numbers(kind: int, content: Part, order: str) -> Array:
    """(n,) of an element of a few numbers, at least one."""
    values = np.frombuffer(content.short(), dtype=_number(kind, order))
    if not len(values):
        raise ValueError("an element without numbers")
    return np.asarray(values, dtype=np.float64)


def _number(kind: int, order: str) -> np.dtype[Any]:
    if kind not in NUMBERS:
        raise ValueError(f"type {kind} is no number")
    return np.dtype(order + NUMBERS[kind])
