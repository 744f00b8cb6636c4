"""A process of the pool: one call after the other, and never longer than its parent lives."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from contextlib import suppress
from multiprocessing import connection
from typing import Any

from etude.errors import EtudeError

BEGINS = b"begins"
PR_SET_PDEATHSIG = 1  # linux/prctl.h
ONE_THREAD = ("NUMBA_NUM_THREADS", "POLARS_MAX_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def serve(pipe: connection.Connection) -> None:
    """Answers calls until the pipe is closed; Ctrl-C is the parent's affair."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()
    os.environ.update(dict.fromkeys(_unread(), "1"))
    os.dup2(2, 1)  # the parent's standard output carries its answer alone
    while True:
        try:
            work = pipe.recv_bytes()
        except (EOFError, OSError):
            return
        with suppress(BrokenPipeError):
            pipe.send_bytes(_answer(work, pipe))


def _unread() -> list[str]:
    """The variables that are still to be read. Numba, once loaded, refuses to find its own changed."""
    return [name for name in ONE_THREAD if not (name.startswith("NUMBA") and "numba" in sys.modules)]


def _answer(work: bytes, pipe: connection.Connection) -> bytes:
    """(True, result) or (False, exception), packed; before, that the work was understood and begins."""
    try:
        try:
            function, args, kwargs = pickle.loads(work)
        finally:
            pipe.send_bytes(BEGINS)
        return pickle.dumps((True, function(*args, **kwargs)))
    except BaseException as error:  # a call that ends its process, as sys.exit does, has failed as any other
        return _failure(error)


def _failure(error: BaseException) -> bytes:
    """The exception with its traceback as a note; in words where it cannot be packed and unpacked."""
    text = "".join(traceback.format_exception(error))
    try:
        error.add_note(f"In the worker:\n{text}")
        packed = pickle.dumps((False, error))
        pickle.loads(packed)
    except Exception:
        packed = pickle.dumps((False, EtudeError(f"{type(error).__name__}: {error}")))
    return packed


def _end_with_parent() -> None:
    """A parent that was killed says no good-bye: the system does on Linux, a thread everywhere."""
    if sys.platform == "linux":
        libc: Any = ctypes.CDLL(None)
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_watch_parent, daemon=True).start()


def _watch_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
