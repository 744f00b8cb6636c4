"""Hypotheses on a model file whose masses are right: a joint's zero offset, joints that turn the other way, a
wrong clock, another unit of some commands, and commands that were computed from the file.

Every hypothesis is one linear fit of all joints over all logs, with an inertia, friction, an offset and a
factor of the file's torque for each joint. Joints are weighed by what is left of them. Centres of mass that
are off look like a zero in one joint, and not alike in all: a zero has to explain more than they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from etude.abilities import SupportsVariations
from etude.logs.checks.command_units import unit_finding
from etude.logs.checks.filtered_motion import measured_rates, states_of
from etude.logs.checks.finding_texts import accepted, named
from etude.logs.checks.velocities import clock_finding
from etude.logs.evidence.changed_parameters import unit_masses
from etude.logs.evidence.rows import APART, AS_LOGGED, FLOOR, FilteredRows, rows_of
from etude.protocols import Mean
from etude.types import Array, Channel, Finding, Index, Log, Mask

ROUNDS = 8  # of weighing joints by what is left of them
SCREEN = 10.0  # log odds by a straight line from which an offset is looked for
AHEAD = 15.0  # log odds of an offset to centres of mass that are off
TRIED = tuple(0.02 * 1.6**k for k in range(11))  # rad or m: offsets that are looked at, both ways
STEP = 0.01  # rad or m: of differences
REPORTED_OFFSET = 0.05  # rad or m: an offset from which the log is questioned
ZERO, REVERSED = "zero", "reversed"
PUSHES = 0.5  # correlation with the negative velocity; Coulomb friction alone has 0.8 and more
SAME, SMALLEST = 1e-6, 1e-300  # of a column: what another one leaves of it; of its length
COMPUTED, MOST_JOINTS = 2e-3, 0.6  # of a command's variance that is left; part of the joints


class Zero(NamedTuple):
    """A joint's encoder that reads too much: rad or m with their deviation, and log odds."""

    joint: int
    offset: float
    deviation: float
    odds: float


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
    zero = zero_of(fit)  # whatever the units
    if zero is not None:
        return (_zero_finding(zero, path),)
    scale = None if new is None else scale_of(new)
    return () if scale is None else (_scale_finding(scale, path, limit),)


def _zero_finding(zero: Zero, path: Channel) -> Finding:
    turns = path.units[zero.joint] == "rad"
    size, spread = ((np.degrees(x) if turns else 1e3 * x) for x in (zero.offset, zero.deviation))
    fact = (
        f"If the model file's masses are right, the position of {path.parts[zero.joint]} reads "
        f"{abs(size):.2g} +- {spread:.1g} {'degrees' if turns else 'mm'} too "
        f"{'much' if size > 0.0 else 'little'} (log odds {zero.odds:.0f})."
    )
    if abs(zero.offset) < REPORTED_OFFSET:
        return Finding(ZERO, "green", fact)
    step = f"Correct the joint's zero, on the robot or in the model file, and record again; {accepted(ZERO)}."
    return Finding(ZERO, "yellow", fact, step, flag=ZERO)


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


def file_fit(logs: Sequence[Log], path: Channel, body: Mean | None) -> FileFit | None:
    """The fit over all logs; None without a model file, or where fewer than two joints go far enough."""
    return None if body is None else fit_of(rows_of(logs, path, body), path, body)


def fit_of(rows: FilteredRows | None, path: Channel, body: Mean) -> FileFit | None:
    """The same of rows that hold the file's torque."""
    if rows is None or not isinstance(body, SupportsVariations) or rows.moving.sum() < 2:
        return None
    joints = np.flatnonzero(rows.moving & (rows.command[..., AS_LOGGED].std(axis=0) > 0.0))
    return FileFit(rows, joints, path, body) if len(joints) > 1 else None


@dataclass(frozen=True, eq=False)
class FileFit:
    """Rows, the joints whose commands count, and the model file.

    Attributes:
        joint_indices: (m,) of those joints.
    """

    rows: FilteredRows
    joint_indices: Index
    path: Channel
    body: Mean

    @property
    def states(self) -> Log:
        return self._states(self.rows.q)

    def _states(self, q: Array) -> Log:
        return states_of(self.rows.t, self.path, q, self.rows.qd, self.rows.qdd)

    def torque(self, offset: Array) -> Array:
        """(n, k) the file's torque if each position were (k,) less."""
        rows = self.rows
        assert rows.torque is not None
        return np.asarray(rows.torque + self.body.predict(self._states(rows.q - offset)) - self._as_logged)

    @cached_property
    def _as_logged(self) -> Array:
        return self.body.predict(self.states)

    def turned(self, signs: Array) -> Array:
        """(n, k) the file's torque if joints with signs (k,) of -1 turn the other way."""
        rows = self.rows
        log = states_of(rows.t, self.path, rows.q * signs, rows.qd * signs, rows.qdd * signs)
        return np.asarray(self.body.predict(log) * signs)

    def follow(self, signs: Array) -> Mask:
        """(k,) whether each command follows the file's torque if joints turn the other way."""
        command, torque = self.rows.command[..., AS_LOGGED], self.turned(signs)
        return np.asarray(((command - command.mean(axis=0)) * torque).sum(axis=0) > 0.0)

    def explains(self, signs: Array) -> bool:
        """Whether joints with signs of -1 turn the other way, or have inverted positions alone: what their
        commands hold beside the torque then pushes along the velocity, as friction never does.
        """
        follow, torque = self.follow(signs), self.turned(signs)
        return all(follow[j] or self._pushes(j, torque[:, j]) for j in np.flatnonzero(signs < 0.0).tolist())

    def _pushes(self, j: int, torque: Array) -> bool:
        rows = self.rows
        X = np.column_stack([np.ones(len(rows.t)), torque, rows.qdd[:, j]])
        y = np.column_stack([rows.command[:, j, AS_LOGGED], rows.qd[:, j]])
        command, qd = (y - X @ np.linalg.lstsq(X, y, rcond=None)[0]).T
        return bool(command @ qd < -PUSHES * np.linalg.norm(command) * np.linalg.norm(qd))

    def left(self, torque: Array) -> Array:
        """(m,) part of each command's variance that a torque (n, k), friction and a constant leave."""
        return np.array([self._left_of(j, torque[:, j]) for j in self.joint_indices.tolist()])

    def _left_of(self, j: int, torque: Array) -> float:
        command, F = self.rows.command[:, j, AS_LOGGED], self._direction(j, torque)
        y = self.residual(j, command)
        return float(((y - F * (F @ y)) ** 2).mean() / command.var())

    @cached_property
    def _bases(self) -> dict[int, Array]:
        """By joint, an orthonormal basis (n, p) of what only its command has: a constant, inertia, friction.

        All forms of friction are included: presliding and static friction look like a weight.
        """
        rows, bases = self.rows, {}
        for j in self.joint_indices.tolist():
            friction = [rows.friction[:, j], rows.drop[:, j], rows.gradual[:, j], rows.stands[j]]
            X = np.column_stack([np.ones(len(rows.t)), rows.qdd[:, j], rows.qd[:, j], *friction])
            U, s, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), SMALLEST), full_matrices=False)
            bases[j] = U[:, s > SAME * s[0]]
        return bases

    def residual(self, j: int, values: Array) -> Array:
        """Residual of values (n, ...) after the regression on the basis of joint j."""
        return np.asarray(values - self._bases[j] @ (self._bases[j].T @ values))

    def _direction(self, j: int, torque: Array) -> Array:
        """(n,) unit vector of the residual of a torque (n,) at joint j; 0 without one."""
        left = self.residual(j, torque)
        size = float(np.linalg.norm(left))
        return left / size if size > SAME * float(np.linalg.norm(torque)) else np.zeros_like(left)

    def score(self, torque: Array) -> float:
        """Log likelihood of a torque (n, k) of the file, of independent rows."""
        return self._likelihood(self.left(torque))

    def _likelihood(self, left: Array) -> float:
        # each column of a basis takes a row; stands have many
        free = len(self.rows.t) - np.array([self._bases[j].shape[1] for j in self.joint_indices.tolist()])
        return float(-0.5 / APART * (free @ np.log(left + FLOOR)))

    def score_of_means(self, torque: Array) -> float:
        """Log likelihood of the commands' means, which `score` leaves out: the weight of a slide is constant.
        They deviate by wrong masses, and by offsets up to the size of what varies.
        """
        command = self.rows.command[:, self.joint_indices, AS_LOGGED]
        mean = torque[:, self.joint_indices].mean(axis=0)
        variance = (MASSES_OFF * mean) ** 2 + command.var(axis=0)
        return float(-0.5 * ((command.mean(axis=0) - mean) ** 2 / variance + np.log(variance)).sum())

    def score_with(self, columns: Array) -> float:
        """The same with columns (n, k, p) beside the file's torque, whose weights all joints share."""
        assert self.rows.torque is not None
        return self._likelihood(self.shared(columns, self.rows.torque)[0])

    def shared(self, columns: Array, torque: Array) -> tuple[Array, Array]:
        """Residual variance of each command (m,) and weights (p,) of columns (n, k, p) common to all joints,
        beside a torque (n, k) and each joint's own basis.
        """
        parts = [self._residuals(j, torque[:, j], columns[:, j]) for j in self.joint_indices.tolist()]
        left = np.array([float((y**2).mean()) for y, _ in parts])
        for _ in range(ROUNDS):
            weights = 1.0 / np.sqrt(left + FLOOR)
            X = np.concatenate([w * C for w, (_, C) in zip(weights, parts, strict=True)])
            y = np.concatenate([w * u for w, (u, _) in zip(weights, parts, strict=True)])
            coefficients = np.linalg.lstsq(X, y, rcond=None)[0]
            left = np.array([float(((u - C @ coefficients) ** 2).mean()) for u, C in parts])
        return left, np.asarray(coefficients)

    def _residuals(self, j: int, torque: Array, columns: Array) -> tuple[Array, Array]:
        """Residuals of the command and the columns at joint j, in standard deviations of the command."""
        command = self.rows.command[:, j, AS_LOGGED]
        y, X, F = self.residual(j, command), self.residual(j, columns), self._direction(j, torque)
        return (y - F * (F @ y)) / command.std(), (X - np.outer(F, F @ X)) / command.std()


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
    if odds < SCREEN or odds < AHEAD + _masses(fit) - before:
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
    if odds < SCREEN or odds < AHEAD + _masses(fit) - fit.score(fit.rows.torque):
        return None
    turned = np.flatnonzero(signs < 0.0)
    follow = fit.follow(signs)[turned]
    return Reversed(tuple(turned[follow].tolist()), tuple(turned[~follow].tolist()), odds)


EARTH = 9.81  # m/s^2
MASSES_OFF = 0.3  # part by which masses of links may differ from a right file
RIGHT, OTHER = (MASSES_OFF, 0.05, 1.0), (3.0, 1.0, 1.0)
"""Deviations of what the file says: of links, in parts; of gravity, in its own; of a load, in the file's
torque. A right file, and one of another robot or mounting."""
FACTORS = np.geomspace(0.02, 50.0, 41)  # of a command's unit: per cent of 2 to 5,000 N m
NEARER = np.geomspace(0.82, 1.22, 17)  # of the best of them
UNRELATED = 1e-3  # factor of a command that does not follow the file


class JointScale(NamedTuple):
    """A joint's commands as a multiple of the file's, and log odds."""

    joint: int
    factor: float
    odds: float


@dataclass(frozen=True, eq=False)
class TiedFit:
    """The commands of m joints with the file's torque as it is: no joint has a factor of its own.

    Attributes:
        products: (m, 2 + p, 2 + p) mean products of a joint's residuals: its command, the file's torque, and
            what p changes add to it: the whole of each link, gravity along each axis, a load's mass and
            moments.
        n: independent rows.
    """

    products: Array
    n: float

    @classmethod
    def of(cls, fit: FileFit) -> TiedFit:
        assert isinstance(fit.body, SupportsVariations)
        assert fit.rows.torque is not None
        columns = fit.body.links(fit.states)
        own = np.einsum("njli,jli->njl", columns, fit.body.link_parameters)
        load = columns[:, :, -1, :4]
        load = load * unit_masses(fit.rows.torque, load)
        changes = np.concatenate([own, EARTH * fit.body.pulls(fit.states), load], axis=2)
        products = []
        for j in fit.joint_indices.tolist():
            command = fit.rows.command[:, j, AS_LOGGED]
            parts = np.column_stack([command, fit.rows.torque[:, j], changes[:, j]])
            residuals = fit.residual(j, parts) / command.std()
            products.append(residuals.T @ residuals / len(residuals))
        return cls(np.array(products), len(fit.rows.t) / APART)

    def scores(self, factors: Array, deviations: tuple[float, float, float]) -> Array:
        """(N,) log evidence of factors (N, m) of the commands. The changes are integrated out (Laplace) with
        `deviations`, RIGHT or OTHER; joints are weighed by what is left of them.
        """
        p, G = self.products.shape[1] - 2, self.products
        deviation = np.repeat(deviations, (p - 7, 3, 4))
        change = np.zeros((len(factors), p))
        for _ in range(ROUNDS):
            beside = np.broadcast_to(-change[:, None], (*factors.shape, p))
            a = np.concatenate([1.0 / factors[..., None], -np.ones((*factors.shape, 1)), beside], axis=2)
            left = np.maximum(np.einsum("Nmc,mcd,Nmd->Nm", a, G, a, optimize=True), 0.0) * factors**2 + FLOOR
            weight = self.n * factors**2 / left
            A = np.einsum("Nm,mpq->Npq", weight, G[:, 2:, 2:]) + np.diag(deviation**-2)
            y = G[:, 2:, 0] / factors[..., None] - G[:, 2:, 1]
            change = np.linalg.solve(A, np.einsum("Nm,Nmp->Np", weight, y)[..., None])[..., 0]
        price = ((change / deviation) ** 2).sum(axis=1) + np.linalg.slogdet(A)[1]
        return np.asarray(-0.5 * (self.n * np.log(left).sum(axis=1) + price) - np.log(deviation).sum())

    def with_factors(self, joint: int, tried: Array) -> Array:
        """(N,) the same of factors of one joint's commands, of a file whose masses are right."""
        factors = np.ones((len(tried), len(self.products)))
        factors[:, joint] = tried
        return self.scores(factors, RIGHT)


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
    return JointScale(joint, factor, float(refined.max()) - as_is)


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


def _masses(fit: FileFit) -> float:
    """The score with the first moments of one link free, or of all, less half the logarithm of the
    independent rows for each of them (Schwarz 1978).
    """
    assert isinstance(fit.body, SupportsVariations)
    moments = fit.body.links(fit.states)[:, :, :, 1:4]
    each = [moments[:, :, b] for b in range(moments.shape[2])]
    price = 0.5 * float(np.log(len(fit.rows.t) * len(fit.joint_indices) / APART))
    tried = [*each, moments.reshape(*moments.shape[:2], -1)]
    return max(fit.score_with(columns) - price * float(columns.shape[2]) for columns in tried)


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
