"""Waiting that Ctrl-C ends."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from threading import Thread
from typing import TypeVar

R = TypeVar("R")

BREATH_S = 0.2
"""The system may hand a signal to any thread; the main one, which answers it, does not wake up for that."""


def first_done(futures: Iterable[Future[R]]) -> set[Future[R]]:
    """Those that are done, as soon as one is."""
    waited = list(futures)
    while not (done := wait(waited, BREATH_S, FIRST_COMPLETED).done):
        pass
    return done


def ended(thread: Thread) -> None:
    """Returns when the thread has ended."""
    while thread.is_alive():
        thread.join(BREATH_S)
