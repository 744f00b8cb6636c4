"""Hypotheses on a model file whose masses are right: a joint's zero offset, joints that turn the other way, a
wrong clock, another unit of some commands, and commands that were computed from the file.

Every hypothesis is one linear fit of all joints over all logs, with an inertia, friction, an offset and a
factor of the file's torque for each joint. Joints are weighed by what is left of them. Centres of mass that
are off look like a zero in one joint, and not alike in all: a zero has to explain more than they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from etude.abilities import SupportsVariations
from etude.logs.checks.command_units import unit_finding
from etude.logs.checks.filtered_motion import measured_rates, states_of
from etude.logs.checks.finding_texts import accepted, named
from etude.logs.checks.velocities import clock_finding
from etude.logs.evidence.file_fit import (
    AHEAD,
    EARTH,
    MASSES_OFF,
    OTHER,
    RIGHT,
    SCREEN,
    FileFit,
    TiedFit,
    file_fit,
    fit_of,
    score_of_masses,
)
from etude.logs.evidence.rows import AS_LOGGED, FilteredRows
from etude.logs.evidence.wrong_positions import wrong_positions
from etude.protocols import Mean
from etude.types import Array, Channel, Finding, Index, Log

TRIED = tuple(0.02 * 1.6**k for k in range(11))  # rad or m: offsets that are looked at, both ways
STEP = 0.01  # rad or m: of differences
REPORTED_OFFSET = 0.05  # rad or m: an offset from which the log is questioned
ZERO, REVERSED = "zero", "reversed"
COMPUTED, MOST_JOINTS = 2e-3, 0.6  # of a command's variance that is left; part of the joints


class Zero(NamedTuple):
    """A joint's encoder that reads too much: rad or m with their deviation, and log odds."""

    joint: int
    offset: float
    deviation: float
    odds: float

    def finding(self, path: Channel) -> Finding:
        """The question, or a sentence on a small one."""
        turns = path.units[self.joint] == "rad"
        size, spread = ((np.degrees(x) if turns else 1e3 * x) for x in (self.offset, self.deviation))
        fact = (
            f"If the model file's masses are right, the position of {path.parts[self.joint]} reads "
            f"{abs(size):.2g} +- {spread:.1g} {'degrees' if turns else 'mm'} too "
            f"{'much' if size > 0.0 else 'little'} (log odds {self.odds:.0f})."
        )
        if abs(self.offset) < REPORTED_OFFSET:
            return Finding(ZERO, "green", fact)
        step = "Correct the joint's zero, on the robot or in the model file, and record again; "
        return Finding(ZERO, "yellow", fact, f"{step}{accepted(ZERO)}.", flag=ZERO)


def file_findings(logs: Sequence[Log], path: Channel, body: Mean | None, limit: Array) -> tuple[Finding, ...]:
    """Findings of the model file on all logs together.

    Args:
        logs: with positions `path` and forces as commands on them; all but the last are accepted already.
        body: the model file's prediction of the commands; None without a file.
        limit: (k,) largest commands, for percentages.
    """
    fit = file_fit(logs, path, body)
    if fit is None:
        return ()
    if is_computed(fit):
        fact = "The commands agree with the model file to 0.2 %: they seem computed, not measured."
        return (Finding("computed", "yellow", fact, "Log the measured commands, if the robot has them."),)
    # right logs before it would outweigh it
    rows = fit.rows.take(np.flatnonzero(fit.rows.log == len(logs) - 1))
    new = fit_of(rows, fit.path, fit.body) if len(rows.t) else None
    turned = None if new is None else reversed_joints(new)
    if turned is not None:
        return turned.findings(path)
    tried = (zero_of(fit), None if new is None else wrong_positions(new))  # whatever the units
    found = [one for one in tried if one is not None]
    if found:  # near one pose either looks like the other
        least = max(one.odds for one in found) - AHEAD
        return tuple(one.finding(path) for one in found if one.odds > least)
    scale = None if new is None else scale_of(new)
    return () if scale is None else (_scale_finding(scale, path, limit),)


class Reversed(NamedTuple):
    """Joints that are inverted against the file: positions and commands, or positions alone; log odds."""

    both: tuple[int, ...]
    positions: tuple[int, ...]
    odds: float

    def findings(self, path: Channel) -> tuple[Finding, ...]:
        """One on each kind, with what to correct."""
        both, wrong = (named(path.parts, np.isin(np.arange(len(path.parts)), one)) for one in self[:2])
        verb = "turns" if len(self.both) == 1 else "turn"
        facts = (
            f"{both} {verb} in the opposite direction to the file: positions and commands are both inverted",
            f"the positions of {wrong} have the wrong sign, not their commands",
        )
        steps = (
            "Invert the joint's axis in the model file, or both columns in [log.columns] of campaign.toml "
            '("-1 * HEADER")',
            'Correct the columns of the positions in [log.columns] of campaign.toml ("-1 * HEADER"), or the '
            "signs of the encoders",
        )
        return tuple(
            Finding(
                REVERSED,
                "yellow",
                f"If the model file's masses are right, {fact} (log odds {self.odds:.0f}).",
                f"{step}; {accepted(REVERSED)}.",
                flag=REVERSED,
            )
            for joints, fact, step in zip(self[:2], facts, steps, strict=True)
            if joints
        )


def _scale_finding(scale: JointScale, path: Channel, limit: Array) -> Finding:
    wrong = np.arange(len(path.parts)) == scale.joint
    why = f", whose masses may be {100.0 * MASSES_OFF:.0f} % off (log odds {scale.odds:.0f})"
    return unit_finding(path.parts, path.units, np.where(wrong, scale.factor, 1.0), wrong, limit, why)


def zero_of(fit: FileFit) -> Zero | None:
    """The joint with the likeliest zero offset; None where wrong centres of mass explain as much."""
    from scipy.optimize import minimize_scalar

    k = fit.rows.q.shape[1]
    assert fit.rows.torque is not None
    before = fit.score(fit.rows.torque)
    gains = [fit.score_with(_slope(fit, i)[:, :, None]) - before for i in range(k)]
    i = int(np.argmax(gains))
    if gains[i] < SCREEN:
        return None

    def cost(offset: float) -> float:
        return before - fit.score(fit.torque(np.where(np.arange(k) == i, offset, 0.0)))

    near = min((s * d for d in TRIED for s in (1, -1)), key=cost)
    optimum = minimize_scalar(cost, bounds=sorted((near / 1.6, near * 1.6)), method="bounded")
    offset, odds = float(optimum.x), -float(optimum.fun)
    if odds < SCREEN or odds < AHEAD + score_of_masses(fit) - before:
        return None
    bend = (cost(offset + STEP) - 2.0 * cost(offset) + cost(offset - STEP)) / STEP**2
    return Zero(i, offset, float(1.0 / np.sqrt(bend)) if bend > 0.0 else np.inf, odds)


def reversed_joints(fit: FileFit) -> Reversed | None:
    """Joints whose positions are inverted against the file, with their commands or alone; None if none are.

    Such a joint alone looks right or like an inverted command; only its coupling to the others has the other
    sign. A greedy search turns one joint after the other, as long as wrong centres of mass do not explain as
    much.
    """
    k = fit.rows.q.shape[1]
    assert fit.rows.torque is not None
    signs, first = np.ones(k), fit.score(fit.turned(np.ones(k)))
    best, odds = first, 0.0
    for _ in range(k - 1):
        unturned = [i for i in fit.joint_indices.tolist() if signs[i] > 0.0]
        trials = {i: np.where(np.arange(k) == i, -signs, signs) for i in unturned}
        scores = {i: fit.score(fit.turned(trial)) for i, trial in trials.items()}
        i = max(scores, key=lambda i: scores[i], default=-1)
        if i < 0 or scores[i] - best < AHEAD or not fit.explains(trials[i]):
            break
        signs, best, odds = trials[i], scores[i], scores[i] - first
    if odds < SCREEN or odds < AHEAD + score_of_masses(fit) - fit.score(fit.rows.torque):
        return None
    turned = np.flatnonzero(signs < 0.0)
    follow = fit.follow(signs)[turned]
    return Reversed(tuple(turned[follow].tolist()), tuple(turned[~follow].tolist()), odds)


FACTORS = np.geomspace(0.02, 50.0, 41)  # of a command's unit: per cent of 2 to 5,000 N m
NEARER = np.geomspace(0.82, 1.22, 17)  # of the best of them
UNRELATED = 1e-3  # factor of a command that does not follow the file


class JointScale(NamedTuple):
    """A joint's commands as a multiple of the file's, and log odds."""

    joint: int
    factor: float
    odds: float


def scale_of(fit: FileFit) -> JointScale | None:
    """The joint whose commands have another unit; None where masses that are off, a load at the last link or
    a tilted base explain as much. Its commands have to follow the file: without any of it they are no matter
    of units.
    """
    tied = TiedFit.of(fit)
    as_is, other = (float(tied.scores(np.ones((1, len(tied.products))), x)[0]) for x in (RIGHT, OTHER))
    scores = np.array([tied.with_factors(j, FACTORS) for j in range(len(tied.products))])
    j, best = np.unravel_index(int(scores.argmax()), scores.shape)
    near = FACTORS[best] * NEARER
    refined = tied.with_factors(int(j), near)
    unrelated = float(tied.with_factors(int(j), np.array([UNRELATED]))[0])
    if refined.max() - max(as_is, other, unrelated) < UNIT_ODDS:
        return None
    joint, factor = int(fit.joint_indices[j]), float(near[refined.argmax()])
    if refined.max() - float(tied.with_factors(int(j), np.array([factor]), OTHER)[0]) < UNIT_AHEAD:
        return None
    return JointScale(joint, factor, float(refined.max()) - as_is)


# log odds of a unit to any masses at the same factor: without gravity they fit friction; right logs had 3
UNIT_AHEAD = 5.0
UNIT_ODDS = 25.0  # log odds of a unit: right logs had 20, of a wrist with more friction than torque
CLOCKS = (2.0, 0.5)  # that times are too long: a rate that was doubled, or halved
CLOCK_ODDS = 25.0  # log odds from which one is told: right logs of slow arms had 18


def clock_by_file(log: Log, path: Channel, body: Mean | None) -> Finding | None:
    """A wrong clock in a log without velocities: the inertial part of the commands is the square of the
    clock's factor times that of the model file.
    """
    fit = None if measured_rates(log, path) else file_fit([log], path, body)
    if fit is None or fit.rows.static is None or fit.rows.torque is None:
        return None
    weight, inertial = fit.rows.static, fit.rows.torque - fit.rows.static
    odds = {scale: fit.score(weight + scale**2 * inertial) - fit.score(weight + inertial) for scale in CLOCKS}
    best = max(odds, key=lambda scale: odds[scale])
    if odds[best] < CLOCK_ODDS:
        return None
    fact = f"besides gravity, the commands contain about {best**2:g} times the torque of the model file"
    finding = clock_finding(best, f"{fact}, over all joints (log odds {odds[best]:.0f})")
    return replace(finding, light="yellow")


HELD = 0.5  # part of the earth's gravity that commands hold in another direction
LEFT = 0.5  # of what the file's gravity leaves


def weight_elsewhere(logs: Sequence[Log], path: Channel, body: Mean | None) -> bool:
    """Whether commands contain a weight in another direction than the file's: the base is tilted, and no
    gravity compensation was subtracted.
    """
    fit = file_fit(logs, path, body)
    if fit is None or fit.rows.static is None or fit.rows.torque is None:
        return False
    assert isinstance(fit.body, SupportsVariations)
    pulls, inertial = fit.body.pulls(fit.states), fit.rows.torque - fit.rows.static
    left, gravity = fit.shared(pulls, inertial)
    before, _ = fit.shared((pulls @ fit.body.gravity)[:, :, None], inertial)
    return bool(np.linalg.norm(gravity) > HELD * EARTH and left.sum() < LEFT * before.sum())


def _slope(fit: FileFit, i: int) -> Array:
    """(n, k) change of the commands for each rad of offset of position i."""
    step = STEP * (np.arange(fit.rows.q.shape[1]) == i)
    return (fit.torque(step) - fit.torque(-step)) / (2.0 * STEP)


def positions_odds(
    rows: FilteredRows, joints: Index, path: Channel, body: Mean, columns: Index, signs: Array
) -> float:
    """Log odds that the positions, not the commands, have other columns (k,) and other signs (k,). One joint
    alone cannot separate the two; the weights on other joints do, and its own weight.
    """
    back = np.argsort(columns)
    moved = rows.with_joints(back, signs[back])
    ordered = replace(rows, command=rows.command[:, columns] * signs[:, None])
    scores = []
    for tried in (moved, ordered):
        torque = body.predict(states_of(rows.t, path, tried.q, tried.qd, tried.qdd))
        fit = FileFit(replace(tried, torque=torque), joints, path, body)
        scores.append(fit.score(torque) + fit.score_of_means(torque))
    return scores[0] - scores[1]


def is_computed(fit: FileFit) -> bool:
    """Whether commands follow one factor of the file's torque more closely than any measured ones."""
    assert fit.rows.torque is not None
    y, F = fit.rows.command[:, fit.joint_indices, AS_LOGGED], fit.rows.torque[:, fit.joint_indices]
    square = (F * F).sum(axis=0)
    factor = (y * F).sum(axis=0) / np.maximum(square, np.finfo(float).tiny)
    left = ((y - factor * F) ** 2).mean(axis=0) / (y**2).mean(axis=0)
    return bool((left < COMPUTED).mean() > MOST_JOINTS)
