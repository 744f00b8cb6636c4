"""Dataclasses from TOML: exact both ways, and every refusal names file and key."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etude.errors import UsageError
from etude.toml_tables import decoded, from_table, read_table, toml_value, write_table, write_values


@dataclass(frozen=True)
class Part:
    name: str
    size: float
    unit: Literal["rad", "m"] = "rad"


@dataclass(frozen=True)
class Whole:
    rate: float
    count: int = 3
    box: tuple[float, float] | None = None
    main: Part | None = None
    part: tuple[Part, ...] = field(default=(), metadata={"label": "joint"})

    def __post_init__(self) -> None:
        if self.count < 1:
            raise UsageError("count must be at least 1", where="whole.count", next_step="Raise it.")


TEXT = """rate = 100
box = [0, 1.5]
[main]
name = "m"
size = 1
[[part]]
name = "a"
size = 2.0
[[part]]
name = "b"
size = 3.0
unit = "m"
"""


def parse(text: str) -> Whole:
    return from_table(Whole, decoded(text, "w.toml"), "w.toml")


def test_reads_tables_and_arrays_of_tables() -> None:
    assert parse(TEXT) == Whole(100.0, 3, (0.0, 1.5), Part("m", 1.0), (Part("a", 2.0), Part("b", 3.0, "m")))


@given(
    st.lists(st.tuples(st.text(), st.floats(allow_nan=False, allow_infinity=False)), max_size=4),
    st.text(st.characters(exclude_categories=("Cs",)), max_size=30),
)
def test_what_is_written_is_read_back_whatever_it_is_called(rows: list, comment: str) -> None:
    whole = Whole(5.0, part=tuple(Part(name, size) for name, size in rows), main=Part("x", 1.0))
    assert parse(write_values(whole, (f"say {toml_value(comment)}",))) == whole


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate = 100", "rates = 100", ("unknown key 'rates' [w.toml]", "Did you mean rate?")),
        ("rate = 100", "", ("missing rate [w.toml]", "State each")),
        ("size = 3.0", "", ("missing size", "w.toml, joint 'b'")),
        ("size = 3.0", 'size = "3"', ('size takes a number, not "3"', "w.toml, joint 'b' size")),
        ("size = 1", "sizes = 1", ("unknown key 'sizes'", "w.toml [main]", "Valid keys: name, size, unit")),
        ('name = "b"\n', "", ("missing name", "joint 2")),
        ("[[part]]", "[part]", ("part must be an array of tables", "[[part]]")),
        ("[main]", "[[main]]", ("expected a table of keys",)),
        ("rate = 100", "rate = 100\ncount = 0", ("count must be at least 1", "w.toml whole.count", "Raise")),
        ("size = 3.0", 'size = "3"', ("Write it as in size = 0.5",)),
        ("rate = 100", "rate = = 100", ("not valid TOML", "w.toml", "line 1")),
        ("box = [0, 1.5]", "box = [0]", ('box takes a list of 2 entries, each a number or "none", not [0]',)),
    ],
)
def test_refusals_name_file_and_key(old: str, new: str, words: tuple[str, ...]) -> None:
    text = TEXT.replace(old, new, 1)
    if new == "[part]":  # one table where there should be several
        text = text[: text.index("[[part]]")]
    with pytest.raises(UsageError) as problem:
        parse(text)
    for word in words:
        assert word in str(problem.value)


def test_a_table_is_laid_over_what_is_known() -> None:
    start = Whole(10.0, 7, (1.0, 2.0))
    assert read_table(Whole, {"count": 2, "box": "none"}, start, "c.toml") == Whole(10.0, 2, None)
    with pytest.raises(UsageError, match=r"unknown key 'cuont' \[c.toml\]. Did you mean count"):
        read_table(Whole, {"cuont": 2}, start, "c.toml")
    with pytest.raises(UsageError, match="expected a table"):
        read_table(Whole, 3, start, "c.toml")


def test_a_written_table_has_every_field_and_its_comment() -> None:
    text = write_table("part", Part("a", 2.0), {"size": "how large"})
    assert text.startswith("[part]\n")
    assert "# how large" in text
    assert decoded(text, "")["part"] == {"name": "a", "size": 2.0, "unit": "rad"}
