"""Finds a study or a bench among the plug-ins and calls it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from etude import plugins
from etude.errors import UsageError

if TYPE_CHECKING:
    from etude.report.live import Pages

GROUP, BENCH = "etude.studies", "bench_"
FLAGS = {"pythons": "--python", "logs": "--logs"}
"""Options that must not be given in vain."""


class Listed(Protocol):
    """One row of `etude study list`: what it is asked for by, a line, committed seeds, a verdict's word."""

    @property
    def id(self) -> str: ...
    @property
    def what(self) -> str: ...
    @property
    def seeds(self) -> int: ...
    @property
    def verdict(self) -> str: ...
    @property
    def command(self) -> str: ...


class Room(Protocol):
    """A study of many ids: an object in the place of a function. Text is for people, data for machines."""

    def rows(self) -> Sequence[Listed]: ...
    def knows(self, id: str) -> bool: ...
    def refuse(self, id: str) -> UsageError: ...
    def run(
        self, id: str, options: Mapping[str, Any], say: Callable[[str], None]
    ) -> tuple[str, dict[str, Any]]: ...
    def show(self, id: str) -> tuple[str, dict[str, Any]]: ...
    def report(self, folder: Path, options: Mapping[str, Any]) -> tuple[str, dict[str, Any]]: ...
    def live(self, options: Mapping[str, Any]) -> Pages: ...


def run_study(
    what: str, name: str, options: Mapping[str, Any], optional: Mapping[str, Any], **more: Any
) -> None:
    """Runs the study or bench of that name, which prints its rows.

    Args:
        what: "study" or "bench".
        name: without the prefix of a bench.
        options: of each of them.
        optional: passed on only to a function that takes them.
        more: of each of them too.

    Raises:
        UsageError: there is none of that name, it cannot be loaded, or has no use for an option given.
    """
    require_studies()
    known = _known(what)
    if name not in known:
        listed = ", ".join(sorted(known)) or "none yet"
        raise UsageError(f"there is no {what} {name!r}", next_step=f"Known: {listed}.")
    function = plugins.load(GROUP, known[name])
    taken = inspect.signature(function).parameters
    for option, flag in FLAGS.items():
        if optional.get(option) and option not in taken:
            raise UsageError(f"{what} {name!r} has no use for {flag}", where=flag, next_step="Leave it out.")
    function(**options, **more, **{key: value for key, value in optional.items() if key in taken})


def require_studies() -> None:
    """UsageError with the command that installs them: there are none."""
    if not plugins.names(GROUP):
        raise UsageError(
            "the studies are a package of their own, which is not installed",
            next_step="In a checkout of Étude: pip install ./packages/etude-studies",
        )


def functions() -> dict[str, str]:
    """Studies that are a function each: name -> what the first line of its module says."""
    found = {}
    for name, own in _loaded().items():
        if not hasattr(own, "rows"):
            told = inspect.getdoc(inspect.getmodule(own)) or ""
            found[name] = told.partition("\n")[0].partition(": ")[2]
    return found


def rooms() -> list[Room]:
    """Studies of many ids."""
    return [own for own in _loaded().values() if hasattr(own, "rows")]


def _loaded() -> dict[str, Any]:
    """Every study that can be loaded; what is wrong with the others says `etude plugins`."""
    found = {}
    for name in _known("study"):
        with suppress(UsageError):
            found[name] = plugins.load(GROUP, name)
    return found


def room_of(id: str) -> Room | None:
    """The study that knows this id."""
    return next((room for room in rooms() if room.knows(id)), None)


def no_study(id: str) -> UsageError:
    """What to say of an id that no study knows."""
    return next(
        (room.refuse(id) for room in rooms()),
        UsageError(f"there is no study {id!r}", next_step=f"Known: {', '.join(functions())}."),
    )


def _known(what: str) -> dict[str, str]:
    """Name on the command line -> name of the plug-in."""
    found = plugins.names(GROUP)
    if what == "bench":
        return {name.removeprefix(BENCH): name for name in found if name.startswith(BENCH)}
    return {name: name for name in found if not name.startswith(BENCH)}
