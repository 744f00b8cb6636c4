"""Logged velocities against the slope of the positions: time scale, direction, degrees, foreign columns.

beta_j is the slope, r_j the correlation, of the logged velocity on dq/dt where |dq/dt| exceeds 5 % of its
top, both through one filter. Right logs of real arms stay within 0.04 of 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etude.logs.checks.filtered_motion import Seen
from etude.logs.checks.finding_texts import Mendable, accepted, both, named
from etude.types import Array, Finding, Mask

TIME, DIRECTION, VELOCITY = "time", "direction", "velocity"
"""The checks: the clock's scale, its direction, and the velocities as such."""
NEAR, LIKE, OTHER = 0.1, 0.95, 0.5  # of a slope from 1; correlation with its own position, and with another's
OFF = 0.25  # of 1: seconds of a real log go so far; no unit and no other column is as near
FACTORS = (2.0, 60.0, 1e3, 1e6, 1e9)
"""Possible factors of a wrong clock: half the stated rate, minutes, milli-, micro- and nanoseconds."""
DEGREES = 180.0 / np.pi
LEAST_PERIODS = 12.0  # times the filter's period that a joint moves: less is noise, or the filter's edges
MATCH = 0.15  # of a factor: a driver's filter takes up to 4 %


@dataclass(frozen=True, eq=False)
class Slopes:
    """beta, r (k,) of each joint; NaN for a joint at rest, or with too little motion."""

    beta: Array
    r: Array

    @property
    def agrees(self) -> Mask:
        """(k,) whether the velocity may be the slope of the position.

        Noise in the position makes the slope of logged velocities on it too small, beta = f r^2: the factor f
        itself lies between beta, if all noise is the velocity's, and beta / r^2, if all is the position's.
        """
        most = self.beta / np.maximum(self.r**2, 1e-300)
        return np.asarray((self.beta < 1.0 + OFF) & (most > 1.0 - OFF))

    @staticmethod
    def of(motion: Seen) -> Slopes | None:
        """None where no velocity is logged."""
        if motion.logged is None:
            return None
        beta, r = np.full((2, len(motion.parts)), np.nan)
        for j in np.flatnonzero(motion.seconds * motion.cutoff > LEAST_PERIODS):
            slope, rate = motion.qd[motion.moving[:, j], j], motion.logged[motion.moving[:, j], j]
            slope, rate = slope - slope.mean(), rate - rate.mean()
            square, other = float(slope @ slope), float(rate @ rate)
            if square > 0.0:
                beta[j] = float(slope @ rate) / square
                r[j] = float(slope @ rate) / np.sqrt(square * other) if other > 0.0 else 0.0
        return Slopes(beta, r)


def rate_finding(motion: Seen, rate: float, usual: float | None = None) -> Finding:
    """Findings of the logged velocities.

    Args:
        rate: Hz of the log. usual: Hz at which the robot is logged; it separates factors of 57 and 60.
    """
    slopes = Slopes.of(motion)
    if slopes is None:
        return Finding(
            VELOCITY, "cannot tell", "No velocity is logged that could be compared with the positions."
        )
    finite = np.isfinite(slopes.beta)
    if not finite.any():
        return Finding(VELOCITY, "cannot tell", "No joint moves long enough to check the velocities.")
    beta, r = slopes.beta[finite], slopes.r[finite]
    if (np.abs(beta - 1.0) < NEAR).all() and (r > LIKE).all():
        return Finding(
            VELOCITY,
            "green",
            f"Velocities are the slopes of the positions (factors {beta.min():.3f} to {beta.max():.3f}).",
        )
    whole = _common_finding(motion, slopes, finite, rate, usual)
    return _single_joint_finding(motion, slopes, finite) if whole is None else whole


def _common_finding(
    motion: Seen, slopes: Slopes, finite: Mask, rate: float, usual: float | None
) -> Finding | None:
    """The finding common to all moving joints; None if they differ."""
    beta, r = slopes.beta[finite], slopes.r[finite]
    factor = float(np.median(beta))
    if not (np.abs(r) > LIKE - 0.1).all() or np.abs(beta / factor - 1.0).max() > MATCH:
        return None
    if abs(factor + 1.0) < NEAR:
        return _reversed(bool(finite.sum() > 1), named(motion.parts, finite))
    if "rad" in motion.units and is_degrees(factor, rate, usual):
        return _degrees(factor)
    scale = clock_factor(factor)
    if scale is None:
        return None
    fact = f"velocities are {factor:.3g} times the slopes of the positions in every joint"
    return clock_finding(scale, fact)


def clock_finding(scale: float, fact: str) -> Mendable:
    """Finding of times that have to be divided by `scale`, with the evidence `fact`."""
    pace = f"{scale:g} times too slow" if scale > 1.0 else f"{1.0 / scale:g} times too fast"
    return Mendable(
        TIME,
        "red",
        f"The clock of the log is {pace}: {fact}.",
        both(TIME, f"divide the times by {scale:g}"),
        flag=TIME,
        by=(scale,),
    )


def clock_factor(factor: float) -> float | None:
    """Divisor of the times, from a common factor of the velocities; None if it is no factor of a clock."""
    factors = [*FACTORS, *(1.0 / f for f in FACTORS)]
    best = min(factors, key=lambda f: abs(np.log(abs(factor) / f)))
    return best if factor > 0.0 and abs(np.log(factor / best)) < MATCH else None


def is_degrees(factor: float, rate: float, usual: float | None) -> bool:
    """Whether a factor is that of degrees against radians, and not that of a clock in minutes."""
    ratio = factor if factor > 1.0 else 1.0 / factor
    if factor <= 0.0 or abs(np.log(ratio / DEGREES)) > MATCH:
        return False
    if usual is None:
        return abs(math.log(ratio / DEGREES)) < abs(math.log(ratio / 60.0))
    # a clock that is off by 60 gives the log a rate that is off by 60
    return abs(math.log(rate / usual)) < abs(math.log(rate * factor / usual))


def _reversed(several: bool, parts: str) -> Finding:
    if several:
        fact = "The rows run backwards in time: every velocity is the negative slope of its position."
    else:
        fact = f"Velocity and position of {parts} have opposite signs: reversed rows, or an inverted column."
    return Mendable(DIRECTION, "red", fact, both(DIRECTION, "reverse the order of the rows"), flag=DIRECTION)


def _degrees(factor: float) -> Finding:
    what = "velocities are in degrees per second" if factor > 1.0 else "positions are in degrees"
    return Finding(
        "degrees",
        "red",
        f"The units are mixed: {what}, the others in radians (factor {factor:.3g} in every joint).",
        f"State the unit in the header (q_elbow [deg]) or convert it; {accepted('degrees')}, if only the "
        "velocities are wrong, since training does not use them.",
        flag="degrees",
    )


def _single_joint_finding(motion: Seen, slopes: Slopes, finite: Mask) -> Finding:
    """Findings of single joints, the worst first."""
    foreign = finite & (np.nan_to_num(np.abs(slopes.r)) < OTHER)
    turned = finite & (slopes.beta < 0.0) & (np.abs(slopes.r) > LIKE)
    wrong = finite & ~slopes.agrees & (slopes.r > OTHER) & ~turned
    step = f"Check the columns; {accepted(VELOCITY)}: training uses positions, not velocities."
    whose_are = {j: owner for j in np.flatnonzero(foreign).tolist() if (owner := _velocity_source(motion, j))}
    if motion.command is None:  # a vehicle's estimate, which its sensors pull about
        foreign &= np.isin(np.arange(len(foreign)), list(whose_are))
        wrong &= wrong.sum() > 1  # a height that a barometer pulls about on the ground, not another unit
    if foreign.any():
        others = list(whose_are.values())
        whose = f" ({', '.join(others)})" if others else ""
        fact = f"The velocity of {named(motion.parts, foreign)} is not the slope of its position{whose}."
    elif turned.any():
        fact = f"The velocity of {named(motion.parts, turned)} has the opposite sign of its position's slope."
    elif wrong.sum() > 1 and np.ptp(slopes.beta[finite]) < NEAR * abs(float(np.median(slopes.beta[finite]))):
        factor = float(np.median(slopes.beta[finite]))
        fact = (
            f"Velocities are {factor:.3g} times the slopes of the positions in every joint: another unit, "
            "or a time column without times (a row number, a stopped clock)."
        )
    elif wrong.any():
        factors = ", ".join(f"{value:.3g}" for value in slopes.beta[wrong])
        fact = f"The velocity of {named(motion.parts, wrong)} is {factors} times the slope of its position."
        fact += _degrees_sentence(slopes.beta[wrong])
    else:
        fact = "Velocities agree with positions only roughly: they are noisy, or were filtered."
        return Finding(VELOCITY, "cannot tell", fact)
    return Finding(VELOCITY, "red", fact, step, flag=VELOCITY)


def _degrees_sentence(beta: Array) -> str:
    """The sentence if all factors are that of degrees."""
    if (np.abs(np.log(np.abs(beta) * DEGREES)) < MATCH).all():
        return " The position looks like degrees: state the unit in its header (q_elbow [deg])."
    if (np.abs(np.log(np.abs(beta) / DEGREES)) < MATCH).all():
        return " The velocity looks like degrees per second."
    return ""


def _velocity_source(motion: Seen, j: int) -> str:
    """Text that names the joint whose velocity a wrong column contains, if there is one."""
    assert motion.logged is not None
    for other in np.flatnonzero(motion.moves):
        rows = motion.moving[:, other]
        a, b = motion.qd[rows, other], motion.logged[rows, j]
        like = float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b) + 1e-300)
        if other != j and like > LIKE:
            return f"that of {motion.parts[j]} is {motion.parts[other]}'s"
    return ""


IN_DEGREES = "degrees"
TURN = 6.5  # rad: no hinge of an arm turns further, all of them together
FAST, SLOW = 3.0, 1.0 / 30.0  # top speed over its limit
ALIKE = 1.5  # of rates


def degrees_finding(motion: Seen) -> Finding | None:
    """Finding of positions beyond one turn on every moving hinge; None otherwise."""
    hinges = motion.moves & (np.array(motion.units) == "rad")
    reach = np.abs(motion.q).max(axis=0)
    if hinges.sum() < 2 or not (reach[hinges] > TURN).all():
        return None
    return Finding(
        IN_DEGREES,
        "red",
        f"The positions look like degrees: {named(motion.parts, hinges)} all reach beyond {TURN:g} rad.",
        f"State the unit in the header (q_elbow [deg]), or ingest it with --degrees; {accepted(IN_DEGREES)}.",
        flag=IN_DEGREES,
    )


def speed_finding(motion: Seen, top: Array, rate: float, usual: float | None) -> Finding | None:
    """Finding of speeds that are impossible, or far below the limits, with a rate that is equally off.

    Args:
        top: (k,) limits of the speeds. rate: Hz of the log. usual: Hz at which the robot is logged; None if
            nobody knows.
    """
    share = float(np.max(np.abs(motion.qd).max(axis=0) / top, initial=0.0))
    if not motion.moves.any() or SLOW <= share <= FAST:
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
