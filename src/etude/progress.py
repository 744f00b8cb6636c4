"""Progress of long computations: loops report their share to an observer; without one nothing is reported.

A loop is wrapped in `counted`, a stretch of different steps in `part`; both nest, and what is counted inside
a part refines it. Nothing is printed here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")
Tell = Callable[[float], None]


@dataclass
class _Watch:
    """The listener, the finished fraction, and the fraction of the current part."""

    tell: Tell
    done: float = 0.0
    size: float = 1.0


_watch: ContextVar[_Watch | None] = ContextVar("progress", default=None)


@contextmanager
def watched(tell: Tell) -> Iterator[None]:
    """Inside the block `tell` receives the fraction that is done, in [0, 1] and never less than before."""
    token = _watch.set(_Watch(tell))
    try:
        yield
    finally:
        _watch.reset(token)


@contextmanager
def part(share: float) -> Iterator[None]:
    """A stretch that is `share`, in [0, 1], of the work around it."""
    watch = _watch.get()
    if watch is None:
        yield
        return
    watch.tell(min(watch.done, 1.0))
    size, end = watch.size, watch.done + share * watch.size
    watch.size = share * size
    try:
        yield
    finally:
        watch.size, watch.done = size, max(end, watch.done)
        watch.tell(min(watch.done, 1.0))


def counted(
    items: Iterable[T], cost: Callable[[T], float] = lambda _: 1.0, whole: float = 1.0
) -> Iterator[T]:
    """The items one after the other.

    Args:
        items: all of them are taken first.
        cost: of one, in any unit; each counts alike if not given.
        whole: how much of the work around all of them are, in [0, 1].
    """
    todo = [(item, cost(item)) for item in items]
    total = sum(item_cost for _, item_cost in todo)
    for item, item_cost in todo:
        with part(whole * item_cost / total):
            yield item
