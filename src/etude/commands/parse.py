"""The command line as types: one dataclass a command, read by tyro."""

from __future__ import annotations

import functools
import importlib
import operator
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from typing import Annotated, Any, cast, get_args, get_origin, get_type_hints

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
AT_ONCE = ("UseAppendAction", "Positional")
"""Marks of tuples that a second time adds to, or that have no name."""


def command(arguments: Sequence[str]) -> Command:
    """The command that the arguments name. Exits with 2 (wrong usage) or 0 (--help) as tyro does.

    Of a command that stands first only its own module is loaded.
    """
    first = arguments[0] if arguments else ""
    known = [first] if first in COMMANDS else list(COMMANDS)
    classes = {name: class_of(name) for name in known}
    of_one = len(known) == 1
    given = gathered(arguments[1:], _several(classes[first])) if of_one else list(arguments)
    for own in classes.values():
        in_words(own)
    page = Page(sys.stdout)
    try:
        with redirect_stdout(page):
            found = tyro.cli(
                classes[first] if of_one else _any_of(classes),
                prog=f"etude {first}" if of_one else "etude",
                description=None if of_one else DESCRIPTION,
                args=given,
                config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    finally:
        page.printed()
    return cast(Command, found)


def gathered(arguments: Sequence[str], several: Sequence[str]) -> list[str]:
    """The arguments, those of an option of several words that stands twice as if it stood once, last.

    argparse, and so tyro, would keep the words of the last one only and say nothing.
    """
    names = [word.partition("=")[0] for word in arguments]
    if all(names.count(name) < 2 for name in several):
        return list(arguments)
    rest: list[str] = []
    own: dict[str, list[str]] = {}
    current = rest
    for word, name in zip(arguments, names, strict=True):
        if name in several:
            current = own.setdefault(name, [name])
            if "=" in word:  # takes this one word alone
                current.append(word.partition("=")[2])
                current = rest
            continue
        current = rest if word.startswith("--") else current
        current.append(word)
    return [*rest, *(word for words in own.values() for word in words)]


def _several(command: type) -> list[str]:
    """Options of a command that take several words at once."""
    found = []
    for name, hint in get_type_hints(command, include_extras=True).items():
        marks = getattr(hint, "__metadata__", ())
        bare = get_args(hint)[0] if marks else hint
        if tuple in (bare, get_origin(bare)) and not {*AT_ONCE} & {repr(mark) for mark in marks}:
            called = [mark.name for mark in marks if getattr(mark, "name", None)]
            found.append(f"--{called[0] if called else name.replace('_', '-')}")
    return found


def class_of(name: str) -> type:
    """The class of a command."""
    module, _, attribute = COMMANDS[name].partition(":")
    found: type = getattr(importlib.import_module(module), attribute)
    return found


def _any_of(classes: Mapping[str, type]) -> Any:
    """The union of all commands, each under its name."""
    own = [Annotated[found, tyro.conf.subcommand(name)] for name, found in classes.items()]
    return functools.reduce(operator.or_, own)
