"""Motions that begin and end in motion, joined to rest by lead-ins and lead-outs that are proved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import certify
from etude.protocols import Limit, Trajectory
from etude.trajectories.chain import Chain, Part
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.lead_in import can_lead, lead_in, lead_out, moves_at
from etude.trajectories.splined import Splined

LASTING = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
"""s of a lead-in; the first that is proved. In 2 s a vehicle is tilted no faster than flights tilt it."""
SLOWER = (1.0, 1.01, 1.03, 1.1, 1.25, 1.5, 2.0)
"""Times of its own in which a motion is tried: one that uses all of a limit on acceleration at its end may
need a little less for its lead-in.
"""


def at_rest(motion: Trajectory, limits: Sequence[Limit]) -> Trajectory:
    """The motion with a lead-in and a lead-out where it is in motion at its ends, else itself.

    It is slowed as little as these need; what was proved of it holds of the slower one. A motion of another
    form than a series is not led in: it stays as it is, and certificates say how it ends.

    Raises:
        UnsafeTrajectoryError: no lead-in is proved at half of the speed.
    """
    if not any(moves_at(motion)):
        return motion
    for factor in SLOWER:
        slower = motion if factor == 1.0 else motion.slowed(factor)
        found = leads(slower, limits)
        if found is not None:
            return with_leads(slower, *found)
    raise UnsafeTrajectoryError(
        "no lead-in from rest to this motion, or lead-out from it, is proved inside the limits",
        next_step="Ask for a slower motion: duration in [trajectory] of campaign.toml.",
    )


def leads(motion: Trajectory, limits: Sequence[Limit]) -> tuple[Splined | None, Splined | None] | None:
    """Lead-in and lead-out, each the shortest that is proved; None at an end where the motion rests, or that
    no series goes on from. None for both if one of them is not proved.
    """
    first, last = motion.pieces()[0][2], motion.pieces()[-1][2]
    starts, ends = moves_at(motion)
    found: list[Splined | None] = []
    for piece, needed, led in ((first, starts, lead_in), (last, ends, lead_out)):
        if not (needed and can_lead(piece)):
            found.append(None)
            continue
        own = _shortest(cast(FourierTrajectory, piece), led, limits)
        if own is None:
            return None
        found.append(own)
    return found[0], found[1]


def with_leads(motion: Trajectory, before: Splined | None, after: Splined | None) -> Trajectory:
    """One chain of them; the motion itself if there is neither."""
    own: list[Part] = [(label, piece) for _, label, piece in motion.pieces()]
    parts: list[Part] = [] if before is None else [("lead-in", before)]
    parts += own
    parts += [] if after is None else [("lead-out", after)]
    return motion if len(parts) == len(own) else Chain(tuple(parts))


def _shortest(
    piece: FourierTrajectory,
    led: Callable[[FourierTrajectory, float], Splined],
    limits: Sequence[Limit],
) -> Splined | None:
    for lasting in LASTING:
        own = led(piece, lasting)
        if not certify(own, limits).failed:
            return own
    return None
