"""Velocity limits of a learned model: no joint is planned more than twice as fast as in its logs."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np

from etude.campaign.record.folder import Campaign
from etude.campaign.record.stored_files import FULL, stored_trajectory
from etude.errors import UsageError
from etude.limits import AxisLimit
from etude.limits.commands import CommandLimit
from etude.protocols import Limit, Trajectory
from etude.types import Array

MOST_FASTER = 2.0
"""Times the recorded speeds up to which residuals are bounded, and motions planned. Forces of friction and
motion beyond them are extrapolated: a model that was right to 1 % at a third of the speed missed 20 %.
"""
ALWAYS = 0.05
"""Part of a joint's velocity limit that is always allowed: what hardly moved in a log has to move next."""
KNOWN = "learned velocity"
"""Quantity of the limit's rows."""


def peak_speeds(trajectory: Trajectory) -> Array:
    """(k,) rad/s or m/s, among samples every 10 ms."""
    t = np.linspace(0.0, trajectory.duration, 2 + int(100.0 * trajectory.duration))
    return np.asarray(np.abs(trajectory.motion(t, 2).orders[1]).max(axis=0))


def with_learned_velocity(campaign: Campaign, number: int | None, limits: Sequence[Limit]) -> Sequence[Limit]:
    """The limits, and one of the speeds of joints that were slow in all logs of the model of a round.

    Only where that model says what the drives need: its deviations say too little of higher speeds.
    """
    learned = any(isinstance(limit, CommandLimit) for limit in limits)
    known = _known_speeds(campaign, number) if learned and number is not None else None
    rate = next((c.name for c in campaign.channels if c.derivative_of == campaign.kind.path), "")
    ranges = campaign.kind.expected(campaign.spec).limits
    if known is None or rate not in ranges:
        return limits
    fastest = np.minimum(ranges[rate][1], -np.asarray(ranges[rate][0]))
    most = np.maximum(MOST_FASTER * known, ALWAYS * fastest)
    slow = tuple(int(j) for j in np.flatnonzero(most < fastest))
    if not slow:
        return limits
    names = tuple(campaign.axes[j] for j in slow)
    return [*limits, AxisLimit(KNOWN, 1, names, -most[list(slow)], most[list(slow)], axes=slow)]


def _known_speeds(campaign: Campaign, number: int) -> Array | None:
    """(k,) largest planned speeds of the logs up to a round; None where a log belongs to no proposal, since
    only its file knows its speeds.
    """
    rounds = [r for r in campaign.state().ingested if r.number <= number and r.ingested is not None]
    speeds = []
    for ingested in rounds:
        fact = ingested.ingested
        if fact is None or fact.foreign:
            return None
        with contextlib.suppress(UsageError):
            peaks = peak_speeds(stored_trajectory(campaign, ingested.number))
            speeds.append(peaks * fact.speed / FULL)
    return np.asarray(np.max(speeds, axis=0)) if speeds else None
