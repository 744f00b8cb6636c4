"""ROS 2 bags as raw logs: which topics, at whose times, and what each message says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import DataError, EtudeError
from etude.logs.readers.bag_files import MAGIC, decompressed, is_bag_folder, opened
from etude.logs.readers.frames import raw_log
from etude.logs.readers.ros_messages import (
    LIKED,
    Stores,
    TopicRows,
    blocks_of,
    holds_joints,
    stamp_of,
    unknown_type,
)
from etude.types import Array, Index, Log

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
        """Names of the joints whose position it holds."""
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
                wanted = _asked(listed, topics, path) or _with_joints(readers, stores, listed, path, repairs)
                found, cut = _read(readers, stores, wanted, path, bool(topics))
        except EtudeError:
            raise
        except Exception as problem:  # the libraries below fail with anything
            raise _unreadable(path, problem) from problem
        chosen, sentences = (list(found), ()) if topics else _chosen(found, listed, path)
        return _logs(chosen, path.name, (*repairs, *cut, *sentences))

    def recognises(self, path: Path, head: bytes) -> bool:
        """By its first bytes; a folder by what is in it."""
        return is_bag_folder(path) or head.startswith((SQLITE, MAGIC))


def _asked(listed: Mapping[str, str], topics: Sequence[str], path: Path) -> tuple[str, ...]:
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
    found = tuple(name for name, c in connections.items() if _may_hold_joints(c, stores))
    if found:
        return found
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


def _read(
    readers: Sequence[Any], stores: Stores, wanted: Sequence[str], path: Path, asked: bool
) -> tuple[list[Topic], tuple[str, ...]]:
    """The wanted topics, as far as the storages can be read, and a sentence for what is left out.

    Args:
        asked: whether a user named them; of others, one that nobody can read harms none that can be read.
    """
    rows = {name: TopicRows() for name in wanted}
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
                cut = f"The bag was cut or is damaged, and was read as far as that ({_first_line(problem)})."
                break
            if connection.topic in unreadable:
                continue
            try:
                _add(rows[connection.topic], connection, received, data, stores, path)
            except DataError as error:
                unreadable[connection.topic] = error
                if asked or len(unreadable) == len(rows):
                    raise
    readable = [name for name in wanted if name not in unreadable]
    found = [Topic(name, types[name], rows[name], rows[name].columns()) for name in readable]
    empty = [topic.name for topic in found if not topic.columns]
    if len(empty) == len(found):
        raise DataError(
            f"topic {', '.join(empty)} holds no numbers. {cut}".rstrip(". "),
            where=str(path),
            next_step="Name another with --topic, or record again.",
        )
    left = tuple(f"Topic {name} was left out: {error.fact}." for name, error in unreadable.items())
    return [topic for topic in found if topic.columns], (*((cut,) if cut else ()), *left)


def _add(rows: TopicRows, connection: Any, received: int, data: Any, stores: Stores, path: Path) -> None:
    try:
        store = stores.of(connection)
        known = connection.msgtype in store.fielddefs
    except Exception:
        known = False
    if not known:
        raise unknown_type(connection.topic, connection.msgtype, str(path))
    try:
        if not isinstance(data, bytes) or not isinstance(received, int):  # a cell of SQLite may be empty
            raise ValueError("it holds no data, or no time")
        message = stores.read(connection, decompressed(data, path))
        rows.add(received, stamp_of(message), blocks_of(message, connection.msgtype))
    except Exception as problem:  # of a damaged definition a message may be anything
        raise DataError(
            f"a message of topic {connection.topic} is not of the type {connection.msgtype} "
            f"as it is known here ({_first_line(problem)})",
            where=str(path),
            next_step="The bag is damaged, or of another release of ROS: record as MCAP, or convert to CSV.",
        ) from None


def _chosen(
    found: Sequence[Topic], listed: Mapping[str, str], path: Path
) -> tuple[list[Topic], tuple[str, ...]]:
    """Of all topics with joints one for each signal: the most plain type first, others for what it lacks.

    Raises:
        DataError: two topics tell of the same joints in the same way, or of other joints: two robots.
    """
    ranked = sorted(found, key=lambda t: (not t.joints, LIKED.index(t.msgtype) if t.msgtype in LIKED else 9))
    leader, kept = ranked[0], [ranked[0]]
    for topic in ranked[1:]:
        other = bool(topic.joints) and not topic.joints & leader.joints
        if other or (topic.msgtype == leader.msgtype and topic.joints & leader.joints):
            both = f"{_joints(leader)} and {_joints(topic)}"
            raise DataError(
                f"the bag holds joint states of two robots, or of one twice: {both}",
                where=str(path),
                next_step=f"Name the one: --topic {leader.name}, or --topic {topic.name}.",
            )
        had = {name for one in kept for name in one.columns}
        new = {name: column for name, column in topic.columns.items() if name not in had}
        if new:
            kept.append(replace(topic, columns=new))
    names = {topic.name for topic in kept}
    unread = {name: msgtype for name, msgtype in listed.items() if name not in names}
    said = f"Topic {', '.join(sorted(names))} was read"
    sentences: tuple[str, ...] = (f"{said}; the bag also has {_list(unread)}." if unread else f"{said}.",)
    if leader.joints and not any(column.startswith("effort") for topic in kept for column in topic.columns):
        sentences += ("No effort is in it: the driver did not fill that field.",)
    return kept, sentences


def _joints(topic: Topic) -> str:
    names = sorted(topic.joints)
    return f"{topic.name} ({', '.join(names[:4])}{', ...' if len(names) > 4 else ''})"


def _logs(topics: Sequence[Topic], source: str, repairs: tuple[str, ...]) -> dict[str, Log]:
    """A log for each topic, s from the first message, by the headers' stamps if these agree."""
    stamped: list[Index] = [np.array(topic.rows.stamped, dtype=np.int64) for topic in topics]
    received: list[Index] = [np.array(topic.rows.received, dtype=np.int64) for topic in topics]
    stamps = all((t > 0).all() and t[-1] > t[0] for t in stamped) and _overlap(stamped)
    times = stamped if stamps else received
    said = "Time is that of the messages' headers." if stamps else "Time is when messages were recorded."
    start = min(int(t.min()) for t in times)
    logs = {}
    for topic, t in zip(topics, times, strict=True):
        raw = raw_log(topic.columns, source, (*repairs, said))
        # whole seconds since 1970 and nanoseconds together exceed a double's digits: subtract first
        logs[topic.name] = replace(raw, t=np.asarray((t - start) * 1e-9, dtype=np.float64))
    return logs


def _overlap(times: Sequence[Index]) -> bool:
    return max(int(t.min()) for t in times) < min(int(t.max()) for t in times)


def _unreadable(path: Path, problem: Exception) -> DataError:
    return DataError(
        f"the bag cannot be read ({_first_line(problem)})",
        where=str(path),
        next_step="It is cut, damaged or another kind of file. A folder may be mended by `ros2 bag reindex`.",
    )


def _first_line(problem: BaseException) -> str:
    return (str(problem).strip().splitlines() or [type(problem).__name__])[0][:200]


read_bag = BagReader()
