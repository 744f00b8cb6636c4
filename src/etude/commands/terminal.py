"""What differs on a terminal: its width, and colour for what one must not overlook."""

from __future__ import annotations

import os
import re
import shutil
import textwrap
from typing import TextIO

USUAL = 80
"""Columns where nobody knows better: a pipe, a file."""
LEAST = 40
COLOURS = (
    (re.compile(r"^(etude: |RED: |Problem: )"), "1;31"),
    (re.compile(r"^(Warning: |Look: |First see to )"), "1;33"),
    (re.compile(r"^(Stop: |Go on: )"), "1;32"),
    (re.compile(r"^( *next: |Next: )"), "1;36"),
)
"""Beginnings of lines and their ANSI colours: red, yellow, green, cyan."""


def width() -> int:
    """Columns of the terminal, or COLUMNS of the environment, or 80; never fewer than 40."""
    return max(LEAST, shutil.get_terminal_size((USUAL, 24)).columns)


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
        lines = [part for line in lines for part in _broken(line, width())]
    return "\n".join(_painted(line) for line in lines) if coloured(stream) else "\n".join(lines)


def _broken(line: str, columns: int) -> list[str]:
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
        found = beginning.match(line)
        if found:
            return f"\x1b[{colour}m{found[0]}\x1b[0m{line[found.end() :]}"
    return line
