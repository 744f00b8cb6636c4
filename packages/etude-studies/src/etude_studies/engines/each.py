"""One function over many cells, in processes: what the studies of campaigns are made of."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

from etude_studies.engines.waiting import first_done
from etude_studies.engines.workers import Workers

C = TypeVar("C")
R = TypeVar("R")


def each(work: Callable[[C], R], cells: Iterable[C], workers: int | None = None) -> Iterator[R]:
    """The work of every cell, in the order of the cells, done by processes (None: one a core).

    Raises:
        whatever the work raises, at its cell's place; WorkerDied where a process died.
    """
    with Workers(workers) as pool:
        futures: deque[Future[R]] = deque(pool.submit(work, cell) for cell in cells)
        try:
            while futures:
                first_done([futures[0]])
                yield futures.popleft().result()
        except Exception:
            pool.shutdown(cancel_futures=True)  # what has begun is finished, and kept in its file
            raise
