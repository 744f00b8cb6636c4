"""Finds a study or a bench among the plug-ins and calls it."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from etude import plugins
from etude.errors import UsageError

GROUP, BENCH = "etude.studies", "bench_"
FLAGS = {"pythons": "--python", "logs": "--logs"}
"""Options that must not be given in vain."""


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


def _known(what: str) -> dict[str, str]:
    """Name on the command line -> name of the plug-in."""
    found = plugins.names(GROUP)
    if what == "bench":
        return {name.removeprefix(BENCH): name for name in found if name.startswith(BENCH)}
    return {name: name for name in found if not name.startswith(BENCH)}
