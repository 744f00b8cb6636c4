"""What a certificate does not prove: sentences, fewer the more of it was looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence

from etude.protocols import Limit, Trajectory
from etude.types import Proof

TRACKING = "How far the robot leaves the plan while it tracks it, overshoot included."
COLLISIONS = "Collisions, with itself and with what stands around it, the floor among it."
WAY = "The way to the start, and the way back from the end."
COMMANDS = "Whether the drives can give the forces that the motion needs."
SPEED = "How fast the tool and the links move through space."
LOAD = "What the robot carries beyond its description."
ALL = (TRACKING, COLLISIONS, WAY, COMMANDS, SPEED, LOAD)
"""What is not looked at where no limit looks at it."""
HELD = ("position", "velocity", "radius", "speed", "tool position", "tool radius", "tool speed", "link speed")
"""Quantities of which tracking keeps a margin; clearance says itself what tracking takes."""


def not_looked_at(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    rows: Sequence[Proof],
    unheld: Sequence[str] = (),
    *,
    way: bool = False,
) -> tuple[str, ...]:
    """The sentences of one certificate.

    Args:
        trajectory: with an approach and a return among its pieces the way was looked at.
        limits: one says by `looks_at` which of `ALL` it looks at, and by `not_looked_at` what it leaves out
            of these.
        rows: their proofs: of some a margin is kept for tracking.
        unheld: what else the robot is known not to hold.
        way: whether the trajectory is the way itself, to a motion's start or back.
    """
    labels = {label for _, label, _ in trajectory.pieces()}
    said = {TRACKING: _of_tracking(rows)}
    for limit in limits:
        for topic in getattr(limit, "looks_at", ()):
            said[topic] = (*said.get(topic, ()), *getattr(limit, "not_looked_at", ()))
    if way or {"approach", "return"} <= labels:
        said[WAY] = ()
    found = [one for topic in ALL for one in said.get(topic, (topic,))]
    return (*found, *unheld)


def _of_tracking(rows: Sequence[Proof]) -> tuple[str, ...]:
    """Nothing where every margin was measured; else of which quantities none was kept, or it is assumed."""
    own = [row for row in rows if row.quantity in HELD and row.status != "not looked at"]
    without = list(dict.fromkeys(row.quantity for row in own if row.margin == 0.0))
    assumed = list(dict.fromkeys(row.quantity for row in own if row.margin > 0.0 and row.confidence == 0.0))
    if not own or len(without) == len({row.quantity for row in own}):
        return (TRACKING,)
    found = [f"How far the robot leaves the plan in {' and '.join(without)}."] if without else []
    if assumed:
        found.append(
            f"Tracking: margins of {' and '.join(assumed)} are assumed: no log{_under(own)} shows that they "
            "are enough."
        )
    return tuple(found)


def _under(rows: Sequence[Proof]) -> str:
    """The control that the rows' margins are of; all of a certificate are of one."""
    return next((f" of a motion under {row.control}" for row in rows if row.control), "")


def in_words(row: Proof) -> str:
    """A row as a sentence: what is asked, how far tracking may leave it, and the limit of both together.

    Of a distance tracking has been taken off already: what is said is what it leaves.
    """
    if row.upper == math.inf:
        taken = tracked_in_words(row)
        under = f" under {row.control}" if row.control else ""
        after = f" after tracking{under} has taken {taken}" if taken else ""
        return f"{row.proved_lower:.4g} is kept{after}, limit {row.lower:.4g}"
    above = row.upper - row.proved_upper <= row.proved_lower - row.lower
    asked, limit = (row.proved_upper, row.upper) if above else (row.proved_lower, row.lower)
    beyond = row.margin if above else -row.margin
    return f"asked {asked:.4g}, {_tracked(row)}limit {limit + beyond:.4g}"


def tracked_in_words(row: Proof) -> str:
    """The margin of a row and how sure it is; nothing where none is kept."""
    if row.margin == 0.0:
        return ""
    if row.confidence == 0.0:
        return f"{row.margin:.3g}, assumed"
    sure = "" if row.confidence == 1.0 else f" with {100.0 * row.confidence:.0f} % confidence"
    return f"{row.margin:.3g}{sure}"


def _tracked(row: Proof) -> str:
    text = tracked_in_words(row)
    under = f"under {row.control} " if row.control else ""
    return f"{under}tracked within {text}, " if text else ""
