"""Progress of the runs: a bar with the time left on a terminal, a line a run anywhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from etude_studies.engines.schedule import Event


@contextmanager
def progress(console: Console | None = None) -> Iterator[Callable[[Event], None]]:
    """What to give to `run_all` as `tell`; writes to standard error unless a console is given."""
    terminal = console or Console(stderr=True)
    began = monotonic()
    if not terminal.is_terminal:
        yield lambda event: terminal.print(as_line(event, monotonic() - began), highlight=False, markup=False)
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=terminal, transient=True) as shown:
        task = shown.add_task("", total=None, left="")

        def tell(event: Event) -> None:
            left = time_left(event, monotonic() - began)
            shown.update(task, completed=event.done, total=event.total, left=left)
            shown.console.print(event.text, highlight=False, markup=False)

        yield tell


def as_line(event: Event, elapsed_s: float) -> str:
    """The event with how far the runs are and the time left, where it is known."""
    left = time_left(event, elapsed_s)
    count = f"{event.done} of {event.total}: " if event.total else ""
    return f"{count}{event.text}{f' ({left})' if left else ''}"


def time_left(event: Event, elapsed_s: float) -> str:
    """As many runs as are left, each as long as those before; "" before the first and after the last."""
    if not 0 < event.done < event.total:
        return ""
    seconds = round(elapsed_s / event.done * (event.total - event.done))
    hours, minutes = seconds // 3600, seconds // 60 % 60
    if hours:
        return f"{hours} h {minutes} min left"
    return f"{minutes} min left" if minutes else f"{seconds} s left"
