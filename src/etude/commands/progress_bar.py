"""Progress of a command that takes long: a bar with the time left on a terminal, one plain line elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING

from etude.progress import watched

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

PATIENCE_S = 2.0
"""Commands that end before are not interrupted by any word of it."""
BETWEEN_S = 0.1
LEAST = 0.1
"""Fraction that must be done before its time says anything about the rest."""


@contextmanager
def progress_shown(silent: bool) -> Iterator[None]:
    """Shows on stderr how far the command is; nothing if `silent`, as with --json."""
    if silent:
        yield
        return
    bar = Bar()
    try:
        with watched(bar.told):
            yield
    finally:
        bar.stop()


@dataclass
class Bar:
    """What is shown; made when what is counted has taken `PATIENCE_S`."""

    began: float | None = None
    shown: Progress | None = None
    task: TaskID | None = None
    said: bool = False
    last: float = 0.0

    def told(self, done: float) -> None:
        """`done` in [0, 1]."""
        now = monotonic()
        if self.began is None:  # what is loaded and read before says nothing of the rest
            self.began = now
        elapsed = now - self.began
        if elapsed < PATIENCE_S or done < LEAST or done >= 1.0:
            return
        if sys.stderr.isatty():
            self._update(done, elapsed)
        elif not self.said:
            self.said = True
            sys.stderr.write(f"{100 * done:.0f} % done, {time_left(done, elapsed)} left.\n")
            sys.stderr.flush()

    def stop(self) -> None:
        """Takes the bar away."""
        if self.shown is not None:
            self.shown.stop()

    def _update(self, done: float, elapsed: float) -> None:
        if self.shown is None:
            self.shown, self.task = _started()
        assert self.task is not None
        if elapsed - self.last >= BETWEEN_S:
            self.last = elapsed
            left = f"{time_left(done, elapsed)} left"
            self.shown.update(self.task, completed=done, left=left, refresh=True)


def time_left(done: float, elapsed: float) -> str:
    """As if the rest took as long as what is done: "about 40 s"."""
    seconds = elapsed * (1.0 - done) / done
    if seconds >= 5400.0:
        return f"about {seconds / 3600:.1f} h"
    if seconds >= 100.0:
        return f"about {seconds / 60:.0f} min"
    return f"about {max(1.0, seconds):.0f} s"


def _started() -> tuple[Progress, TaskID]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[left]}"))
    # without a thread of its own, which benches would measure too
    shown = Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False)
    shown.start()
    return shown, shown.add_task("", total=1.0, left="")
