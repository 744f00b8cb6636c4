"""Positions of one joint that are logged as a multiple: a wrong gear or counts for each turn, a slide in
another unit.

The model file's torque at the true positions fits the commands of all joints better than that at the logged
ones. Each command has a factor of the file's torque of its own, so that no unit of commands matters. A slide
or an axis about the vertical is told by what couples it to other joints alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from etude.logs.checks.finding_texts import accepted
from etude.logs.evidence.file_fit import (
    AHEAD,
    OTHER,
    RIGHT,
    SCREEN,
    FileFit,
    TiedFit,
    score_of_masses,
)
from etude.types import Array, Channel, Finding

GEAR = "gear"
STEP = 1.25  # between factors that are tried: the likelihood of one is about as wide
TRIED = tuple(STEP**k for k in range(-5, 6) if k)
SCREEN_ROWS = 60  # at which all are tried


class PositionFactor(NamedTuple):
    """A joint whose positions are logged as a multiple, and log odds."""

    joint: int
    factor: float
    odds: float


class Gear(NamedTuple):
    """Multiples that explain a log, the likeliest first: nothing tells which of them it is."""

    each: tuple[PositionFactor, ...]
    odds: float

    def finding(self, path: Channel) -> Finding:
        """The question, with what to correct."""
        facts = [f"the positions of {path.parts[j]} are {factor:.2g} times" for j, factor, _ in self.each]
        names = " or ".join(path.parts[one.joint] for one in self.each)
        by = " or ".join(f'"{1.0 / one.factor:.3g} * HEADER"' for one in self.each)
        return Finding(
            GEAR,
            "yellow",
            f"If the model file's masses are right, {', or '.join(facts)} the true ones "
            f"(log odds {self.odds:.0f}).",
            f"Check gear, unit and counts for each turn of {names}, and correct the column in [log.columns] "
            f"of campaign.toml ({by}); {accepted(GEAR)}.",
            flag=GEAR,
        )


def gear_of(fit: FileFit) -> Gear | None:
    """The joint whose positions are most likely a multiple, and those that explain nearly as much; None where
    masses that are off, a load at the last link or a tilted base do.
    """
    screened = _screened(fit)
    most = max(one.odds for one in screened)
    if most < 0.5 * SCREEN:  # between two factors that are tried it may be twice as much
        return None
    each = [_refined(fit, one) for one in screened if one.odds > 0.5 * most]
    each = sorted((one for one in each if one.odds >= SCREEN), key=lambda one: -one.odds)
    if not each or each[0].odds < AHEAD + _gain_of_masses(fit):
        return None
    as_is = TiedFit.of(fit)
    near = [one for one in each if one.odds > each[0].odds - AHEAD]
    likely = tuple(one for one in near if _tied_odds(fit, as_is, one) >= AHEAD)
    return Gear(likely, likely[0].odds) if likely else None


def _refined(fit: FileFit, near: PositionFactor) -> PositionFactor:
    """The likeliest factor of the same joint near one that was tried."""
    from scipy.optimize import minimize_scalar

    before = fit.score(fit.moved(np.ones(fit.rows.q.shape[1])))

    def cost(logarithm: float) -> float:
        return before - fit.score(fit.moved(_of_true(fit, near.joint, float(np.exp(logarithm)))))

    bounds = sorted(np.log([near.factor / STEP, near.factor * STEP]))
    optimum = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.01})
    return PositionFactor(near.joint, float(np.exp(optimum.x)), -float(optimum.fun))


def _gain_of_masses(fit: FileFit) -> float:
    assert fit.rows.torque is not None
    return score_of_masses(fit) - fit.score(fit.rows.torque)


def _of_true(fit: FileFit, joint: int, factor: float) -> Array:
    """(k,) true positions as multiples of those logged."""
    return np.where(np.arange(fit.rows.q.shape[1]) == joint, 1.0 / factor, 1.0)


def _screened(fit: FileFit) -> list[PositionFactor]:
    """The likeliest factor of TRIED of each moving joint, by some of the rows; log odds for all of them."""
    n, k = fit.rows.q.shape
    every = -(-n // SCREEN_ROWS)
    few, joints = fit.take(np.arange(0, n, every)), np.flatnonzero(fit.rows.moving).tolist()
    tried = np.array([np.ones(k), *(_of_true(fit, j, factor) for j in joints for factor in TRIED)])
    scores = np.array([few.score(torque) for torque in few.moved_each(tried)])
    gains = every * (scores[1:].reshape(len(joints), -1) - scores[0])
    best = zip(joints, gains.argmax(axis=1).tolist(), gains.max(axis=1).tolist(), strict=True)
    return [PositionFactor(j, TRIED[i], gain) for j, i, gain in best]


def _tied_odds(fit: FileFit, as_is: TiedFit, gear: PositionFactor) -> float:
    """Log odds against the logged positions, with masses, loads and gravity as far off as they may be."""
    rows, trued = fit.rows, _of_true(fit, gear.joint, gear.factor)
    q, qd, qdd = rows.q * trued, rows.qd * trued, rows.qdd * trued
    right = TiedFit.of(replace(fit, rows=replace(rows, q=q, qd=qd, qdd=qdd, torque=fit.moved(trued))))
    one = np.ones((1, len(as_is.products)))
    others = max(float(as_is.scores(one, deviations)[0]) for deviations in (RIGHT, OTHER))
    return float(right.scores(one, RIGHT)[0]) - others
