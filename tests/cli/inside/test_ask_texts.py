"""What `ask` prints of distances, in 80 columns, and how errors begin."""

from __future__ import annotations

import math

from etude.cli import ask
from etude.cli.entrance import _block
from etude.types import Proof

PLACE = "upper_forearm_visual and finger at 12.3 s of the segment at 14.286 s; planned distance 0.3 m or more"


def proof(axis: str, where: str) -> Proof:
    return Proof(axis, "clearance", 0.01, math.inf, 0.0123, 0.3, "", "proved", 0.2, 0.0, where)


def test_a_table_of_distances_keeps_to_80_columns_however_long_their_places_are() -> None:
    lines = ask._distances([proof("flange and upper_forearm", PLACE), proof("hand and floor", "")])
    own, told = lines[0].splitlines(), lines[1:]
    assert max(map(len, own)) <= 80
    assert own[1].split() == ["flange", "and", "upper_forearm", "0.0123", "0.01"]
    assert told == ["Places of the least distances:", f"  - flange and upper_forearm: {PLACE}"]


def test_rows_of_segments_and_links_say_which_they_are_of() -> None:
    def speed(axis: str, where: str) -> Proof:
        return Proof(axis, "velocity", -1.0, 1.0, -0.5, 0.5, "", where=where)

    rows = ask._rows(
        [speed("turn", "segment at 3.3 s"), speed("turn", "approach at 0 s"), speed("lift", "segment at 0 s")]
    )
    assert [row[:2] for row in rows] == [
        ["turn", "velocity, segment"],
        ["turn", "velocity, approach"],
        ["lift", "velocity"],
    ]


def test_an_error_begins_with_a_capital_but_for_a_file_that_keeps_its_name() -> None:
    assert _block("models/0001/model.npz was changed") == "etude: models/0001/model.npz was changed"
    assert _block("there is nothing", "here", "Go.") == "etude: There is nothing\n  where: here\n  next:  Go."
