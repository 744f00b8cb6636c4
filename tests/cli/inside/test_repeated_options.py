"""Options that stand more than once on a command line."""

from __future__ import annotations

import pytest

from etude.cli import parse

TWICE = (
    (
        "export lab --to c --set a=1 b=2 --real float --set=c=3 --set d=4",
        "more",
        ("a=1", "b=2", "c=3", "d=4"),
    ),
    ("export --set=c=3 lab --set d=4 --to c", "more", ("c=3", "d=4")),
    ("init lab --range a=0..1 --robot x.urdf --range b=0..2", "range", ("a=0..1", "b=0..2")),
    ("ask lab --format px4 --speed 50 --format ros2 px4", "format", ("px4", "ros2", "px4")),
    ("tell lab log.csv --accept a --accept b", "accept", ("a", "b")),
)


@pytest.mark.parametrize(("line", "name", "words"), TWICE)
def test_an_option_that_stands_twice_keeps_all_its_words(
    line: str, name: str, words: tuple[str, ...]
) -> None:
    found = parse.command(line.split())
    assert getattr(found, name) == words
    assert str(getattr(found, "folder", "lab")) == "lab"
