"""LeRobot's datasets (v3, and files of v2) as raw logs: Parquet whose joints are named in meta/info.json.

    meta/info.json                        features: names of what observation.state and action hold
    data/chunk-000/file-000.parquet       timestamp, episode_index, observation.state, action: lists

Many episodes stand in one file, each with times of its own: one is a log.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import DataError
from etude.logs.readers.cells import matrix, numbers_of
from etude.logs.readers.frames import guarded, parquet_frame, raw_log
from etude.types import Array, Log

if TYPE_CHECKING:
    import polars as pl

INFO = Path("meta") / "info.json"
DATA = Path("data")
FEATURES: Mapping[str, str] = {
    "observation.state": "position",
    "observation.velocity": "velocity",
    "observation.effort": "effort",
    "action": "position_desired",
}
"""Feature -> what its entries are read as, where their own names do not say."""
WORDS = {"pos": "position", "vel": "velocity", "effort": "effort", "torque": "effort", "current": "current"}
EPISODE = "episode_"
LISTED = 12  # episodes in a sentence


def is_lerobot(path: Path) -> bool:
    """Whether a folder is such a dataset, or a file one of its data files."""
    return (path / INFO).is_file() if path.is_dir() else path.suffix == ".parquet" and _root(path) is not None


class LerobotReader:
    """A `protocols.Reader` of a dataset's folder, or of one of its data files."""

    def __call__(self, path: Path, topics: Sequence[str] = ()) -> Mapping[str, Log]:
        """The log of one episode: the only one, or topic `episode_3`.

        Raises:
            DataError: no such dataset or episode, or several episodes and none named.
        """
        root = path if path.is_dir() else _root(path)
        if root is None:
            raise DataError(
                "this file does not belong to a LeRobot dataset",
                where=str(path),
                next_step="Name its folder.",
            )
        files = sorted((root / DATA).rglob("*.parquet")) if path.is_dir() else [path]
        if not files:
            raise DataError("the dataset has no data files", where=str(path), next_step="Download it whole.")
        names = _names(root)
        frames = {file: parquet_frame(file) for file in files}
        where = {e: file for file, frame in frames.items() for e in _episodes(frame)}
        episode = _requested_episode(sorted(where), topics, path)
        frame = _rows(frames[where[episode]], episode)
        return {f"{EPISODE}{episode}": guarded(lambda: _log(frame, names, path), path, "a LeRobot dataset")}

    def recognises(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """By meta/info.json."""
        return is_lerobot(path)


def _root(path: Path) -> Path | None:
    """The dataset's folder, of a file in data/chunk-000/."""
    return next((up for up in path.parents[:3] if (up / INFO).is_file()), None)


def _names(root: Path) -> dict[str, list[str]]:
    """Names of the entries of each feature; they may stand in a list, or in one within it or under a word."""
    try:
        features = json.loads((root / INFO).read_text(encoding="utf-8"))["features"]
        entry_names = {}
        for feature in FEATURES:
            names = features.get(feature, {}).get("names")
            names = next(iter(names.values()), None) if isinstance(names, dict) else names
            names = names[0] if isinstance(names, list) and len(names) == 1 else names
            names = [names] if isinstance(names, str) else names
            if isinstance(names, list) and all(isinstance(name, str) for name in names):
                entry_names[feature] = names
        return entry_names
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as problem:
        raise DataError(
            f"the dataset's description cannot be read ({type(problem).__name__})",
            where=str(root / INFO),
            next_step="Download the dataset again.",
        ) from None


def _episodes(frame: pl.DataFrame) -> list[int]:
    if "episode_index" not in frame.columns:
        return [0]
    numbers = numbers_of(frame["episode_index"])
    return [int(n) for n in np.unique(numbers[np.isfinite(numbers)])]


def _requested_episode(episodes: Sequence[int], topics: Sequence[str], path: Path) -> int:
    """The episode that a user names, or the only one. DataError: none or several are named, or it is
    absent.
    """
    listed = ", ".join(f"{EPISODE}{n}" for n in episodes[:LISTED]) or "none"
    more = f" and {len(episodes) - LISTED} more" if len(episodes) > LISTED else ""
    if not topics and len(episodes) == 1:
        return episodes[0]
    if not topics:
        raise DataError(
            f"the dataset has {len(episodes)} episodes, but a log is one episode",
            where=str(path),
            next_step=f"Name one: --topic {EPISODE}0; it has {listed}{more}.",
        )
    number = topics[0].removeprefix(EPISODE)
    if len(topics) > 1 or not number.isdigit() or int(number) not in episodes:
        raise DataError(
            f"the dataset has no episode {', '.join(topics)}",
            where=str(path),
            next_step=f"It has {listed}{more}. Name one.",
        )
    return int(number)


def _rows(frame: pl.DataFrame, episode: int) -> pl.DataFrame:
    if "episode_index" not in frame.columns:
        return frame
    rows = np.flatnonzero(numbers_of(frame["episode_index"]) == episode)
    return frame[rows.tolist()]


def _log(frame: pl.DataFrame, names: Mapping[str, Sequence[str]], path: Path) -> Log:
    columns: dict[str, Array] = {}
    sentences = ["This is a LeRobot dataset; its actions are desired positions."]
    if "timestamp" in frame.columns:
        columns["timestamp"] = numbers_of(frame["timestamp"])
    for feature, word in FEATURES.items():
        if feature in frame.columns:
            values = _entries(frame[feature])
            entries = names.get(feature, ())
            if len(entries) != values.shape[1]:
                if entries:
                    sentences.append(
                        f"{INFO.as_posix()} names {len(entries)} of the {values.shape[1]} entries of "
                        f"{feature}: they were numbered from 0."
                    )
                entries = [str(i) for i in range(values.shape[1])]
            columns |= {_header(word, name): values[:, i] for i, name in enumerate(entries)}
    return raw_log(columns, path.name, tuple(sentences))


def _entries(series: pl.Series) -> Array:
    """(T, n) of a column of lists, or of single numbers."""
    import polars as pl

    if isinstance(series.dtype, pl.List | pl.Array):
        return np.asarray(matrix(series.to_list(), float))
    return numbers_of(series)[:, None]


def _header(word: str, name: str) -> str:
    """`position/elbow` of "elbow.pos"; what the name says counts in features that mix several things."""
    joint, _, last = name.rpartition(".")
    if not joint or last not in WORDS:
        return f"{word}/{name}"
    mixed = word == "position" or (word == "position_desired" and last != "pos")
    return f"{WORDS[last] if mixed else word}/{joint}"


read_lerobot = LerobotReader()
