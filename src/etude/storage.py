"""Files that survive a crash: whole or absent, never half-written.

Every byte a campaign keeps goes through this module, so a test can stop the process at each of its system
calls and look at what is left.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import shutil
import time
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

from etude.errors import EtudeError, UsageError

GENERATION = 3
"""Of what Étude writes: it grows when a fault of safety is mended, whatever the version says. Files without
one are of generation 1. The faults of earlier ones: `campaign.record.known_faults`, docs/known_faults.md."""

LARGEST_ARRAYS = 2**30
"""Bytes in memory, of all arrays of one file."""
LOCK = ".lock"
"""File in a folder that its one writer holds locked."""
TEMPORARY_PREFIX = ".partial-"
# a RuntimeError covers zip features that damage seems to ask for, and JSON nested too deeply; TokenError is
# what NumPy's reader of array headers lets through
DAMAGE = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError),
    *(EOFError, MemoryError, SyntaxError, BadZipFile, TokenError, zlib.error),
)
"""What reading a damaged file of arrays may raise."""


def write_atomic(path: Path, data: bytes) -> None:
    """Writes `data` to `path` so that a reader sees the old file or the whole new one, even after power loss.

    Temporary file in the same folder, fsync, rename, fsync of the folder. The folder is made if missing.

    Raises:
        EtudeError: the disk is full or refuses; the old file, if any, is untouched.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.parent / f"{TEMPORARY_PREFIX}{os.getpid()}-{path.name}"
        try:
            _write_new(temporary, data)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
        _sync_folder(path.parent)
    except OSError as error:
        raise _refused(path, error) from error


def write_folder(folder: Path, files: Mapping[str, bytes], mark: str, replaced: Collection[str] = ()) -> None:
    """Writes files, by names that may hold folders, so that `folder` is there whole or not at all.

    Args:
        mark: name of the file that says what the folder is: one that holds it is replaced.
        replaced: names of files that go, if they are not written again. All others stay: they are the user's.

    Raises:
        UsageError: there is something else of that name.
        EtudeError: the disk is full or refuses; what was there is untouched.
    """
    folder = Path(folder)
    if folder.is_symlink() or (folder.exists() and not _may_replace(folder, mark)):
        raise UsageError(
            "another file or folder has that name and is not replaced",
            where=str(folder),
            next_step="Name another folder.",
        )
    new, old = (folder.parent / f"{TEMPORARY_PREFIX}{os.getpid()}-{w}-{folder.name}" for w in ("new", "old"))
    try:
        try:
            for leftover in (new, old):  # of an earlier failure
                shutil.rmtree(leftover, ignore_errors=True)
            for name, data in files.items():
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                _write_new(new / name, data)
            _keep_others(folder, new, {*files, *replaced})
            if folder.exists():
                os.replace(folder, old)
            os.replace(new, folder)
        except BaseException:
            if old.exists() and not folder.exists():
                os.replace(old, folder)
            raise
        finally:
            shutil.rmtree(new, ignore_errors=True)
            shutil.rmtree(old, ignore_errors=True)
        _sync_folder(folder.parent)
    except OSError as error:
        raise _refused(folder, error) from error


def _keep_others(folder: Path, new: Path, known: Collection[str]) -> None:
    """Copies the files of a folder whose names are not known; links stay links."""
    others = [path for path in folder.rglob("*") if path.is_symlink() or path.is_file()]
    for path in others:
        name = path.relative_to(folder)
        if name.as_posix() not in known and not (new / name).exists():
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, new / name, follow_symlinks=False)


def _may_replace(folder: Path, mark: str) -> bool:
    return folder.is_dir() and ((folder / mark).is_file() or not any(folder.iterdir()))


def packed(arrays: Mapping[str, Any]) -> bytes:
    """The file of arrays by name (NumPy's npz), none of them of objects."""
    import numpy as np

    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # NumPy below 2.1 would store allow_pickle=False as an array of that name
    return buffer.getvalue()


def arrays_of(data: bytes) -> dict[str, Any]:
    """The arrays of NumPy's npz: none of objects, and at most `LARGEST_ARRAYS` bytes in all.

    Raises:
        ValueError: arrays of objects, or larger ones; a few bytes may unpack to any size. Other errors of zip
            archives where the bytes are damaged.
    """
    import zipfile

    import numpy as np

    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if sum(part.file_size for part in archive.infolist()) > LARGEST_ARRAYS:
            raise ValueError("its arrays exceed 1 GB when unpacked")
    # from memory: NumPy leaves a damaged file open
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return dict(file)


def append_line(path: Path, line: str) -> None:
    """Appends one line and waits until it is on the disk; first removes a torn line left by a crash.

    Raises:
        ValueError: the line contains a line break.
        EtudeError: the disk is full or refuses; the file is then as it was before.
    """
    if "\n" in line:
        raise ValueError("a journal line must not contain a line break")
    path = Path(path)
    try:
        new = not path.exists()
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            end = _whole_lines_end(handle)
            os.ftruncate(handle, end)
            try:
                os.lseek(handle, end, os.SEEK_SET)
                _write_all(handle, line.encode() + b"\n")
                os.fsync(handle)
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(handle, end)
                raise
        finally:
            os.close(handle)
        if new:
            _sync_folder(path.parent)
    except OSError as error:
        raise _refused(path, error) from error


def read_lines(path: Path) -> list[str]:
    """The whole lines of a file that `append_line` wrote; a torn last line is left out.

    Bytes that are not UTF-8 come as surrogates, so that every byte of a damaged file is kept.

    Raises:
        UsageError: there is something of that name, and it cannot be read.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise unreadable(path, error) from error
    return data.decode(errors="surrogateescape").split("\n")[:-1]


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def writer_lock(folder: Path, wait_s: float = 10.0) -> Iterator[None]:
    """Holds the one writer's place in `folder`; a process that ends, however, gives it back.

    Raises:
        UsageError: another process still holds it after `wait_s` seconds.
        EtudeError: the folder cannot be written to.
    """
    import fcntl

    lock = Path(folder) / LOCK
    try:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise _refused(lock, error) from error
    try:
        deadline = time.monotonic() + wait_s
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() >= deadline:
                    raise UsageError(
                        "another process is writing to this campaign",
                        where=str(folder),
                        next_step=f"Waited {wait_s:g} s. Let that process finish, then run the command "
                        "again.",
                    ) from None
                time.sleep(0.05)
        remove_leftovers(folder)
        yield
    finally:
        os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Deletes temporary files that a killed writer left; only the holder of the lock may call this."""
    for path in list(Path(folder).rglob(f"{TEMPORARY_PREFIX}*")):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _write_new(path: Path, data: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        _write_all(handle, data)
        os.fsync(handle)
    finally:
        os.close(handle)


def _write_all(handle: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(handle, view) :]


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _whole_lines_end(handle: int) -> int:
    """Offset just after the last line break, found from the end so that a long journal costs nothing."""
    end = os.lseek(handle, 0, os.SEEK_END)
    while end > 0:
        start = max(0, end - 65536)
        os.lseek(handle, start, os.SEEK_SET)
        position = os.read(handle, end - start).rfind(b"\n")
        if position >= 0:
            return start + position + 1
        end = start
    return 0


def unreadable(path: Path, error: OSError) -> UsageError:
    """What to raise where a file that should be there cannot be read."""
    return UsageError(
        f"could not read: {error.strerror or error}",
        where=str(path),
        next_step="Check that it is a file and that you may read it, or restore it from a copy.",
    )


def _refused(path: Path, error: OSError) -> EtudeError:
    return EtudeError(
        f"could not write: {error.strerror or error}",
        where=str(path),
        next_step="No stored data was lost; free some space or fix the permissions, and run the command "
        "again.",
    )
