"""ROS 2 recordings as files: folders, bare storages, compressed ones, and storages that were cut.

rosbag2 writes a folder with metadata.yaml and one or several storages (SQLite or MCAP), which may be
compressed as a whole or message by message. A recorder that was killed leaves no metadata, and an MCAP
without its end.

Records are an opcode, a length (8 bytes) and so many bytes; https://mcap.dev/spec. Messages stand in chunks,
of which the last is usually torn: its whole records are taken out of it.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from etude.errors import DataError
from etude.logs.readers.extras import READING, needed
from etude.logs.readers.memory_budget import LARGEST, PIECE, blocks_of, unpacked

STORAGES = (".db3", ".mcap")
METADATA = "metadata.yaml"
ZSTD = b"\x28\xb5\x2f\xfd"
CUT = "The bag was cut: it has no end, and what was recorded last is missing."
LARGEST_RATIO = 1000
"""Of a storage's size to its compressed size."""
BLOCK = 2**20  # bytes in memory at a time


def is_bag_folder(path: Path) -> bool:
    """Whether a folder holds a recording of ROS 2."""
    return path.is_dir() and ((path / METADATA).is_file() or bool(_storages(path)))


@contextlib.contextmanager
def opened(path: Path) -> Iterator[tuple[list[Any], tuple[str, ...]]]:
    """The readers (`rosbags.rosbag2.Reader`) of a recording, and what was done to open them."""
    rosbag2 = needed("rosbags.rosbag2", READING, path)
    with ExitStack() as stack:
        repairs: tuple[str, ...] = ()
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        if path.is_dir() and (path / METADATA).is_file() and not any(map(_is_cut, _storages(path))):
            files = [path]
        else:
            bare = _storages(path) if path.is_dir() else [path]
            mended = [_mended(_unpacked(one, folder), folder) for one in bare]
            files = [one for one, _ in mended]
            repairs = (CUT,) if any(cut for _, cut in mended) else ()
        for one in files:
            _check_room(one)
        yield [stack.enter_context(rosbag2.Reader(one)) for one in files], repairs


def decompressed(data: bytes, path: Path) -> bytes:
    """A message as it was before it was compressed, if it was."""
    return unpacked(_zstd(path).ZstdDecompressor(), data, path) if data[:4] == ZSTD else data


def _storages(folder: Path) -> list[Path]:
    ends = (*STORAGES, *(f"{one}.zstd" for one in STORAGES))
    return sorted(one for one in folder.iterdir() if one.is_file() and one.name.endswith(ends))


def _unpacked(path: Path, folder: Path) -> Path:
    """A storage, decompressed into `folder` if it is compressed as a whole."""
    if path.suffix not in (".zstd", ".zst"):
        return path
    target = folder / path.stem
    if target.suffix not in STORAGES:
        raise DataError(
            "this compressed file is not named as a storage of ROS 2",
            where=str(path),
            next_step="Name it as it was recorded, run_0.db3.zstd for example.",
        )
    left = LARGEST_RATIO * path.stat().st_size
    with path.open("rb") as packed, _zstd(path).open(packed, "rb") as source, target.open("wb") as out:
        while block := source.read(BLOCK):
            left -= len(block)
            if left < 0:
                raise DataError(
                    "the compressed file unpacks without end", where=str(path), next_step="Export it again."
                )
            out.write(block)
    return target


MAGIC = b"\x89MCAP0\r\n"
FOOTER = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + MAGIC
"""An end that says nothing of an index, so that readers scan the records themselves."""
HEAD = 9
"""Bytes of opcode and length."""
CHUNK, CHUNK_FIXED = 6, 28  # MCAP: opcode of a chunk, and the length of its fixed part
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


def _check_room(path: Path) -> None:
    """DataError: a chunk of an MCAP unpacks to more than a file may. The library unpacks each as a whole."""
    for one in _storages(path) if path.is_dir() else [path]:
        if one.suffix == ".mcap":
            check_chunks(one, partial(_count, one))


def _count(path: Path, packing: bytes, data: bytes) -> None:
    if packing == b"zstd":
        unpacker = _zstd(path).ZstdDecompressor()
    elif packing == b"lz4":
        unpacker = needed("lz4.frame", READING, path).LZ4FrameDecompressor()
    else:
        return
    for _ in blocks_of(unpacker, data, path):
        pass


def _is_cut(path: Path) -> bool:
    return path.suffix == ".mcap" and is_cut(path)


def _mended(path: Path, folder: Path) -> tuple[Path, bool]:
    """An MCAP that lacks its end with one; and whether it did."""
    if not _is_cut(path):
        return path, False
    target = folder / f"mended-{path.name}"
    mend(path, target, lambda torn: _started(torn, path))
    return target, True


def _started(torn: bytes, path: Path) -> bytes:
    """What the beginning of compressed data holds; nothing if that cannot be told."""
    try:
        most = min(LARGEST_RATIO * len(torn), LARGEST // PIECE)
        return bytes(_zstd(path).ZstdDecompressor().decompress(torn, most))
    except Exception:
        return b""


def _zstd(path: Path) -> Any:
    """Python's own, or the library that rosbags brings to older versions of Python."""
    import sys

    return needed("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd", READING, path)
