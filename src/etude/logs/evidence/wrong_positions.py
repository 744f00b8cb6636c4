"""Positions of one joint that are logged as a multiple, or later than those of the others.

A gear or the counts for each turn are wrong, a slide has another unit, a bus is slower. The model file's
torque along the true motion fits the commands of all joints better than along the logged one. Each command
has a factor of the file's torque of its own, so that no unit of commands matters. A slide, or an axis about
the vertical, is told by what couples it to other joints alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from etude.logs.checks.finding_texts import accepted
from etude.logs.evidence.delays import LEAST_DELAY
from etude.logs.evidence.file_fit import (
    AHEAD,
    OTHER,
    RIGHT,
    SCREEN,
    FileFit,
    TiedFit,
    score_of_masses,
)
from etude.logs.evidence.rows import FilteredRows
from etude.types import Array, Channel, Finding

GEAR = "gear"
STEP = 1.25  # between factors that are tried: the likelihood of one is about as wide
LATE_STEP = 0.1  # s between delays that are tried
FACTORS = tuple(STEP**k for k in range(-5, 6) if k)
DELAYS = tuple(sign * (0.5 + k) * LATE_STEP for sign in (-1.0, 1.0) for k in range(2))  # s
SCREEN_ROWS = 40  # at which all are tried
Kind = Literal["gear", "delay"]
Motion = tuple[Array, Array, Array]


class WrongPosition(NamedTuple):
    """A joint's positions that are a multiple by a factor, or s late; log odds."""

    kind: Kind
    joint: int
    size: float
    odds: float

    def fact(self, path: Channel) -> str:
        """As "the positions of lift are 2 times the true ones"."""
        positions = f"the positions of {path.parts[self.joint]} are"
        if self.kind == "gear":
            return f"{positions} {self.size:.2g} times the true ones"
        direction = "behind" if self.size > 0.0 else "ahead of"
        return f"{positions} {1e3 * abs(self.size):.0f} ms {direction} the others"

    def true(self, rows: FilteredRows) -> Motion:
        """(n, k) each: the true positions and their rates."""
        motion = rows.q.copy(), rows.qd.copy(), rows.qdd.copy()
        columns = [x[:, self.joint] for x in motion]
        for one, values in zip(columns, self._column(rows.t, *columns), strict=True):
            one[:] = values
        return motion

    def _column(self, t: Array, q: Array, qd: Array, qdd: Array) -> Sequence[Array]:
        if self.kind == "gear":
            return [x / self.size for x in (q, qd, qdd)]
        from scipy.interpolate import CubicHermiteSpline

        at = t + self.size
        return CubicHermiteSpline(t, q, qd)(at), CubicHermiteSpline(t, qd, qdd)(at), np.interp(at, t, qdd)


class WrongPositions(NamedTuple):
    """What explains a log, the likeliest first: nothing tells which of it."""

    each: tuple[WrongPosition, ...]
    odds: float

    def finding(self, path: Channel) -> Finding:
        """The question, with what to correct."""
        facts = ", or ".join(one.fact(path) for one in self.each)
        names = " or ".join(dict.fromkeys(path.parts[one.joint] for one in self.each))
        gears = [f'"{1.0 / one.size:.3g} * HEADER"' for one in self.each if one.kind == "gear"]
        by = f"correct the column in [log.columns] of campaign.toml ({' or '.join(gears)})"
        what = (
            f"gear, unit and counts for each turn of {names}, and {by}" if gears else f"the clock of {names}"
        )
        check = self.each[0].kind
        return Finding(
            check,
            "yellow",
            f"If the model file's masses are right, {facts} (log odds {self.odds:.0f}).",
            f"Check {what}; {accepted(check)}.",
            flag=check,
        )


def wrong_positions(fit: FileFit) -> WrongPositions | None:
    """The joint whose positions are most likely wrong, and those that explain nearly as much; None where
    masses that are off, a load at the last link or a tilted base do.
    """
    screened = _screened(fit)
    most = max(one.odds for one in screened)
    if most < 0.5 * SCREEN:  # between two sizes that are tried it may be twice as much
        return None
    each = [_refined(fit, one) for one in screened if one.odds > 0.5 * most]
    each = sorted((one for one in each if one.odds >= SCREEN), key=lambda one: -one.odds)
    if not each or each[0].odds < AHEAD + _gain_of_masses(fit):
        return None
    as_is = TiedFit.of(fit)
    near = [one for one in each if one.odds > each[0].odds - AHEAD]
    likely = tuple(one for one in near if _tied_odds(fit, as_is, one) >= AHEAD)
    if not likely or (likely[0].kind == "delay" and abs(likely[0].size) < LEAST_DELAY):
        return None
    return WrongPositions(likely, likely[0].odds)


def _screened(fit: FileFit) -> list[WrongPosition]:
    """The likeliest size of each kind for each moving joint, by some of the rows; odds for all of them."""
    every = -(-len(fit.rows.t) // SCREEN_ROWS)
    few = replace(fit, rows=fit.rows.take(np.arange(0, len(fit.rows.t), every)))
    sizes: tuple[tuple[Kind, tuple[float, ...]], ...] = (("gear", FACTORS), ("delay", DELAYS))
    joints = np.flatnonzero(fit.rows.moving).tolist()
    tried = [[WrongPosition(kind, j, size, 0.0) for size in own] for j in joints for kind, own in sizes]
    # the spline of a delay needs all rows
    motions = [_of_each(fit.rows, every), *(_of_each(fit.rows, every, one) for own in tried for one in own)]
    torques = few.along(*(np.array(part) for part in zip(*motions, strict=True)))
    scores = iter([few.score(torque) for torque in torques])
    before = next(scores)
    scored = [[one._replace(odds=every * (next(scores) - before)) for one in own] for own in tried]
    return [max(own, key=lambda one: one.odds) for own in scored]


def _of_each(rows: FilteredRows, every: int, wrong: WrongPosition | None = None) -> Motion:
    q, qd, qdd = (rows.q, rows.qd, rows.qdd) if wrong is None else wrong.true(rows)
    return q[::every], qd[::every], qdd[::every]


def _refined(fit: FileFit, near: WrongPosition) -> WrongPosition:
    """The likeliest size near one that was tried."""
    from scipy.optimize import minimize_scalar

    rows = fit.rows
    before = fit.score(fit.along(rows.q, rows.qd, rows.qdd))
    multiple = near.kind == "gear"

    def at(place: float) -> WrongPosition:
        return near._replace(size=near.size * STEP**place if multiple else near.size + LATE_STEP * place)

    def cost(place: float) -> float:
        return before - fit.score(fit.along(*at(place).true(rows)))

    reach = 1.0 if multiple else 0.5
    optimum = minimize_scalar(cost, bounds=(-reach, reach), method="bounded", options={"xatol": 0.05})
    return at(float(optimum.x))._replace(odds=-float(optimum.fun))


def _gain_of_masses(fit: FileFit) -> float:
    assert fit.rows.torque is not None
    return score_of_masses(fit) - fit.score(fit.rows.torque)


def _tied_odds(fit: FileFit, as_is: TiedFit, wrong: WrongPosition) -> float:
    """Log odds against the logged positions, with masses, loads and gravity as far off as they may be."""
    q, qd, qdd = wrong.true(fit.rows)
    rows = replace(fit.rows, q=q, qd=qd, qdd=qdd, torque=fit.along(q, qd, qdd))
    right, one = TiedFit.of(replace(fit, rows=rows)), np.ones((1, len(as_is.products)))
    others = max(float(as_is.scores(one, deviations)[0]) for deviations in (RIGHT, OTHER))
    return float(right.scores(one, RIGHT)[0]) - others
