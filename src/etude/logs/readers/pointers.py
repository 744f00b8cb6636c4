"""Files of Git LFS that were cloned without it: a few lines of text in place of what they stand for."""

from __future__ import annotations

from pathlib import Path

from etude.errors import DataError

POINTER = b"version https://git-lfs.github.com/spec/"


def check_whole(head: bytes, path: Path) -> None:
    """DataError: the file that begins with `head` is such a pointer."""
    if head.startswith(POINTER):
        raise DataError(
            "this is a pointer of Git LFS, not the file itself",
            where=str(path),
            next_step="Fetch it: git lfs pull, in the folder that was cloned.",
        )
