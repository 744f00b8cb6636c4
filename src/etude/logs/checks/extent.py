"""Clock and angles where no velocity is logged: what the limits and the robot's usual rate leave possible."""

from __future__ import annotations

import numpy as np

from etude.logs.checks.rates import FACTORS, clock_finding
from etude.logs.checks.seen import Seen
from etude.logs.checks.words import accepted, named
from etude.types import Array, Finding

DEGREES = "degrees"
TURN = 6.5  # rad: no hinge of an arm turns further, all of them together
FAST, SLOW = 3.0, 1.0 / 30.0  # top speed over its limit
ALIKE = 1.5  # of rates


def degrees_finding(seen: Seen) -> Finding | None:
    """Positions beyond a turn on every hinge that moves; None if they are not."""
    hinges = seen.moves & (np.array(seen.units) == "rad")
    reach = np.abs(seen.q).max(axis=0)
    if hinges.sum() < 2 or not (reach[hinges] > TURN).all():
        return None
    return Finding(
        DEGREES,
        "red",
        f"The positions look like degrees: {named(seen.parts, hinges)} all reach beyond {TURN:g} rad.",
        f"State the unit in the header (q_elbow [deg]), or tell it with --degrees; {accepted(DEGREES)}.",
        flag=DEGREES,
    )


def speed_finding(seen: Seen, top: Array, rate: float, usual: float | None) -> Finding | None:
    """Speeds that no robot has, or that are far below what it can, at a rate that is off alike.

    Args:
        top: (k,) limits of the speeds. rate: Hz of the log. usual: Hz at which the robot is logged; None if
            nobody knows.
    """
    share = float(np.max(np.abs(seen.qd).max(axis=0) / top, initial=0.0))
    if not seen.moves.any() or SLOW <= share <= FAST:
        return None
    scales = [1.0 / f for f in FACTORS[1:]] if share > FAST else list(FACTORS[1:])
    # the scale that brings the rate nearest to the usual one, or the least that gives a possible speed
    if usual is not None:
        scale = min(scales, key=lambda f: abs(np.log(rate * f / usual)))
        if abs(np.log(rate * scale / usual)) > np.log(ALIKE):
            return None
    elif share > FAST:
        scale = max((f for f in scales if share * f <= 1.0), default=scales[-1])
    else:
        return None
    return clock_finding(scale, f"the fastest joint moves at {share:.3g} times its limit at this rate")
