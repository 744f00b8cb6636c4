"""The hash that a log is known by, whether it is a file or a folder of files as ROS 2 records."""

from __future__ import annotations

import hashlib
from pathlib import Path

from etude.errors import DataError
from etude.storage import sha256_of

RECORDED = (".yaml", ".db3", ".mcap", ".zstd")
"""Suffixes of the files in a folder that are part of a recording."""


def sha256_of_log(path: Path) -> str:
    """Of a file its own SHA-256; of a folder that of the names and hashes of the files recorded in it.

    Raises:
        DataError: there is no such log, or it may not be read.
    """
    try:
        if path.is_file():
            return sha256_of(path)
        if path.is_dir():
            text = "".join(f"{sha256_of(one)} {one.name}\n" for one in _recorded(path))
            return hashlib.sha256(text.encode()).hexdigest()
    except (OSError, ValueError) as error:
        raise DataError(
            f"the log file cannot be read: {getattr(error, 'strerror', None) or error}",
            where=str(path),
            next_step="Check that you may read it.",
        ) from None
    raise DataError("there is no such log file", where=str(path), next_step="Check the path.")


def bytes_of_log(path: Path) -> int:
    """Of a file its size; of a folder that of the files recorded in it."""
    return sum(one.stat().st_size for one in ([path] if path.is_file() else _recorded(path)))


def _recorded(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.suffix in RECORDED and one.is_file())
