"""The command line as types: one dataclass a command, read by tyro."""

from __future__ import annotations

import functools
import importlib
import operator
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from typing import Annotated, Any, cast

import tyro

from etude.commands.help_texts import Page, in_words
from etude.commands.outcome import Command

DESCRIPTION = (
    "Composes the motions that teach a robot's inverse dynamics in as little robot time as possible. "
    "Étude never commands a robot: it writes trajectory files and reads logs. "
    "etude --version says which one this is."
)

COMMANDS = {
    "init": "etude.commands.init:Init",
    "ask": "etude.commands.ask:Ask",
    "tell": "etude.commands.tell:Tell",
    "inspect": "etude.commands.inspect:Inspect",
    "untell": "etude.commands.untell:Untell",
    "abandon": "etude.commands.abandon:Abandon",
    "promote": "etude.commands.promote:Promote",
    "rollback": "etude.commands.rollback:Rollback",
    "watch": "etude.commands.watch:Watch",
    "status": "etude.commands.status:Status",
    "report": "etude.commands.report:Report",
    "predict": "etude.commands.predict:Predict",
    "export": "etude.commands.export:Export",
    "simulate": "etude.commands.simulate:Simulate",
    "demo": "etude.commands.demo:Demo",
    "bench": "etude.commands.bench:Bench",
    "study": "etude.commands.study:Study",
    "plugins": "etude.commands.plugins:Plugins",
    "doctor": "etude.commands.doctor:Doctor",
}
"""Their classes, in the order of the help."""


def command(arguments: Sequence[str]) -> Command:
    """The command that the arguments name. Exits with 2 (wrong usage) or 0 (--help) as tyro does.

    Of a command that stands first only its own module is loaded.
    """
    first = arguments[0] if arguments else ""
    known = [first] if first in COMMANDS else list(COMMANDS)
    classes = {name: class_of(name) for name in known}
    for own in classes.values():
        in_words(own)
    of_one = len(known) == 1
    page = Page(sys.stdout)
    try:
        with redirect_stdout(page):
            found = tyro.cli(
                classes[first] if of_one else _any_of(classes),
                prog=f"etude {first}" if of_one else "etude",
                description=None if of_one else DESCRIPTION,
                args=list(arguments[1:] if of_one else arguments),
                config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    finally:
        page.printed()
    return cast(Command, found)


def class_of(name: str) -> type:
    """The class of a command."""
    module, _, attribute = COMMANDS[name].partition(":")
    found: type = getattr(importlib.import_module(module), attribute)
    return found


def _any_of(classes: Mapping[str, type]) -> Any:
    """The union of all commands, each under its name."""
    own = [Annotated[found, tyro.conf.subcommand(name)] for name, found in classes.items()]
    return functools.reduce(operator.or_, own)
