"""Command-line parsing: one dataclass for each command, read by tyro, with readable help."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import operator
import re
import sys
import textwrap
import types
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import tyro

from etude.cli.outcome import Command
from etude.cli.terminal import coloured, width
from etude.errors import UsageError, did_you_mean

DESCRIPTION = (
    "Étude plans the motions that identify a robot's inverse dynamics in as little robot time as possible. "
    "Only etude run moves a robot; all other commands read and write files. etude --version shows the "
    "version."
)

COMMANDS = {
    "init": "etude.cli.init:Init",
    "ask": "etude.cli.ask:Ask",
    "tell": "etude.cli.tell:Tell",
    "inspect": "etude.cli.inspect:Inspect",
    "learn": "etude.cli.learn:Learn",
    "untell": "etude.cli.tell:Untell",
    "abandon": "etude.cli.tell:Abandon",
    "promote": "etude.cli.promote:Promote",
    "rollback": "etude.cli.promote:Rollback",
    "watch": "etude.cli.promote:Watch",
    "payload": "etude.cli.payload:Payload",
    "status": "etude.cli.status:Status",
    "report": "etude.cli.report:Report",
    "view": "etude.cli.view:View",
    "predict": "etude.cli.export:Predict",
    "export": "etude.cli.export:Export",
    "run": "etude.cli.run:RunRobot",
    "simulate": "etude.cli.simulate:Simulate",
    "demo": "etude.cli.demo:Demo",
    "bench": "etude.cli.study:Bench",
    "study": "etude.cli.study:Study",
    "plugins": "etude.cli.doctor:Plugins",
    "doctor": "etude.cli.doctor:Doctor",
}
"""Their classes, in the order of the help."""
AT_ONCE = ("UseAppendAction", "Positional")
"""Marks of tuples that a second time adds to, or that have no name."""


WORDS = {Path: "PATH", int: "N", float: "NUMBER", str: "NAME", bool: ""}
"""Metavar of each type."""
SAYS_NOTHING = ("", "None", "False", "''", "()")
"""Defaults that help texts leave out."""
FRAME = re.compile(r"^[│|]|[│|]$|─{3,}|-{10,}")
"""Characters of a box around a text."""
HINTS = {
    "Perhaps you meant: ": "Perhaps you meant: ",
    "Arguments are applied to ": "Arguments are applied to ",
    "Argument helptext: ": "Write ",
    "Expected one of ": "Write one of ",
}
"""Beginnings of tyro's hints, and what is printed instead."""
PLAIN = (
    (re.compile(r"Error parsing (\S+): .*?'([^']*)'.*"), r"\1 cannot be '\2'"),
    (re.compile(r"[Ii]nvalid choice '([^']*)' for argument '([^']*)'\."), r"\2 cannot be '\1'"),
    (re.compile(r"Missing value for argument '([^']*)'.*"), r"\1 has no value"),
)
"""Facts in tyro's words -> in plain ones."""
INDENT = 4
"""Columns by which names of options are indented in an error box; help texts by as many again."""
ESCAPE = re.compile(r"\x1b\[[0-9;]*m")
USAGE = re.compile(r"^(\S*usage:[^\n]* etude \[-h\] )\{[\w,-]+\}")


@cache
def describe_fields(command: type) -> type:
    """The same class, its annotations completed for tyro: metavars, helps in one piece, useful defaults.

    docs/decisions/0057-help-texts.md counts what tyro prints without them.
    """
    texts = _field_texts(command)
    hints = get_type_hints(command, include_extras=True)
    command.__annotations__ = {
        field.name: Annotated[hints[field.name], _with_metavar(hints[field.name], texts.get(field.name))]
        for field in fields(cast(Any, command))
    }
    return command


def _with_metavar(hint: Any, text: str | None) -> Any:
    marked = [mark for mark in getattr(hint, "__metadata__", ()) if getattr(mark, "metavar", None)]
    metavar = None if marked else _metavar(hint)
    return tyro.conf.arg(metavar=metavar or None, help=text, help_behavior_hint=_default)


def _default(label: str) -> str:
    return "" if label in SAYS_NOTHING else f"(default: {label})"


def _metavar(hint: Any) -> str:
    """Metavar of a type: "NAME ..." of `tuple[str, ...]`, the values in braces of a Literal."""
    if get_origin(hint) is Annotated:
        again = tyro.conf.UseAppendAction[int].__metadata__[0] in hint.__metadata__  # type: ignore[attr-defined]
        return _metavar(get_args(hint)[0]).removesuffix(" ..." if again else "\0")
    if get_origin(hint) in (Union, types.UnionType):
        return next(_metavar(item) for item in get_args(hint) if item is not types.NoneType)
    if get_origin(hint) is Literal:
        return "{" + ",".join(str(item) for item in get_args(hint) if item != "") + "}"
    if get_origin(hint) is tuple:
        return f"{_metavar(get_args(hint)[0])} ..."
    return WORDS.get(hint, "VALUE")


def _field_texts(command: type) -> dict[str, str]:
    """Docstring of each field of a class and its bases, on one line."""
    texts: dict[str, str] = {}
    for owner in reversed(command.__mro__[:-1]):
        body = ast.parse(textwrap.dedent(inspect.getsource(owner))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            documented = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and documented:
                texts[field.target.id] = " ".join(str(cast(Any, text).value.value).split())
    return texts


class Page(StringIO):
    """Stands in for stdout while tyro prints a help; it is coloured where stdout would be."""

    def isatty(self) -> bool:
        """As tyro asks it."""
        return coloured(cast(Any, self.stdout))

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of stdout: boxes are drawn where it has them."""
        return str(self.stdout.encoding)

    def __init__(self, stdout: Any) -> None:
        super().__init__()
        self.stdout = stdout

    def printed(self) -> None:
        """Prints the page, nothing wider than the terminal: tyro breaks lines in its boxes only."""
        text = self.getvalue()
        if "usage:" in text[:20]:
            text = "\n".join(_wrap_lines(USAGE.sub(r"\1COMMAND", text, count=1).rstrip().splitlines())) + "\n"
        self.stdout.write(text)
        self.stdout.flush()


def _wrap_lines(lines: Sequence[str]) -> list[str]:
    wrapped: list[str] = []
    for line in lines:
        fits = len(ESCAPE.sub("", line)) <= width()
        indent = "    " if "usage:" in line else ""
        wrapped += (
            [line] if fits else textwrap.wrap(line, width(), subsequent_indent=indent, break_on_hyphens=False)
        )
    return wrapped


def command(arguments: Sequence[str]) -> Command:
    """The command that the arguments name. Exits with 2 (wrong usage) or 0 (--help) as tyro does.

    Of a command that stands first only its own module is loaded.
    """
    first = arguments[0] if arguments else ""
    if first and first not in COMMANDS and not first.startswith("-"):
        hint = did_you_mean(first, COMMANDS)
        raise UsageError(
            f"there is no command {first!r}", next_step=f"{hint}etude --help lists all commands."
        )
    names = [first] if first in COMMANDS else list(COMMANDS)
    classes = {name: class_of(name) for name in names}
    of_one = len(names) == 1
    merged = merged_options(arguments[1:], _multiple_options(classes[first])) if of_one else list(arguments)
    for command_class in classes.values():
        describe_fields(command_class)
    page, wrong = Page(sys.stdout), StringIO()
    prog = f"etude {first}" if of_one else "etude"
    try:
        with redirect_stdout(page), redirect_stderr(wrong):
            parsed = tyro.cli(
                classes[first] if of_one else _any_of(classes),
                prog=prog,
                description=None if of_one else DESCRIPTION,
                args=merged,
                config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as exit:
        if exit.code:
            raise _refused(wrong.getvalue(), prog) from None
        raise
    finally:
        page.printed()
    return cast(Command, parsed)


def _refused(box: str, prog: str) -> UsageError:
    """UsageError with the facts of tyro's error box; help texts are left to --help."""
    text = " ".join(_facts(box))
    fact, mark, hint = next((parts for mark in HINTS if (parts := text.partition(mark))[1]), (text, "", ""))
    for pattern, plain in PLAIN:
        fact = pattern.sub(plain, fact)
    values = sorted({*re.findall("'([^']*)'", hint)} - {"None", ""}, key=lambda one: (len(one), one))
    step = f"{HINTS[mark]}{', '.join(values) or hint.strip()}. " if mark else ""
    return UsageError(
        fact.strip().removesuffix(".") or "wrong arguments",
        where=prog,
        next_step=f"{step}{prog} --help lists the options.",
    )


def _facts(box: str) -> list[str]:
    """Rows of tyro's error box without title, frame and help texts.

    Facts are not indented; names of options are, once; help texts follow a name or are indented twice.
    """
    # the frame is drawn only where the encoding has one
    drawn = [FRAME.sub("", ESCAPE.sub("", row).rstrip()) for row in box.strip("\n").splitlines()[1:]]
    rows = [row.rstrip() for row in drawn if row.strip() and row[:1] != "╰" and "--help" not in row]
    depths = [(len(row) - len(row.lstrip())) // INDENT for row in rows]
    first = min(depths, default=0)
    kept = (
        row.strip()
        for row, depth, before in zip(rows, depths, [first, *depths], strict=False)
        if depth == first or (depth == first + 1 and before != first + 1)
    )
    return [row for row in kept if not row.startswith("For full helptext")]


def merged_options(arguments: Sequence[str], several: Sequence[str]) -> list[str]:
    """The arguments, with repeated options of several values merged into one at the end.

    argparse, and so tyro, would keep the words of the last one only and say nothing.
    """
    names = [word.partition("=")[0] for word in arguments]
    if all(names.count(name) < 2 for name in several):
        return list(arguments)
    others: list[str] = []
    repeated: dict[str, list[str]] = {}
    current = others
    for word, name in zip(arguments, names, strict=True):
        if name in several:
            current = repeated.setdefault(name, [name])
            if "=" in word:  # takes this one word alone
                current.append(word.partition("=")[2])
                current = others
            continue
        current = others if word.startswith("--") else current
        current.append(word)
    return [*others, *(word for group in repeated.values() for word in group)]


def _multiple_options(command: type) -> list[str]:
    """Options of a command that take several values at once."""
    options = []
    for name, hint in get_type_hints(command, include_extras=True).items():
        marks = getattr(hint, "__metadata__", ())
        bare = get_args(hint)[0] if marks else hint
        if tuple in (bare, get_origin(bare)) and not {*AT_ONCE} & {repr(mark) for mark in marks}:
            called = [mark.name for mark in marks if getattr(mark, "name", None)]
            options.append(f"--{called[0] if called else name.replace('_', '-')}")
    return options


def class_of(name: str) -> type:
    """The class of a command."""
    module, _, attribute = COMMANDS[name].partition(":")
    command_class: type = getattr(importlib.import_module(module), attribute)
    return command_class


def _any_of(classes: Mapping[str, type]) -> Any:
    """The union of all commands, each under its name."""
    named = [Annotated[command_class, tyro.conf.subcommand(name)] for name, command_class in classes.items()]
    return functools.reduce(operator.or_, named)
