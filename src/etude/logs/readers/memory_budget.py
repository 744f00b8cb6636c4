"""Memory limit of a packed file: 1 GB, all of its parts together.

A file of a megabyte can unpack to a hundred thousand times its size. Sizes that it states are not believed
where the unpacking itself can be counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from etude.errors import DataError
from etude.types import Array

LARGEST = 2**30
"""Bytes in memory, of one file."""
BLOCK = 2**20  # bytes unpacked at a time, so that a bomb is noticed early
BESIDE = 16
"""Bytes in memory of a row beside its columns: its time, and its place when times are put in order."""
PIECE = 4
"""Part of the room for what is unpacked whole: it is held twice while it is read."""


@dataclass
class MemoryBudget:
    """Remaining memory for one file.

    Attributes:
        path: of the file. left: bytes.
    """

    path: Path
    left: int = field(default_factory=lambda: LARGEST)

    def require(self, size: int) -> None:
        """Check that so many bytes are left. DataError: there is no room for them."""
        if size > self.left:
            raise too_large(self.path)

    def take(self, size: int) -> None:
        """Count bytes before they are unpacked. DataError: there is no room for them."""
        self.require(size)
        self.left -= size


def as_float(read: Callable[[int], bytes], count: int, number: np.dtype[Any]) -> Array:
    """(count,) numbers of that type, as they are read block by block. ValueError: there are fewer."""
    numbers, each = np.empty(count), BLOCK // number.itemsize
    for place in range(0, count, each):
        block = np.frombuffer(read(min(each, count - place) * number.itemsize), number)
        numbers[place : place + each] = block
    return numbers


class Unpacker(Protocol):
    """A decompressor of the standard library's form, which gives at most so many bytes at a time."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def unpacked(unpacker: Unpacker, data: bytes, path: Path) -> bytes:
    """All of `data`, unpacked. DataError: it is more than a piece of a file may be."""
    return b"".join(blocks_of(unpacker, data, path))


def blocks_of(unpacker: Unpacker, data: bytes, path: Path) -> Iterator[bytes]:
    """The unpacked data block by block; counting them needs memory for one block only."""
    size, packed = 0, data
    while not unpacker.eof:
        part = unpacker.decompress(packed, BLOCK)
        packed, size = b"", size + len(part)
        if size > LARGEST // PIECE:
            raise too_large(path)
        yield part
        if not part and unpacker.needs_input:
            break


def too_large(path: Path) -> DataError:
    """The error on a file that is too large."""
    return DataError(
        f"the file unpacks to more than {LARGEST / 2**30:.0f} GB",
        where=str(path),
        next_step="Save fewer variables in it, or cut the log into several files, and ingest them one by "
        "one.",
    )
