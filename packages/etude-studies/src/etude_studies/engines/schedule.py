"""Schedule of the runs that are still to be done, and the outcome of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from etude.errors import DataError, EtudeError
from etude.storage import TEMPORARY_PREFIX
from etude_studies.engines.carrying import Done, Failed, carry_out, in_words
from etude_studies.engines.waiting import first_done
from etude_studies.engines.workers import WorkerDied
from etude_studies.run_file import read_result, result_path, write_result
from etude_studies.spec import Spec

if TYPE_CHECKING:
    import polars as pl

LEFTOVER_S = 3600.0
"""Temporary files of this age were left by a writer that was killed; younger ones may be another shard's."""


class Engine(Protocol):
    """An executor, and how many calls it wants to have at hand."""

    @property
    def window(self) -> int: ...
    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]: ...


@dataclass(frozen=True)
class Event:
    """What `run_all` tells while it goes on.

    Attributes:
        text: a line for people.
        done, total: runs finished, failed ones among them, and to be done in all.
        cpu_s: of the run that was finished.
    """

    text: str
    done: int
    total: int
    cpu_s: float = 0.0


@dataclass(frozen=True)
class Report:
    """What became of the runs.

    Attributes:
        ran: computed now, in the order in which they were finished.
        kept: asked for, and there already.
        recomputed: what was wrong with a result that was there, by run.
        failed: why there is no result, by run.
        noted: what is odd about a result, by run.
    """

    ran: tuple[Spec, ...] = ()
    kept: tuple[Spec, ...] = ()
    recomputed: Mapping[Spec, str] = field(default_factory=dict)
    failed: Mapping[Spec, str] = field(default_factory=dict)
    noted: Mapping[Spec, str] = field(default_factory=dict)


def shard_of(specs: Iterable[Spec], shard: int, shards: int) -> list[Spec]:
    """The runs of one of several machines, by their place: 1 .. shards, each run in exactly one."""
    return list(dict.fromkeys(specs))[shard - 1 :: shards]


def run_all(
    specs: Iterable[Spec],
    folder: Path,
    engine: Engine,
    tell: Callable[[Event], None] = lambda _: None,
    retries: int = 1,
    names: Mapping[Spec, str] | None = None,
) -> Report:
    """Computes every run whose result is not in the folder yet, those that others need first and once.

    `names` are what people call the runs, where that is more than the run itself knows.

    A run that raises, whose worker died more than `retries` times, or that needs one of these, is reported as
    failed and has no file; the others go on. Nothing half-written is left, whenever this process ends.

    Raises:
        EtudeError: the folder cannot be written to, or a cluster went away; what was finished is kept.
    """
    remove_old_leftovers(folder)
    requested = list(dict.fromkeys(specs))
    return _Schedule(requested, Path(folder), engine, tell, retries, names or {}).run()


def remove_old_leftovers(folder: Path) -> None:
    """Deletes temporary files that a killed writer left."""
    for path in Path(folder).glob(f"{TEMPORARY_PREFIX}*"):
        try:
            if time.time() - path.stat().st_mtime > LEFTOVER_S:
                path.unlink()
        except FileNotFoundError:
            continue


class _Schedule:
    """The state of one `run_all`."""

    def __init__(
        self,
        requested: Sequence[Spec],
        folder: Path,
        engine: Engine,
        tell: Callable[[Event], None],
        retries: int,
        names: Mapping[Spec, str],
    ) -> None:
        self._folder, self._engine, self._tell, self._retries = folder, engine, tell, retries
        self._names = names
        self._tables: dict[str, pl.DataFrame] = {}
        self._recomputed: dict[Spec, str] = {}
        self._noted: dict[Spec, str] = {}
        self._failed: dict[Spec, str] = {}
        self._ran: list[Spec] = []
        self._deaths: dict[Spec, int] = {}
        self._waiting: dict[Spec, None] = {}
        self._flying: dict[Future[Any], Spec] = {}
        present: dict[Spec, bool] = {}
        for spec in requested:
            self._plan(spec, present)
        self._present = tuple(spec for spec in requested if present[spec])
        self._total = len(self._waiting)

    def _plan(self, spec: Spec, present: dict[Spec, bool]) -> None:
        """A run that is there needs nothing any more; one that is not comes after what it needs."""
        if spec in present:
            return
        present[spec] = self._is_there(spec)
        if not present[spec]:
            for needed in spec.needs:
                self._plan(needed, present)
            self._waiting[spec] = None

    def _is_there(self, spec: Spec) -> bool:
        path = result_path(self._folder, spec)
        if not path.exists():
            return False
        try:
            read_result(path, spec)
        except DataError as error:
            self._recomputed[spec] = error.fact
            self._tell(Event(f"{self._name(spec)} is computed again: {error.fact} ({path.name})", 0, 0))
            return False
        return True

    def run(self) -> Report:
        there = f", {len(self._present)} are there already" if self._present else ""
        self._tell(Event(f"{self._total} runs to do{there}", 0, self._total))
        try:
            while self._waiting or self._flying:
                self._submit()
                for future in first_done(self._flying):
                    self._finish(self._flying.pop(future), future)
        finally:
            for future in self._flying:
                future.cancel()
        return Report(tuple(self._ran), self._present, self._recomputed, self._failed, self._noted)

    def _submit(self) -> None:
        """Hands on what is ready; inline, each is done at once."""
        blocked = {*self._waiting, *self._flying.values()}
        for spec in list(self._waiting):
            if len(self._flying) >= self._engine.window:
                return
            if blocked.isdisjoint(spec.needs):
                needs = {needed.hash: self._table(needed) for needed in spec.needs}
                del self._waiting[spec]
                self._flying[self._engine.submit(carry_out, spec, needs)] = spec

    def _table(self, spec: Spec) -> pl.DataFrame:
        """Of a run that others need; read once."""
        if spec.hash not in self._tables:
            self._tables[spec.hash] = read_result(result_path(self._folder, spec), spec)
        return self._tables[spec.hash]

    def _finish(self, spec: Spec, future: Future[Any]) -> None:
        try:
            result = future.result()
        except WorkerDied as error:
            self._deaths[spec] = self._deaths.get(spec, 0) + 1
            if self._deaths[spec] <= self._retries:
                self._say(spec, f"is tried again: {error.fact}")
                self._waiting = {spec: None, **self._waiting}
                return
            result = Failed(f"{error.fact}, {self._deaths[spec]} times")
        except EtudeError as error:
            result = Failed(error.fact)
        except (
            Exception
        ) as error:  # an engine's own: a module that its workers lack, an answer it cannot carry
            result = Failed(in_words(error))
        if isinstance(result, Done):
            self._keep(spec, result)
        else:
            self._fail(spec, result.sentence)

    def _keep(self, spec: Spec, result: Done) -> None:
        write_result(result_path(self._folder, spec), result.table, spec, result.made)
        self._ran.append(spec)
        if result.note:
            self._noted[spec] = result.note
        note = f"; {result.note}" if result.note else ""
        self._say(spec, f"{result.made.cpu_s:.0f} s of CPU{note}", result.made.cpu_s)

    def _fail(self, spec: Spec, sentence: str) -> None:
        """And with it all that need it, which then cannot be had either."""
        self._failed[spec] = sentence
        self._say(spec, f"failed: {sentence}")
        for other in [waiting for waiting in self._waiting if spec in waiting.needs]:
            if other in self._waiting:
                del self._waiting[other]
                self._fail(other, f"it needs {self._name(spec)}, which failed")

    def _name(self, spec: Spec) -> str:
        return self._names.get(spec, spec.label)

    def _say(self, spec: Spec, text: str, cpu_s: float = 0.0) -> None:
        done = len(self._ran) + len(self._failed)
        self._tell(Event(f"{self._name(spec)}: {text}", done, self._total, cpu_s))
