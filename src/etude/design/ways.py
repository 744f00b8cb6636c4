"""The way from where a robot stands to a motion's start, and back from its end: certified, or refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.design.chain import Ways
from etude.errors import UsageError
from etude.limits.at_rest import leads, with_leads
from etude.limits.certificate import certify, require_certified
from etude.protocols import Limit, Trajectory
from etude.trajectories.chain import JOINED, Chain, Part
from etude.types import Array

SLOWER = (1.0, 2.0, 4.0, 8.0)
"""Times of its own in which a way is tried: margins may leave little of a velocity limit."""


@dataclass(frozen=True, eq=False)
class There:
    """To a motion and back.

    Attributes:
        approach, back: from the pose to its start, from its end to the pose; each one move, or several.
        whole: with the motion between them; None where the ways end at rest and the motion does not.
    """

    approach: Trajectory
    back: Trajectory
    whole: Trajectory | None


def there_and_back(
    motion: Trajectory, pose: Array, ways: Ways, limits: Sequence[Limit], home: Array
) -> There | None:
    """Straight ways, or by home where these are not proved; None from kinds that know none.

    A motion that is in motion at its ends is led in and out along its own path, if that goes on.

    Args:
        motion: what is run. pose: (k,) where the robot stands, and shall stand again.
        ways: the kind's. limits: what may not be exceeded. home: (k,) a pose clear of everything.

    Raises:
        UnsafeTrajectoryError: neither way is proved; says what the straight one would leave or touch.
    """
    before, after = leads(motion, limits) or (None, None)
    led = with_leads(motion, before, after)
    straight, by_home = ways(led, pose), ways(led, home)
    if straight is None or by_home is None:
        return None
    out, back = ways(by_home[0], pose), ways(by_home[1], pose)
    assert out is not None
    assert back is not None
    approach = _proved([(straight[0],), (out[0], by_home[0])], limits)
    returned = _proved([(straight[1],), (by_home[1], back[1])], limits)
    there, again = _labelled("approach", approach), _labelled("return", returned)
    meet = _meet(approach[-1], led, returned[0])
    there = there if before is None else (*there, ("lead-in", before))
    again = again if after is None else (("lead-out", after), *again)
    own = [(label, piece) for _, label, piece in motion.pieces()]
    whole = Chain((*there, *own, *again)) if meet else None
    return There(_joined(there), _joined(again), whole)


def require_inside(pose: Array, lower: Array, upper: Array, names: Sequence[str]) -> None:
    """UsageError with the first coordinate of a pose (k,) that is outside its limits (k,)."""
    for name, at, low, high in zip(names, pose.tolist(), lower.tolist(), upper.tolist(), strict=True):
        if not low <= at <= high:
            raise UsageError(
                f"{name} stands at {at:g}, outside its limits {low:g}..{high:g}",
                where="--from",
                next_step="Bring the robot inside its limits first, or correct the pose or robot.toml.",
            )


def _proved(tried: Sequence[tuple[Trajectory, ...]], limits: Sequence[Limit]) -> tuple[Trajectory, ...]:
    """The first that is proved, as fast as it is; the last word is what the straight one would do."""
    for parts in tried:
        for factor in SLOWER:
            if factor > 1.0 and not all(_rests(part) for part in parts):
                break  # it leads into a motion, whose speed is given
            slowed = tuple(part.slowed(factor) for part in parts)
            if all(certify(part, limits).ok for part in slowed):
                return slowed
    for part in tried[0]:
        require_certified(part.slowed(SLOWER[-1]) if _rests(part) else part, limits)
    raise AssertionError("a way that is proved was refused")


def _labelled(label: str, parts: tuple[Trajectory, ...]) -> tuple[Part, ...]:
    """Each with its label: that of a way which is one piece, or its own."""
    found: list[Part] = []
    for part in parts:
        pieces = part.pieces()
        found += [(own if len(pieces) > 1 else label, piece) for _, own, piece in pieces]
    return tuple(found)


def _joined(parts: tuple[Part, ...]) -> Trajectory:
    return parts[0][1] if len(parts) == 1 else Chain(parts)


def _ends(motion: Trajectory) -> Array:
    """(3, 2, k) position, velocity and acceleration at both ends."""
    return motion.motion(np.array([0.0, motion.duration]), 3).orders


def _rests(motion: Trajectory) -> bool:
    return bool(np.abs(_ends(motion)[1:]).max() <= JOINED)


def _meet(approach: Trajectory, motion: Trajectory, back: Trajectory) -> bool:
    """Whether speed and acceleration go on where the ways and the motion meet."""
    own = _ends(motion)
    jumps = _ends(approach)[1:, 1] - own[1:, 0], _ends(back)[1:, 0] - own[1:, 1]
    return all(np.abs(jump).max() <= JOINED for jump in jumps)
