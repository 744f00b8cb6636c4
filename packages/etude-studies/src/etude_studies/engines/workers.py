"""A pool of processes in which a death or an endless run concerns nobody else.

`concurrent.futures.ProcessPoolExecutor` fails every call in flight when one process dies, and cannot end a
single one. Here a thread minds each process: it hands it one call at a time, kills it when the call takes too
long, and starts another in its place.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from typing import Any

from etude.errors import EtudeError
from etude_studies.engines.waiting import ended
from etude_studies.engines.worker import serve

ENOUGH_S = 5.0
"""A process that was told to end and has not by then is killed."""


class WorkerDied(EtudeError):
    """The process that carried out a call ended before it answered."""


class TookTooLong(EtudeError):
    """A call was ended because it went on beyond its limit."""


Call = tuple[Future[Any], bytes]


class Workers(Executor):
    """Processes of this machine, started afresh (spawn), each with one thread for BLAS and Numba.

    Args:
        workers: how many; None for one a core.
        limit_s: wall time that one call may take once its process has begun it; None for any.
    """

    def __init__(self, workers: int | None = None, limit_s: float | None = None) -> None:
        self.workers = workers or os.cpu_count() or 1
        self.window = 2 * self.workers  # one call waits for each, so that none is idle while a result is kept
        self._limit_s = limit_s
        self._calls: queue.SimpleQueue[Call | None] = queue.SimpleQueue()
        self._minds: list[_Mind] = []
        self._closed = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As `Executor.submit`; fails with WorkerDied if its process died, TookTooLong if it was ended."""
        if self._closed:
            raise RuntimeError("the pool is closed")
        future: Future[Any] = Future()
        self._calls.put((future, pickle.dumps((fn, args, kwargs))))
        if len(self._minds) < self.workers:
            self._minds.append(_Mind(self._calls, self._limit_s))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes, after the calls that were submitted unless they are cancelled."""
        if cancel_futures:
            self._drop_waiting()
        if not self._closed:
            self._closed = True
            for _ in self._minds:
                self._calls.put(None)
        for mind in self._minds if wait else ():
            ended(mind.thread)

    def end(self) -> None:
        """Kills the processes at once, whatever they do."""
        self._closed = True
        for mind in self._minds:
            mind.ended = True
        self._drop_waiting()
        for mind in self._minds:
            self._calls.put(None)
            mind.kill()
        for mind in self._minds:
            mind.thread.join(ENOUGH_S)

    def _drop_waiting(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                call = self._calls.get_nowait()
                if call:
                    call[0].cancel()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Waits for what was submitted; after an exception, Ctrl-C among them, nobody is waited for."""
        if kind is None:
            self.shutdown()
        else:
            self.end()


class _Mind:
    """One process and the thread that minds it."""

    def __init__(self, calls: queue.SimpleQueue[Call | None], limit_s: float | None) -> None:
        self.ended = False
        self._calls, self._limit_s = calls, limit_s
        self._process: BaseProcess | None = None
        self._pipe: connection.Connection | None = None
        self.thread = threading.Thread(target=self._work, daemon=True)
        self.thread.start()

    def kill(self) -> None:
        process = self._process
        if process is not None:
            process.kill()

    def _work(self) -> None:
        while (call := self._calls.get()) is not None and not self.ended:
            future, work = call
            if future.set_running_or_notify_cancel():
                self._answer(future, work)
        self._end_process()

    def _answer(self, future: Future[Any], work: bytes) -> None:
        try:
            good, value = pickle.loads(self._sent(work))
        except EtudeError as error:
            self._end_process()
            good, value = False, error
        except Exception as error:  # a process that cannot start, an answer that cannot be read
            self._end_process()
            good, value = False, WorkerDied(f"no worker could be had: {error}")
        if good:
            future.set_result(value)
        else:
            future.set_exception(value)

    def _sent(self, work: bytes) -> bytes:
        """The process's answer to one call."""
        process, pipe = self._started()
        try:
            pipe.send_bytes(work)
            pipe.recv_bytes()  # it begins: to start and to import is not the time of the call
            ready = connection.wait([pipe, process.sentinel], self._limit_s)
            if not ready:
                raise TookTooLong(f"it was not done after {self._limit_s:g} s and was ended")
            return pipe.recv_bytes()
        except (EOFError, OSError) as error:
            process.join(ENOUGH_S)
            raise WorkerDied(f"its process died ({_ending(process.exitcode)})") from error

    def _started(self) -> tuple[BaseProcess, connection.Connection]:
        if self._process is None or self._pipe is None:
            context = get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=serve, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
            if self.ended:
                self._process.kill()
        return self._process, self._pipe

    def _end_process(self) -> None:
        """Closing the pipe ends an idle one; one that is busy is killed."""
        process, pipe = self._process, self._pipe
        self._process = self._pipe = None
        if process is None or pipe is None:
            return
        pipe.close()
        process.join(0.0 if self.ended else 0.2)
        if process.is_alive():
            process.kill()
        process.join(ENOUGH_S)


def _ending(code: int | None) -> str:
    return f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
