"""Help as people read it: what an option takes in a word, no Python types, no defaults that say nothing."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
import types
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import tyro

from etude.commands.terminal import coloured, width

WORDS = {Path: "PATH", int: "N", float: "NUMBER", str: "NAME", bool: ""}
"""What stands for a value of a type."""
SAYS_NOTHING = ("", "None", "False", "''", "()")
"""Defaults that are not worth a reader's time: the option is simply not given."""
ESCAPE = re.compile(r"\x1b\[[0-9;]*m")
COMMANDS = re.compile(r"^(\S*usage:[^\n]* etude \[-h\] )\{[\w,-]+\}")


@cache
def in_words(command: type) -> type:
    """The same class, its annotations completed for tyro: metavars, helps in one piece, useful defaults."""
    texts = _field_texts(command)
    hints = get_type_hints(command, include_extras=True)
    command.__annotations__ = {
        own.name: Annotated[_quickly_read(hints[own.name]), _told(hints[own.name], texts.get(own.name))]
        for own in fields(cast(Any, command))
    }
    return command


def _quickly_read(hint: Any) -> Any:
    """The same hint as tyro can hold a default against without loading a library of a twentieth of a second.

    It reads a bare `tuple` as `tuple[str, ...]`, and of unions only `Union` is looked into.
    """
    if get_origin(hint) is Annotated:
        return Annotated[(_quickly_read(hint.__origin__), *hint.__metadata__)]
    if get_origin(hint) is types.UnionType:
        return Union[tuple(_quickly_read(own) for own in get_args(hint))]  # noqa: UP007
    return tuple if hint == tuple[str, ...] else hint


def _told(hint: Any, text: str | None) -> Any:
    given = [own for own in getattr(hint, "__metadata__", ()) if getattr(own, "metavar", None)]
    metavar = None if given else _metavar(hint)
    return tyro.conf.arg(metavar=metavar or None, help=text, help_behavior_hint=_default)


def _default(label: str) -> str:
    return "" if label in SAYS_NOTHING else f"(default: {label})"


def _metavar(hint: Any) -> str:
    """In a word what one writes: of `tuple[str, ...]` "NAME ...", of a Literal its words in braces."""
    if get_origin(hint) is Annotated:
        again = tyro.conf.UseAppendAction[int].__metadata__[0] in hint.__metadata__  # type: ignore[attr-defined]
        return _metavar(get_args(hint)[0]).removesuffix(" ..." if again else "\0")
    if get_origin(hint) in (Union, types.UnionType):
        return next(_metavar(own) for own in get_args(hint) if own is not types.NoneType)
    if get_origin(hint) is Literal:
        return "{" + ",".join(str(own) for own in get_args(hint) if own != "") + "}"
    if get_origin(hint) is tuple:
        return f"{_metavar(get_args(hint)[0])} ..."
    return WORDS.get(hint, "VALUE")


def _field_texts(command: type) -> dict[str, str]:
    """The string below each field of a class and its bases, its lines joined."""
    found: dict[str, str] = {}
    for owner in reversed(command.__mro__[:-1]):
        body = ast.parse(textwrap.dedent(inspect.getsource(owner))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            told = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and told:
                found[field.target.id] = " ".join(str(cast(Any, text).value.value).split())
    return found


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
            text = "\n".join(_broken(COMMANDS.sub(r"\1COMMAND", text, count=1).rstrip().splitlines())) + "\n"
        self.stdout.write(text)
        self.stdout.flush()


def _broken(lines: Sequence[str]) -> list[str]:
    found: list[str] = []
    for line in lines:
        fits = len(ESCAPE.sub("", line)) <= width()
        indent = "    " if "usage:" in line else ""
        found += (
            [line] if fits else textwrap.wrap(line, width(), subsequent_indent=indent, break_on_hyphens=False)
        )
    return found
