"""A Dask cluster as an engine: what it is given runs on its workers, and comes back to be kept here."""

from __future__ import annotations

import asyncio
import ctypes
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from etude.errors import EtudeError, UsageError
from etude.threads import KEPT_BYTES
from etude_studies.engines.workers import WorkerDied

ANSWER_S = 5.0
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h
MANY = 10_000
"""Calls handed to the cluster at once: it has its own queue, and workers that join find something to do."""


class Cluster(Executor):
    """The executor of a Dask client.

    Args:
        client: connected; closed with this.
    """

    window = MANY

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As `Executor.submit`; WorkerDied if as many workers died of the call as the cluster allows.

        The cluster also blames calls that such a worker had finished or not begun, so one more try is due.
        """
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()  # what was handed over is cancelled by leaving
        self._executor.submit(_with_memory_kept, fn, *args, **kwargs).add_done_callback(
            lambda cluster_future: _passed_on(cluster_future, future)
        )
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leaves the cluster, which goes on for others; what it computes for us is cancelled."""
        self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(wait=kind is None)


def connect(address: str, tell: Callable[[str], None]) -> Cluster:
    """The cluster whose scheduler has this address.

    Args:
        address: "tcp://host:port".
        tell: is told what is strange about the cluster, a line each.

    Raises:
        UsageError: `distributed` is not installed, or nothing answers like a scheduler within some seconds.
    """
    try:
        from distributed import Client
        from distributed.comm import connect as knock
    except ImportError as error:
        raise UsageError(
            f"a cluster needs the package distributed ({error})",
            where="--cluster",
            next_step="pip install 'distributed>=2024.8'",
        ) from error

    async def answers() -> None:
        # a Client that finds nobody says so only on standard error, and long after
        comm = await asyncio.wait_for(knock(address, timeout=ANSWER_S), ANSWER_S)
        comm.abort()

    try:
        asyncio.run(answers())
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"no Dask scheduler answers: {str(error) or 'only silence'}",
            where=f"--cluster {address}",
            next_step="Start one with `dask scheduler`, and give the address that it prints.",
        ) from error
    _look_at(client.nthreads(), tell)
    return Cluster(client)


def _with_memory_kept(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """The call on a worker, with what it frees kept for its next arrays.

    Dask sets MALLOC_TRIM_THRESHOLD_ for its workers, by which glibc takes every larger array from the kernel
    anew: that made runs a quarter longer than in the pool.
    """
    if sys.platform == "linux":
        libc: Any = ctypes.CDLL(None)
        if hasattr(libc, "mallopt"):
            libc.mallopt(M_MMAP_THRESHOLD, KEPT_BYTES)
            libc.mallopt(M_TRIM_THRESHOLD, 2 * KEPT_BYTES)
    return fn(*args, **kwargs)


def _look_at(threads: dict[str, int], tell: Callable[[str], None]) -> None:
    if not threads:
        tell("The cluster has no workers yet; the runs wait for some.")
    if any(count > 1 for count in threads.values()):
        tell("Some workers have several threads, which slow each other down: start them with --nthreads 1.")


def _passed_on(cluster_future: Future[Any], future: Future[Any]) -> None:
    if cluster_future.cancelled():
        future.set_exception(EtudeError("the cluster dropped the run, or went away"))
        return
    error = cluster_future.exception()
    if error is None:
        future.set_result(cluster_future.result())
    elif type(error).__name__ == "KilledWorker":
        tries = getattr(error, "allowed_failures", 0) + 1
        future.set_exception(WorkerDied(f"all {tries} workers that had it died"))
    else:
        future.set_exception(error)
