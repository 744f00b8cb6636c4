"""What the helps would be if tyro read the commands as they are: docs/decisions/0057-help-texts.md."""

from __future__ import annotations

import os
import re
import subprocess
import sys

NOISE = {
    "a choice that nobody types": re.compile(r"\{None\}|,\}"),
    "brackets in brackets": re.compile(r"\[[A-Z]+ \["),
    "a default that says nothing": re.compile(r"\(default:\s*(?:None|False|''|\(\))?\)"),
}
HELPS = """
import contextlib
from etude.cli import parse
{change}
for name in parse.COMMANDS:
    with contextlib.suppress(SystemExit):
        parse.command([name, "--help"])
"""


def noise(change: str) -> dict[str, int]:
    """How often each stands in the helps of all commands, of a program of its own."""
    done = subprocess.run(
        [sys.executable, "-c", HELPS.format(change=change)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "COLUMNS": "100", "PYTHONIOENCODING": "utf-8"},
        encoding="utf-8",
    )
    assert done.stdout.count("show this help message and exit") > 15
    return {name: len(pattern.findall(done.stdout)) for name, pattern in NOISE.items()}


def test_helps_say_nothing_that_nobody_needs() -> None:
    assert noise("") == dict.fromkeys(NOISE, 0)


def test_tyro_alone_says_it_in_many_places() -> None:
    plain = noise("parse.describe_fields = lambda command: command")
    print(plain)
    assert min(plain.values()) > 4, "tyro leaves it out by itself: look at the record again"
