"""Ctrl-C ends the program on the spot, at any moment, as a kill would: no exception travels anywhere.

Python's own answer, a KeyboardInterrupt out of whatever runs, is not safe here. Compiled code calls Python to
pack its results, and an exception there came out as a SystemError or a segmentation fault; callbacks of the
compiler swallow it, and the command goes on. Nothing needs the exception: what a campaign commits survives a
kill at any system call, so ending at once loses nothing that an orderly retreat would keep.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from types import FrameType

INTERRUPTED = 130
"""The exit code, as a shell gives it."""
CURSOR = b"\r\x1b[K\x1b[?25h"
"""Clears the line of a progress bar, which is never finished now, and shows the cursor that it hid."""


def end_on_interrupt(words: str, line: str = "") -> None:
    """From now on Ctrl-C prints `words` on stderr and `line`, if any, on stdout, and ends with code 130.

    Does nothing where the signal is ignored (a job in the background), is handled already, or cannot be
    handled (outside the main thread).
    """
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    owner, screen = os.getpid(), _screen()

    def end(_: int, __: FrameType | None) -> None:
        try:  # noqa: SIM105 - suppress() would be a call outside of it
            # C code may let us in with an error of its own pending: the first call then fails for it, and
            # takes it away. Without this line the words would be lost.
            os.getpid()
        except BaseException:
            pass
        try:
            if os.getpid() == owner:  # a forked child ends silently
                _end_children()
                _say(screen, words, line)
        finally:
            os._exit(INTERRUPTED)

    signal.signal(signal.SIGINT, end)


def ignore_from_now() -> None:
    """All is done and printed: Ctrl-C while the interpreter packs up comes too late to change anything."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _screen() -> int:
    """Standard error as it is now: who reads a damaged file sends the one in place nowhere for a moment."""
    try:
        return os.dup(2)
    except OSError:  # there is none
        return 2


def _say(screen: int, words: str, line: str) -> None:
    # not by print: the signal may have come in the middle of one, and then it refuses to be entered again
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    with contextlib.suppress(OSError):
        if os.isatty(screen):
            os.write(screen, CURSOR)
        os.write(screen, f"{words}\n".encode())
        if line:
            os.write(1, f"{line}\n".encode())


def _end_children() -> None:
    """Workers of a study would wait for ever for the next piece of work."""
    processes = sys.modules.get("multiprocessing")
    if processes is not None:
        with contextlib.suppress(Exception):
            for child in processes.active_children():
                child.terminate()
