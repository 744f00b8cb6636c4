"""How much a packed file may become in memory: 1 GB, all of its parts together.

A file of a megabyte can unpack to a hundred thousand times its size. Sizes that it states are not believed
where the unpacking itself can be counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from etude.errors import DataError

LARGEST = 2**30
"""Bytes in memory, of one file."""
BLOCK = 2**20


@dataclass
class Room:
    """What is left for one file.

    Attributes:
        path: of the file. left: bytes.
    """

    path: Path
    left: int = field(default_factory=lambda: LARGEST)

    def take(self, size: int) -> None:
        """Counts what is about to be unpacked. DataError: there is no room for it."""
        self.left -= size
        if self.left < 0:
            raise too_large(self.path)


class Unpacker(Protocol):
    """A decompressor of the standard library's form, which gives at most so many bytes at a time."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def unpacked(unpacker: Unpacker, data: bytes, path: Path, most: int | None = None) -> bytes:
    """All of `data`, unpacked. DataError: it is more than `most` bytes, `LARGEST` if not said."""
    parts, size, packed = [], 0, data
    while not unpacker.eof:
        part = unpacker.decompress(packed, BLOCK)
        packed, size = b"", size + len(part)
        if size > (LARGEST if most is None else most):
            raise too_large(path)
        parts.append(part)
        if not part and unpacker.needs_input:
            break
    return b"".join(parts)


def too_large(path: Path) -> DataError:
    """What is said of such a file."""
    return DataError(
        f"the file unpacks to more than {LARGEST / 2**30:.0f} GB",
        where=str(path),
        next_step="Save fewer variables in it, or cut the log into several files, and tell them one by one.",
    )
