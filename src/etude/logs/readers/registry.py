"""Registry of readers: one for each format, built in or from another package.

A reader is a function (path, topics) -> a Log for each topic, of raw columns: nothing is matched, converted
or repaired here. A log whose times are row numbers has them in one of its columns.

PlotJuggler exports each row as a message of one topic, so most cells are empty. The columns that are filled
at the same rows belong together, as topics of a bag do.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from etude import plugins
from etude.errors import DataError, EtudeError, reason
from etude.logs.cleaning.smoothing import segments
from etude.logs.columns.vocabulary import INDEX, is_time, normal
from etude.logs.readers.csv_tables import csv_log
from etude.logs.readers.frames import check_whole, frame_log, parquet_frame, raw_log
from etude.logs.readers.lerobot import is_lerobot
from etude.logs.readers.log_file import column_names
from etude.logs.readers.mat import mat_log
from etude.protocols import Reader
from etude.types import Array, Finding, Log, Mask

GROUP = "etude.readers"
READERS: Mapping[str, str] = {
    **dict.fromkeys((".csv", ".tsv", ".txt"), "csv"),
    ".parquet": "parquet",
    **dict.fromkeys((".db3", ".mcap", ".zstd"), "rosbag2"),
    ".ulg": "ulog",
    ".mat": "mat",
}
"""Suffix -> name of the built-in reader; other files and folders are shown to those that look into them."""
PACKED = dict.fromkeys((".gz", ".zip", ".bz2", ".xz", ".7z", ".tar", ".tgz"), "Unpack it first.")
SHEETS = dict.fromkeys((".xlsx", ".xls", ".ods"), "Save the sheet as CSV.")
INSTEAD: Mapping[str, str] = {
    **PACKED,
    **SHEETS,
    ".bag": "This is a ROS 1 bag: rosbags-convert --src run.bag --dst run converts it to ROS 2.",
}
"""Suffix -> what to do with a file that nobody reads."""
TABLES = (".dat", ".log", ".asc", ".out")
"""Suffixes of files that no other reader knows, and that are read as CSV if they are text."""
BY_SUFFIX_ALONE = ("csv", "parquet", "mat")
HEAD = 4096  # bytes: the longest signature of a format, and then some
AGAIN = "Export the log again."


def read_raw(path: Path, topics: Sequence[str] = ()) -> Log:
    """The file's raw columns, as one log.

    Raises:
        DataError: no such file, unknown format, empty, truncated, or not what its suffix says.
    """
    path = Path(path)
    name = _of_folder(path) if path.is_dir() else ""
    head = b"" if name else file_head(path)
    check_whole(head, path)
    if not head and not path.is_dir():
        raise DataError("the log file is empty (0 bytes)", where=str(path), next_step=AGAIN)
    name = name or _reader_of(path, head)
    log = without_holes(with_index(_join(_topics(plugins.load(GROUP, name), name, path, topics))))
    if len(log) < 2:
        raise DataError(f"the log file has {len(log)} rows of data", where=str(path), next_step=AGAIN)
    return log


def _of_folder(path: Path) -> str:
    """The reader of a folder that is one log; "" for any other folder."""
    names = (name for name in plugins.names(GROUP) if name not in BY_SUFFIX_ALONE)
    return next((name for name in names if _recognises(name, path, b"", {})), "")


def file_head(path: Path) -> bytes:
    """The first HEAD bytes of a file.

    Raises:
        DataError: there is none, it is a folder, or it cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return file.read(HEAD)
    except IsADirectoryError:
        fact, step = "this is a folder, not a log file", "Name the file in it."
    except (FileNotFoundError, NotADirectoryError):
        fact, step = "there is no such log file", "Check the path."
    except PermissionError:
        fact, step = "the log file may not be read", "Change the permissions of the file or its folder."
    except (OSError, ValueError) as problem:
        fact, step = f"the log file cannot be read ({problem})", "Check the path and the disk."
    raise DataError(fact, where=str(path), next_step=step)


def _reader_of(path: Path, head: bytes) -> str:
    built_in = READERS.get(path.suffix.lower())
    if built_in == "parquet" and is_lerobot(path):
        return "lerobot"
    if built_in is not None:
        return built_in
    brought = [name for name in plugins.names(GROUP) if name not in BY_SUFFIX_ALONE]
    broken: dict[str, str] = {}
    for name in brought:
        if _recognises(name, path, head, broken):
            return name
    if path.suffix.lower() in TABLES and b"\0" not in head:
        return "csv"
    if path.name == "metadata.yaml":
        step = "Name the folder of the bag."
        raise DataError("this file belongs to a bag", where=str(path), next_step=step)
    broken_readers = "".join(f"; the reader {name} cannot be loaded: {why}" for name, why in broken.items())
    raise DataError(
        f"there is no reader for '{path.suffix}' files{broken_readers}",
        where=str(path),
        next_step=INSTEAD.get(
            path.suffix.lower(),
            f"Write it as CSV or Parquet, a column for each signal. Known suffixes: {', '.join(READERS)}. "
            "Known by their content: logs of "
            f"{', '.join(name for name in brought if name not in broken)}. A package with an entry point "
            "etude.readers adds a format: docs/plugin_examples.md.",
        ),
    )


def _recognises(name: str, path: Path, head: bytes, broken: dict[str, str]) -> bool:
    """Whether that reader takes the file; one that is broken takes none, and harms no other.

    broken: name -> why a reader cannot be asked; added to.
    """
    try:
        return bool(plugins.load(GROUP, name).recognises(path, head))
    except Exception as problem:
        broken[name] = reason(problem)
        return False


def _topics(reader: Reader, name: str, path: Path, topics: Sequence[str]) -> Mapping[str, Log]:
    """The logs by the reader; a reader of another package may fail with any exception."""
    try:
        logs = reader(path, topics)
    except EtudeError:
        raise
    except Exception as problem:
        raise DataError(
            f"the reader '{name}' failed ({type(problem).__name__}: {problem})",
            where=str(path),
            next_step="Convert the log to CSV or Parquet, or report it to the reader's authors.",
        ) from problem
    if not logs:
        raise DataError("the file holds no log", where=str(path), next_step=AGAIN)
    return logs


def _join(topics: Mapping[str, Log]) -> Log:
    """One log of all topics, at the times of the one with the most rows; the others are interpolated where
    they are not silent. A column that several topics have keeps its topic's name before it.
    """
    if len(topics) == 1:
        return next(iter(topics.values()))
    leader = max(topics, key=lambda name: len(topics[name]))
    base = topics[leader]
    columns = {topic: _columns(part) for topic, part in topics.items()}
    counts = Counter(name for signals in columns.values() for name in signals)
    joined, repairs = {}, [f"Topics {', '.join(topics)} were joined at the times of {leader}."]
    for topic, signals in columns.items():
        t = topics[topic].t
        silent, sentences = silences(f"Topic {topic}", base.t, t) if topic != leader else (None, ())
        repairs += sentences
        for name, signal in signals.items():
            at_base = signal if silent is None else np.where(silent, np.nan, _interpolated(base.t, t, signal))
            joined[name if counts[name] == 1 else f"{topic}/{name}"] = at_base
    return replace(raw_log(joined, base.source, base.repairs), t=base.t).repaired(*repairs)


def _columns(log: Log) -> dict[str, Array]:
    """Header -> (T,) of a log's channels, part by part."""
    named = ((column_names(log.channels[name]), values) for name, values in log.values.items())
    return {name: column for names, values in named for name, column in zip(names, values.T, strict=True)}


def _interpolated(times: Array, t: Array, signal: Array) -> Array:
    timed = np.isfinite(t)
    t, signal = t[timed], signal[timed]
    if len(t) < 2:
        return np.full(len(times), np.nan)
    order = np.argsort(t, kind="stable")
    t, signal = t[order], signal[order]
    return np.interp(times, t, signal, left=np.nan, right=np.nan)


@dataclass(frozen=True)
class TableReader:
    """A `protocols.Reader` of files that hold one table, so one topic, whatever is asked for.

    Attributes:
        name: as in READERS.
        table: path -> its raw columns.
    """

    name: str
    table: Callable[[Path], Log]

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:  # noqa: ARG002
        return {"": self.table(path)}

    def recognises(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """By the suffix."""
        return READERS.get(path.suffix.lower()) == self.name


def _parquet(path: Path) -> Log:
    """All columns of a Parquet file."""
    return frame_log(parquet_frame(path), path)


def _csv(path: Path) -> Log:
    """Text with one header row; see `csv_tables`."""
    if file_head(path)[:4] == b"PAR1":
        raise DataError("this is a Parquet file", where=str(path), next_step="Rename it to .parquet.")
    return csv_log(path)


read_csv = TableReader("csv", _csv)
read_parquet = TableReader("parquet", _parquet)
read_mat = TableReader("mat", mat_log)


LEAP = 1e3  # times the usual step: no pause of a recorder, a stamp that is garbage
LONGEST = 1e7  # s: no log lasts longer
WAS_CUT = "was cut"
"""In the sentence of a reader which says that the end of a file is missing."""


def cut_sentences(log: Log) -> tuple[str, ...]:
    """Sentences on missing data."""
    return tuple(sentence for sentence in log.repairs if WAS_CUT in sentence)


def with_rest_reported(log: Log) -> Log:
    """The log; of one that was cut its sentence also says how many seconds are left.

    Args:
        log: as it was read; times in s, rows as recorded.
    """
    cut, seconds = cut_sentences(log), _recorded(log.t)
    if not cut or seconds == 0.0:
        return log
    left = f"{cut[0]} {seconds:.3g} s of it remain."
    if seconds > LONGEST:
        left = f"{cut[0]} Its times do not show how much remains."
    return replace(log, repairs=tuple(left if one == cut[0] else one for one in log.repairs))


def _recorded(t: Array) -> float:
    """Seconds that times as recorded advance by steps that a clock may take; 0 of a single row."""
    with np.errstate(all="ignore"):
        steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    return float(steps[steps <= LEAP * np.median(steps)].sum()) if len(steps) else 0.0


def end_findings(log: Log) -> tuple[Finding, ...]:
    """Findings on the end of a recording; none if no repair says that it was cut."""
    cut = cut_sentences(log)
    step = "Copy or record it again if the rest is needed; the remaining rows can be used."
    return (Finding("end", "yellow", " ".join(cut), step),) if cut else ()


WHOLE = 0.95
"""Part of the rows: columns that are filled in so many are a table with a few empty cells."""
SHARED = 0.5
"""Part of the leader's rows in which all columns are filled: with more, empty cells are damage."""


def without_holes(raw: Log) -> Log:
    """The rows of the columns that are filled most often, the others interpolated; or the log as it is."""
    t = next((raw[name][:, 0] for name in raw.values if is_time(name)), None)
    if t is None and not np.array_equal(raw.t, np.arange(len(raw))):
        t = raw.t  # of messages, of which each names other joints
    if t is None or len(t) < 2 or not np.isfinite(t).all():
        return raw
    filled: dict[bytes, Mask] = {}
    count: Counter[bytes] = Counter()
    every, whole, holed = np.ones(len(raw), dtype=bool), 0, 0
    for name, values in raw.values.items():
        finite = np.isfinite(values[:, 0])
        whole += bool(finite.all()) and not is_time(name)
        holed += not finite.all()
        if finite.sum() > 1:
            filled[np.packbits(finite).tobytes()] = finite
            count[np.packbits(finite).tobytes()] += 1
            every &= finite
    partial = [finite for finite in filled.values() if not finite.all()]
    if len(partial) < 2 or max(finite.sum() for finite in partial) > WHOLE * len(raw):
        return raw
    leader = max(partial, key=lambda finite: (int(finite.sum()), count[np.packbits(finite).tobytes()]))
    if every.sum() > SHARED * leader.sum() or whole >= holed:  # a table of rows
        return raw
    sentences = ["Columns that are filled at different rows were joined by time."]
    joined = {
        name: _at_rows(name, t, column[:, 0], leader, sentences)[:, None]
        for name, column in raw.values.items()
    }
    return replace(raw, t=raw.t[leader], values=joined).repaired(*sentences)


def _at_rows(name: str, t: Array, signal: Array, rows: Mask, repairs: list[str]) -> Array:
    filled = np.isfinite(signal)
    if filled[rows].all() or filled.sum() < 2:
        return np.asarray(signal[rows])
    order = np.argsort(t[filled], kind="stable")
    times, values = t[filled][order], signal[filled][order]
    silent, sentences = silences(f"Column {name}", t[rows], times)
    repairs += sentences
    return np.where(silent, np.nan, np.interp(t[rows], times, values, left=np.nan, right=np.nan))


def with_index(raw: Log) -> Log:
    """The log with its index as a column of time, where there is no other; row numbers are none.

    Where a reader knows the times, or a header says time, it stays as it is.
    """
    if any(map(is_time, raw.values)) or not np.array_equal(raw.t, np.arange(len(raw))):
        return raw
    for name, values in raw.values.items():
        if INDEX.fullmatch(normal(name)) and _advances(values[:, 0]):
            channel = replace(raw.channels[name], name="time")
            remaining = raw.without(name)
            sentence = f"There is no time column; the index ({name}) was used instead."
            return remaining.put(channel, values).repaired(sentence)
    return raw


def _advances(values: Array) -> bool:
    """Whether values (T,) grow from row to row, and are not row numbers."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(len(steps) and (steps > 0.0).mean() > 0.5 and not (steps == 1.0).all())


SHORTEST_S = 0.2
"""Over which a line between two messages is taken for what was measured."""
MOSTLY = 0.1
"""Part of the log: a topic that is silent for longer speaks when there is something to say, and holds."""


def silences(topic: str, times: Array, t: Array) -> tuple[Mask, tuple[str, ...]]:
    """Times at which a topic is silent, and sentences on them.

    A topic that is silent for long is interpolated: a command that is sent only on demand is no sensor that
    was cut off.

    Args:
        topic: its name.
        times: (T,) s at which it is to be known.
        t: (n,) s of its messages.
    """
    silent = _silent_rows(times, np.sort(t[np.isfinite(t)]))
    if not silent.any():
        return silent, ()
    seconds = float(silent.sum() * np.median(np.diff(times)))
    fact = f"{topic} is silent for {seconds:.3g} s while others continue"
    if silent.mean() > MOSTLY:
        return np.zeros_like(silent), (f"{fact}: its values in between were interpolated.",)
    return silent, (f"{fact}: its values there were left out.",)


def _silent_rows(times: Array, t: Array) -> Mask:
    silent = np.zeros(len(times), dtype=np.bool_)
    for before, after in itertools.pairwise(segments(t)):
        start, end = t[before.stop - 1], t[after.start]
        if end - start > SHORTEST_S:
            silent |= (times > start) & (times < end)
    return silent
