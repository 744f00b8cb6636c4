"""An MCAP that was cut, given an end: what a recorder wrote before it lost power is whole, and is kept.

Records are an opcode, a length (8 bytes) and so many bytes; https://mcap.dev/spec. Messages stand in chunks,
of which the last is usually torn: its whole records are taken out of it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
FOOTER = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + MAGIC
"""An end that says nothing of an index, so that readers scan the records themselves."""
HEAD = 9
"""Bytes of opcode and length."""
CHUNK, CHUNK_FIXED = 6, 28
BLOCK = 2**20
LEAST_BOMB = 2**15
"""Bytes of a packed chunk from which it can hold a gigabyte: zstd's repeated bytes are 4 of 128 KiB."""


def is_cut(path: Path) -> bool:
    """Whether a file begins as an MCAP and does not end as one."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(len(MAGIC))
        file.seek(max(size - len(MAGIC), 0))
        return start == MAGIC and (size < 2 * len(MAGIC) or file.read() != MAGIC)


def mend(path: Path, target: Path, unzstd: Callable[[bytes], bytes]) -> None:
    """Writes to `target` the whole records of `path`, and an end.

    Args:
        unzstd: as much of torn data as can be decompressed.
    """
    size = path.stat().st_size
    with path.open("rb") as file, target.open("wb") as out:
        place = len(MAGIC)
        while place < size:
            file.seek(place)
            end = place + HEAD + int.from_bytes(file.read(HEAD)[1:], "little")
            if end > size or size - place < HEAD:
                break
            place = end
        file.seek(0)
        left = place
        while left > 0 and (block := file.read(min(left, BLOCK))):
            out.write(block)
            left -= len(block)
        out.write(_whole(_torn_chunk(file.read(), unzstd)))
        out.write(FOOTER)


def check_chunks(path: Path, count: Callable[[bytes, bytes], None]) -> None:
    """Asks of each chunk that could unpack to much whether it does.

    Args:
        count: packing and packed records -> DataError, if these are too many.
    """
    size, place = path.stat().st_size, len(MAGIC)
    with path.open("rb") as file:
        while place + HEAD <= size:
            file.seek(place)
            head = file.read(HEAD)
            length = int.from_bytes(head[1:], "little")
            if head[0] == CHUNK and length >= LEAST_BOMB:
                chunk = file.read(min(length, size - place))
                words = int.from_bytes(chunk[CHUNK_FIXED : CHUNK_FIXED + 4], "little")
                start = CHUNK_FIXED + 4 + words
                count(chunk[CHUNK_FIXED + 4 : start], chunk[start + 8 :])
            place += HEAD + length


def _torn_chunk(torn: bytes, unzstd: Callable[[bytes], bytes]) -> bytes:
    """The records in the beginning of a chunk; none if it is another record, or packed in another way."""
    if not torn or torn[0] != CHUNK:
        return b""
    start = HEAD + CHUNK_FIXED
    length = int.from_bytes(torn[start : start + 4], "little")
    packing, records = torn[start + 4 : start + 4 + length], torn[start + 4 + length + 8 :]
    if packing == b"zstd":
        return unzstd(records)
    return records if packing == b"" else b""


def _whole(records: bytes) -> bytes:
    """As many records as are whole."""
    place = 0
    while place + HEAD <= len(records):
        end = place + HEAD + int.from_bytes(records[place + 1 : place + HEAD], "little")
        if end > len(records):
            break
        place = end
    return records[:place]
