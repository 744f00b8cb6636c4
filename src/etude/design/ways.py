"""The way from where a robot stands to a motion's start, and back from its end: certified, or refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Limit, Trajectory
from etude.design.chain import Ways
from etude.errors import UsageError
from etude.limits.certificate import REST_TOLERANCE, certify, require_certified
from etude.trajectories.chain import Chain, Part

SLOWER = (1.0, 2.0, 4.0)
"""Times of its own in which a way is tried: margins may leave little of a velocity limit."""


@dataclass(frozen=True, eq=False)
class There:
    """To a motion and back.

    Attributes:
        approach, back: from the pose to its start, from its end to the pose; each one move, or two by home.
        whole: with the motion between them, where that starts and ends at rest; else None.
    """

    approach: Trajectory
    back: Trajectory
    whole: Trajectory | None


def there_and_back(
    motion: Trajectory, pose: Array, ways: Ways, limits: Sequence[Limit], home: Array
) -> There | None:
    """Straight ways, or by home where these are not proved; None from kinds that know none.

    Args:
        motion: what is run. pose: (k,) where the robot stands, and shall stand again.
        ways: the kind's. limits: what may not be exceeded. home: (k,) a pose clear of everything.

    Raises:
        UnsafeTrajectoryError: neither way is proved; says what the straight one would leave or touch.
    """
    straight, by_home = ways(motion, pose), ways(motion, home)
    if straight is None or by_home is None:
        return None
    out, back = ways(by_home[0], pose), ways(by_home[1], pose)
    assert out is not None
    assert back is not None
    approach = _proved([(straight[0],), (out[0], by_home[0])], limits)
    returned = _proved([(straight[1],), (by_home[1], back[1])], limits)
    parts: list[Part] = [("approach", part) for part in approach]
    parts += [(label, piece) for _, label, piece in motion.pieces()]
    parts += [("return", part) for part in returned]
    whole = Chain(tuple(parts)) if _rests(motion, limits) else None
    return There(_joined("approach", approach), _joined("return", returned), whole)


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
            slowed = tuple(part.slowed(factor) for part in parts)
            if all(certify(part, limits).ok for part in slowed):
                return slowed
    for part in tried[0]:
        require_certified(part.slowed(SLOWER[-1]), limits)
    raise AssertionError("a way that is proved was refused")


def _joined(label: str, parts: tuple[Trajectory, ...]) -> Trajectory:
    return parts[0] if len(parts) == 1 else Chain(tuple((label, part) for part in parts))


def _rests(motion: Trajectory, limits: Sequence[Limit]) -> bool:
    ends = motion.motion(np.array([0.0, motion.duration]), 3).orders[1:]
    return certify(motion, limits).end_speed <= REST_TOLERANCE and bool(np.abs(ends).max() <= REST_TOLERANCE)
