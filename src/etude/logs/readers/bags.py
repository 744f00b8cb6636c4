"""ROS 2 bags as raw logs: choice of topics, time stamps, and fields of messages.

rosbag2 writes a folder with metadata.yaml and one or several storages (SQLite or MCAP), which may be
compressed as a whole or message by message. A recorder that was killed leaves no metadata, and an MCAP
without its end.

Records of an MCAP are an opcode, a length (8 bytes) and so many bytes; https://mcap.dev/spec. Messages stand
in chunks, of which the last is usually torn: its whole records are taken out of it.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import DataError, EtudeError
from etude.logs.readers.extras import READING, needed
from etude.logs.readers.frames import raw_log
from etude.logs.readers.memory_budget import LARGEST, PIECE, blocks_of, unpacked
from etude.logs.readers.ros_messages import (
    LIKED,
    Stores,
    TopicRows,
    holds_joints,
    message_blocks,
    stamp_of,
    unknown_type,
)
from etude.types import Array, Index, Log

STORAGES = (".db3", ".mcap")
METADATA = "metadata.yaml"
ZSTD = b"\x28\xb5\x2f\xfd"
CUT = "The bag was cut: it has no end, so its last messages are missing."
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
            mended = [_mended_copy(_unpacked(one, folder), folder) for one in bare]
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
            "the name of this compressed file is not that of a ROS 2 storage",
            where=str(path),
            next_step="Restore its recorded name, for example run_0.db3.zstd.",
        )
    left = LARGEST_RATIO * path.stat().st_size
    with path.open("rb") as packed, _zstd(path).open(packed, "rb") as source, target.open("wb") as out:
        while block := source.read(BLOCK):
            left -= len(block)
            if left < 0:
                raise DataError(
                    "the compressed file has no end when unpacked",
                    where=str(path),
                    next_step="Export it again.",
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
        out.write(_complete_records(_torn_chunk(file.read(), unzstd)))
        out.write(FOOTER)


def check_chunks(path: Path, count: Callable[[bytes, bytes], None]) -> None:
    """Check the unpacked size of each chunk that could be too large.

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
                length_of_name = int.from_bytes(chunk[CHUNK_FIXED : CHUNK_FIXED + 4], "little")
                start = CHUNK_FIXED + 4 + length_of_name
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


def _complete_records(records: bytes) -> bytes:
    """The complete records at the beginning of the data."""
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


def _mended_copy(path: Path, folder: Path) -> tuple[Path, bool]:
    """An MCAP that lacks its end with one; and whether it did."""
    if not _is_cut(path):
        return path, False
    target = folder / f"mended-{path.name}"
    mend(path, target, lambda torn: _decompress_beginning(torn, path))
    return target, True


def _decompress_beginning(torn: bytes, path: Path) -> bytes:
    """The data that can be decompressed from a torn beginning; empty if there are none."""
    try:
        most = min(LARGEST_RATIO * len(torn), LARGEST // PIECE)
        return bytes(_zstd(path).ZstdDecompressor().decompress(torn, most))
    except Exception:
        return b""


def _zstd(path: Path) -> Any:
    """Python's own, or the library that rosbags brings to older versions of Python."""
    import sys

    return needed("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd", READING, path)


LISTED = 12  # topics in a sentence
SQLITE = b"SQLite format 3\0"


@dataclass(frozen=True)
class Topic:
    """A topic that was read.

    Attributes:
        name, msgtype: as recorded.
        rows: its messages.
        columns: header -> (T,).
    """

    name: str
    msgtype: str
    rows: TopicRows
    columns: Mapping[str, Array]

    @property
    def joints(self) -> frozenset[str]:
        """Names of the joints whose positions the topic has."""
        return frozenset(n.removeprefix("position/") for n in self.columns if n.startswith("position/"))


class BagReader:
    """A `protocols.Reader` of what rosbag2 records: a folder, or a storage of it (.db3, .mcap, .zstd)."""

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:
        """A log for each topic that was asked for, or of those that hold joint states.

        Raises:
            DataError: no bag, no such topic, an unknown message type, two robots.
            UsageError: rosbags is not installed.
        """
        try:
            with opened(path) as (readers, repairs):
                listed = {c.topic: c.msgtype for reader in readers for c in reader.connections}
                stores = Stores(path)
                names = _requested(listed, topics, path) or _with_joints(
                    readers, stores, listed, path, repairs
                )
                selected, cut = _read_topics(readers, stores, names, path, bool(topics))
        except EtudeError:
            raise
        except Exception as problem:  # the libraries below fail with anything
            raise _unreadable(path, problem) from problem
        chosen, sentences = (list(selected), ()) if topics else _choose_topics(selected, listed, path)
        return _logs(chosen, path.name, (*repairs, *cut, *sentences))

    def recognises(self, path: Path, head: bytes) -> bool:
        """By its first bytes; a folder by what is in it."""
        return is_bag_folder(path) or head.startswith((SQLITE, MAGIC))


def _requested(listed: Mapping[str, str], topics: Sequence[str], path: Path) -> tuple[str, ...]:
    """The topics that a user names. DataError: the bag lacks one of them."""
    for topic in topics:
        if topic not in listed:
            raise DataError(
                f"the bag has no topic {topic}", where=str(path), next_step=f"It has {_list(listed)}."
            )
    return tuple(topics)


def _with_joints(
    readers: Sequence[Any], stores: Stores, listed: Mapping[str, str], path: Path, repairs: tuple[str, ...]
) -> tuple[str, ...]:
    """Names of the topics that hold joint states; `repairs` may say why there are none."""
    connections = {c.topic: c for reader in readers for c in reader.connections}
    names = tuple(name for name, c in connections.items() if _may_hold_joints(c, stores))
    if names:
        return names
    raise DataError(
        " ".join(["the bag has no topic with joint states.", *repairs]).rstrip("."),
        where=str(path),
        next_step=f"Name topics with --topic; it has {_list(listed)}.",
    )


def _may_hold_joints(connection: Any, stores: Stores) -> bool:
    if connection.msgtype in LIKED:
        return True
    try:
        return holds_joints(connection.msgtype, stores.of(connection).fielddefs)
    except Exception:  # a definition that cannot be read is no reason to refuse the other topics
        return False


def _list(listed: Mapping[str, str]) -> str:
    names = [f"{name} ({msgtype})" for name, msgtype in sorted(listed.items())]
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return (", ".join(names[:LISTED]) or "none") + more


def _read_topics(
    readers: Sequence[Any], stores: Stores, requested: Sequence[str], path: Path, is_named: bool
) -> tuple[list[Topic], tuple[str, ...]]:
    """The requested topics, as far as the storages can be read, and a sentence for what is left out.

    Args:
        is_named: whether a user named them; of others, one that nobody can read harms none that can be read.
    """
    rows = {name: TopicRows() for name in requested}
    unreadable: dict[str, DataError] = {}
    types: dict[str, str] = {}
    cut = ""
    for reader in readers:
        connections = [c for c in reader.connections if c.topic in rows]
        types |= {c.topic: c.msgtype for c in connections}
        messages = iter(reader.messages(connections=connections)) if connections else iter(())
        while True:
            try:
                connection, received, data = next(messages)
            except StopIteration:
                break
            except Exception as problem:  # damage in the middle of a storage: what came before is whole
                cut = f"The bag was cut or is damaged, and was read up to there ({_first_line(problem)})."
                break
            if connection.topic in unreadable:
                continue
            try:
                _add(rows[connection.topic], connection, received, data, stores, path)
            except DataError as error:
                unreadable[connection.topic] = error
                if is_named or len(unreadable) == len(rows):
                    raise
    readable = [name for name in requested if name not in unreadable]
    read = [Topic(name, types[name], rows[name], rows[name].columns()) for name in readable]
    empty = [topic.name for topic in read if not topic.columns]
    if len(empty) == len(read):
        raise DataError(
            f"topic {', '.join(empty)} holds no numbers. {cut}".rstrip(". "),
            where=str(path),
            next_step="Name another with --topic, or record again.",
        )
    omitted = tuple(f"Topic {name} was ignored: {error.fact}." for name, error in unreadable.items())
    return [topic for topic in read if topic.columns], (*((cut,) if cut else ()), *omitted)


def _add(rows: TopicRows, connection: Any, received: int, data: Any, stores: Stores, path: Path) -> None:
    try:
        store = stores.of(connection)
        is_known = connection.msgtype in store.fielddefs
    except Exception:
        is_known = False
    if not is_known:
        raise unknown_type(connection.topic, connection.msgtype, str(path))
    try:
        if not isinstance(data, bytes) or not isinstance(received, int):  # a cell of SQLite may be empty
            raise ValueError("it holds no data, or no time")
        message = stores.read(connection, decompressed(data, path))
        rows.add(received, stamp_of(message), message_blocks(message, connection.msgtype))
    except Exception as problem:  # of a damaged definition a message may be anything
        raise DataError(
            f"a message of topic {connection.topic} does not fit the known type {connection.msgtype} "
            f"({_first_line(problem)})",
            where=str(path),
            next_step="The bag is damaged, or from another release of ROS: record as MCAP, or convert to "
            "CSV.",
        ) from None


def _choose_topics(
    candidates: Sequence[Topic], listed: Mapping[str, str], path: Path
) -> tuple[list[Topic], tuple[str, ...]]:
    """One topic for each signal of the joints: the simplest type first, others for signals that it lacks.

    Raises:
        DataError: two topics have the same joints and type, or different joints, as of two robots.
    """
    ranked = sorted(
        candidates, key=lambda t: (not t.joints, LIKED.index(t.msgtype) if t.msgtype in LIKED else 9)
    )
    leader, chosen = ranked[0], [ranked[0]]
    for topic in ranked[1:]:
        other = bool(topic.joints) and not topic.joints & leader.joints
        if other or (topic.msgtype == leader.msgtype and topic.joints & leader.joints):
            both = f"{_joints(leader)} and {_joints(topic)}"
            raise DataError(
                f"the bag holds joint states of two robots, or of one robot twice: {both}",
                where=str(path),
                next_step=f"Name one: --topic {leader.name}, or --topic {topic.name}.",
            )
        present = {name for one in chosen for name in one.columns}
        new = {name: column for name, column in topic.columns.items() if name not in present}
        if new:
            chosen.append(replace(topic, columns=new))
    names = {topic.name for topic in chosen}
    unread = {name: msgtype for name, msgtype in listed.items() if name not in names}
    sentence = f"Topic {', '.join(sorted(names))} was read"
    sentences: tuple[str, ...] = (
        f"{sentence}; the bag also has {_list(unread)}." if unread else f"{sentence}.",
    )
    if leader.joints and not any(column.startswith("effort") for topic in chosen for column in topic.columns):
        sentences += ("It holds no effort: the driver did not fill that field.",)
    return chosen, sentences


def _joints(topic: Topic) -> str:
    names = sorted(topic.joints)
    return f"{topic.name} ({', '.join(names[:4])}{', ...' if len(names) > 4 else ''})"


def _logs(topics: Sequence[Topic], source: str, repairs: tuple[str, ...]) -> dict[str, Log]:
    """A log for each topic, s from the first message, by the headers' stamps if these agree."""
    stamped: list[Index] = [np.array(topic.rows.stamped, dtype=np.int64) for topic in topics]
    received: list[Index] = [np.array(topic.rows.received, dtype=np.int64) for topic in topics]
    stamps = all((t > 0).all() and t[-1] > t[0] for t in stamped) and _overlap(stamped)
    times = stamped if stamps else received
    sentence = "Times are those of the message headers." if stamps else "Times are those of recording."
    start = min(int(t.min()) for t in times)
    logs = {}
    for topic, t in zip(topics, times, strict=True):
        raw = raw_log(topic.columns, source, (*repairs, sentence))
        # whole seconds since 1970 and nanoseconds together exceed a double's digits: subtract first
        logs[topic.name] = replace(raw, t=np.asarray((t - start) * 1e-9, dtype=np.float64))
    return logs


def _overlap(times: Sequence[Index]) -> bool:
    return max(int(t.min()) for t in times) < min(int(t.max()) for t in times)


def _unreadable(path: Path, problem: Exception) -> DataError:
    return DataError(
        f"the bag cannot be read ({_first_line(problem)})",
        where=str(path),
        next_step="It is truncated, damaged or another kind of file. `ros2 bag reindex` may repair a folder.",
    )


def _first_line(problem: BaseException) -> str:
    return (str(problem).strip().splitlines() or [type(problem).__name__])[0][:200]


read_bag = BagReader()
