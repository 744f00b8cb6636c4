"""Motions that begin and end in motion, joined to rest by lead-ins and lead-outs that are proved.

The Fourier series is also defined before its first instant and after its last one. A lead-in follows it there
from rest: the series' time starts smoothly, so that poses stay on the path and speeds below the path's own.
The file contains septics through points of this motion, and a certificate proves these septics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np

from etude._runtime.rounding import whole_up
from etude.errors import UnsafeTrajectoryError
from etude.limits.certificate import certify
from etude.protocols import Limit, Trajectory
from etude.trajectories.chain import Chain, Part
from etude.trajectories.fourier import FourierTrajectory, series
from etude.trajectories.splined import Splined
from etude.types import Array

LASTING = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
"""s, durations of a lead-in, tried in turn until one is proved. In 2 s a vehicle tilts no faster than in
usual flights.
"""
SLOWER = (1.0, 1.01, 1.03, 1.1, 1.25, 1.5, 2.0)
"""Factors on a motion's duration that are tried: a motion that uses a whole limit of acceleration at its end
may have to be a little slower for its lead-in.
"""


ORDERS = 4
"""Position to jerk are continuous where a lead-in ends, and so are attitudes and body rates of a vehicle."""
PIECES = 0.25
"""s between two points of a lead-in; the septics are then within 1e-5 of the path of usual flights."""
STILL = 1e-9
"""m (rad) per s, s^2, s^3: smaller derivatives at an end count as rest."""


def moves_at(trajectory: Trajectory) -> tuple[bool, bool]:
    """Whether it is in motion at its start, and at its end."""
    ends = trajectory.motion(np.array([0.0, trajectory.duration]), 3).orders
    first, last = np.abs(ends[1:]).max(axis=(0, 2)) > STILL
    return bool(first), bool(last)


def can_lead(trajectory: Trajectory) -> bool:
    """Whether the motion is defined beyond its ends: a Fourier series without a phase ramp."""
    return isinstance(trajectory, FourierTrajectory) and trajectory.ramp == 0.0


def lead_in(trajectory: FourierTrajectory, lasting: float) -> Splined:
    """Motion from rest on its path to its start, in `lasting` s; tracking margins are those of the series."""
    return _lead(trajectory, lasting, out=False)


def lead_out(trajectory: FourierTrajectory, lasting: float) -> Splined:
    """Motion from its end to rest, in `lasting` s."""
    return _lead(trajectory, lasting, out=True)


def _lead(trajectory: FourierTrajectory, lasting: float, *, out: bool) -> Splined:
    count = max(2, whole_up(lasting / PIECES))
    times = np.linspace(0.0, lasting, count + 1)
    s = times / lasting
    theta, rates = _time_scaling(s if not out else 1.0 - s, lasting)
    at = trajectory.duration - theta if out else theta
    rates[1::2] *= -1.0 if out else 1.0  # reversed time changes the sign of odd derivatives
    table = series(trajectory.omega0 * at, trajectory.harmonics, trajectory.omega0, ORDERS)
    points = _chained(table @ trajectory.coefficients, rates)
    joined = trajectory.motion(np.array([trajectory.duration if out else 0.0]), ORDERS).orders[:, 0]
    points[:, -1 if not out else 0] = joined  # the same bits, so that parts meet
    points[1:, 0 if not out else -1] = 0.0
    return Splined(times, points, like=trajectory.form)


def _time_scaling(s: Array, lasting: float) -> tuple[Array, Array]:
    """Time of the series, s, from -lasting/2 at s = 0 to 0 at s = 1, and its first three derivatives.

    Its rate is the septic step 35 s^4 - 84 s^5 + 70 s^6 - 20 s^7, from 0 to 1 with three derivatives that
    vanish at both ends.
    """
    # integral and derivatives of the step
    area = s**5 * (7.0 - 14.0 * s + 10.0 * s**2 - 2.5 * s**3)
    rate = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    second = 140.0 * (s * (1.0 - s)) ** 3 / lasting
    third = 420.0 * (s * (1.0 - s)) ** 2 * (1.0 - 2.0 * s) / lasting**2
    return lasting * (area - 0.5), np.stack([rate, second, third])


def _chained(orders: Array, rates: Array) -> Array:
    """(4, K, k) derivatives in time of a path (4, K, k) in theta, whose rates (3, K) are given."""
    r1, r2, r3 = rates[..., None]
    return np.stack(
        [
            orders[0],
            orders[1] * r1,
            orders[2] * r1**2 + orders[1] * r2,
            orders[3] * r1**3 + 3.0 * orders[2] * r1 * r2 + orders[1] * r3,
        ]
    )


def at_rest(motion: Trajectory, limits: Sequence[Limit]) -> Trajectory:
    """The motion with a lead-in and a lead-out where it is in motion at its ends, else itself.

    The motion is slowed as little as possible; proofs of the faster one hold for the slower one. Only Fourier
    series get leads. Other motions stay unchanged, and certificates give their speed at the ends.

    Raises:
        UnsafeTrajectoryError: no lead-in is proved even at half of the speed.
    """
    if not any(moves_at(motion)):
        return motion
    for factor in SLOWER:
        slower = motion if factor == 1.0 else motion.slowed(factor)
        pair = leads(slower, limits)
        if pair is not None:
            return with_leads(slower, *pair)
    raise UnsafeTrajectoryError(
        "no certified lead-in from rest to this motion, or lead-out from it",
        next_step="Plan a slower motion: duration in [trajectory] of campaign.toml.",
    )


def leads(motion: Trajectory, limits: Sequence[Limit]) -> tuple[Splined | None, Splined | None] | None:
    """Lead-in and lead-out, each the shortest that is proved; None at an end at rest, or without a series to
    follow. The whole result is None if one of them is not proved.
    """
    first, last = motion.pieces()[0][2], motion.pieces()[-1][2]
    starts, ends = moves_at(motion)
    pair: list[Splined | None] = []
    for piece, needed, led in ((first, starts, lead_in), (last, ends, lead_out)):
        if not (needed and can_lead(piece)):
            pair.append(None)
            continue
        lead = _shortest(cast(FourierTrajectory, piece), led, limits)
        if lead is None:
            return None
        pair.append(lead)
    return pair[0], pair[1]


def with_leads(motion: Trajectory, before: Splined | None, after: Splined | None) -> Trajectory:
    """The chain of lead-in, motion and lead-out; the motion itself if it has neither."""
    pieces: list[Part] = [(label, piece) for _, label, piece in motion.pieces()]
    parts: list[Part] = [] if before is None else [("lead-in", before)]
    parts += pieces
    parts += [] if after is None else [("lead-out", after)]
    return motion if len(parts) == len(pieces) else Chain(tuple(parts))


def _shortest(
    piece: FourierTrajectory,
    led: Callable[[FourierTrajectory, float], Splined],
    limits: Sequence[Limit],
) -> Splined | None:
    for lasting in LASTING:
        lead = led(piece, lasting)
        if not certify(lead, limits).failed:
            return lead
    return None
