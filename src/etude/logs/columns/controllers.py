"""Columns of a ROS 2 controller's state (JointTrajectoryControllerState), one for each entry of each array.

PlotJuggler writes `/arm_controller/controller_state/feedback/positions[0]`, or `.../actual/positions.0` of
older releases and of older PlotJugglers; the joints then have numbers, in the controller's order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from etude.logs.columns.vocabulary import normal, split_unit

COLUMN = re.compile(
    r"(?:.*_)?controller_state_(?:joints?_(?P<before>.+)_)?(?P<point>feedback|actual|reference|desired|output)_"
    r"(?P<word>position|velocit|acceleration|effort)(?:ies|y|s)?(?:_(?P<after>.+))?"
)
WORDS = {"velocit": "velocity"}
MEASURED, WANTED = ("feedback", "actual"), ("reference", "desired")
OUTPUT = "output"
"""What the controller sends; of it only efforts are commands that are learned."""


def plain(text: str) -> str:
    """ "position_0" of such a normalised header, "position_desired_0" of what was wanted; "" of any other."""
    found = COLUMN.fullmatch(text)
    joint = "" if found is None else found["before"] or found["after"]
    if found is None or not joint:
        return ""
    word, point = WORDS.get(found["word"], found["word"]), found["point"]
    if (word == "effort") != (point == OUTPUT) and point not in MEASURED:
        return ""
    return f"{word}{'_desired' if point in WANTED else ''}_{joint}"


def doubles(headers: Sequence[str]) -> set[str]:
    """Those that say again what another does: Humble fills `actual` beside `feedback`, and efforts may be
    measured beside those that are sent. The first is taken: feedback, actual, reference, desired, output.
    """
    ranks = {point: rank for rank, point in enumerate((*MEASURED, *WANTED, OUTPUT))}
    told: dict[str, list[tuple[int, str]]] = {}
    for header in headers:
        text = normal(split_unit(header)[0])
        found = COLUMN.fullmatch(text)
        if found is not None and plain(text):
            told.setdefault(plain(text), []).append((ranks[found["point"]], header))
    return {header for same in told.values() for _, header in sorted(same)[1:]}
