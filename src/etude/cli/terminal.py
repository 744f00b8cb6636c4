"""Terminal output: width, colours, and a progress bar with the time left."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, TextIO

from etude.progress import watched

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

USUAL = 80
"""Columns of pipes and files."""
LEAST_WIDTH = 40  # columns: in fewer no table can be read
COLOURS = (
    (re.compile(r"^(etude: |RED: |Problem: )"), "1;31"),
    (re.compile(r"^(Warning: |Look: |First see to )"), "1;33"),
    (re.compile(r"^(Stop: |Go on: )"), "1;32"),
    (re.compile(r"^( *next: |Next: )"), "1;36"),
)
"""Beginnings of lines and their ANSI colours: red, yellow, green, cyan."""


def width() -> int:
    """Columns of the terminal, or COLUMNS of the environment, or 80; never fewer than 40."""
    return max(LEAST_WIDTH, shutil.get_terminal_size((USUAL, 24)).columns)


def coloured(stream: TextIO) -> bool:
    """A terminal that shows colour, whose owner has not said NO_COLOR (no-color.org)."""
    return bool(stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb")


def fitted(text: str, stream: TextIO) -> str:
    """The text as `stream` shows it best.

    On a terminal long sentences are broken between words, below their own beginning; in a pipe or a file each
    stays one line, for whoever searches it. Colour is added where `coloured`.
    """
    lines = text.splitlines()
    if stream.isatty():
        lines = [part for line in lines for part in _wrap(line, width())]
    return "\n".join(_painted(line) for line in lines) if coloured(stream) else "\n".join(lines)


def _wrap(line: str, columns: int) -> list[str]:
    if len(line) <= columns:
        return [line]
    margin = re.match(r" *(- |next: +|where: +)?", line)
    indent = " " * (len(margin[0]) if margin else 0)
    return textwrap.wrap(
        line,
        columns,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
        drop_whitespace=True,
    )


def _painted(line: str) -> str:
    for beginning, colour in COLOURS:
        match = beginning.match(line)
        if match:
            return f"\x1b[{colour}m{match[0]}\x1b[0m{line[match.end() :]}"
    return line


PATIENCE_S = 2.0
"""s; shorter commands show no progress."""
BETWEEN_S = 0.1  # between two repaints, which a person cannot tell apart
WRONG = 2.0
"""Times the duration that was said last, above which a new line corrects it where there is no terminal."""
LEAST_DONE = 0.1
"""Fraction that must be done before its time says anything about the rest."""


@contextmanager
def progress_shown(silent: bool) -> Iterator[None]:
    """Shows on stderr how far the command is; nothing if `silent`, as with --json."""
    if silent:
        yield
        return
    bar = Bar()
    try:
        with watched(bar.report):
            yield
    finally:
        bar.stop()


@dataclass
class Bar:
    """Progress bar; shown after `PATIENCE_S`."""

    began: float | None = None
    shown: Progress | None = None
    task: TaskID | None = None
    announced_s: float = 0.0  # in all
    last: float = 0.0

    def report(self, done: float) -> None:
        """`done` in [0, 1]."""
        now = monotonic()
        if self.began is None:  # what is loaded and read before says nothing of the rest
            self.began = now
        elapsed = now - self.began
        if elapsed < PATIENCE_S or done < LEAST_DONE or done >= 1.0:
            return
        if sys.stderr.isatty():
            self._update(done, elapsed)
        elif elapsed / done > WRONG * self.announced_s:
            self.announced_s = elapsed / done
            sys.stderr.write(f"{100 * done:.0f} % done, {time_left(done, elapsed)} left.\n")
            sys.stderr.flush()

    def stop(self) -> None:
        """Removes the bar."""
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
    """Time left at the present rate: "about 40 s"."""
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
