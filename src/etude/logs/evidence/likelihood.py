"""The evidence that a command drives a joint: with its sign, inverted, reversed in time, or in no such way.

    u = I qdd + B qd + C friction + G torque + f(q, qd, qdd) + n

I, B, C and G are not negative; they have one normal prior, and its scale is integrated out (Jeffreys), so no
unit matters. f is a Gaussian process: what a chain of bodies may do. What is a function of the place is
then no friction. n is noise with memory and noise of each row. Process and noise are summed over a grid.
Where a joint stands, static friction holds any command: a free function of time is added there.

With Z the evidence without constraint, that of positive coefficients is Z 2^k Pr(beta >= 0 | data), that of
an inverted command Z 2^k Pr(beta <= 0 | data): one fit gives both. One Cholesky factor of a point of the grid
serves all joints and columns.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import erfcx, log_ndtr

from etude._runtime.scipy_parts import dpotrf, dtrsm
from etude.logs.evidence.rows import AS_LOGGED, DISTANCES, WIDTHS, FilteredRows
from etude.types import Array, Index, Mask

log_sum = np.logaddexp.reduce  # over the first axis, or another one


class Point(NamedTuple):
    """Of the grid. Sizes are in deviations of a regressor.

    Attributes:
        length: rad, of springs and other functions of the place; 0: a chain's weights.
        size: of the process. speeds: its part that grows with accelerations and squared velocities.
        drift: of the noise with memory. memory: s. rough: of the noise of each row.
        ripple: rad or m, over which a sum of functions of one joint each turns; 0: there is none.
    """

    length: float
    size: float
    drift: float
    memory: float
    rough: float
    speeds: float
    ripple: float = 0.0


LENGTHS, SPEEDS = (0.7, 2.0, 0.0), (0.1, 2.0)  # of `Point`
CLASSES = tuple(itertools.product(LENGTHS, SPEEDS))
"""Of processes: the evidence is that of the least favourable class."""
SIZES, ROUGH = (0.5, 2.0, 10.0), 0.02  # of `Point`
DRIFTS = ((0.05, 0.3), (0.2, 0.3), (0.2, 2.0))  # and memories
RIPPLES, RIPPLE = (0.05, 0.15), 2.0  # of gears, motors and what they rub on; and its size
GRID = tuple(
    Point(length, size, *drift, ROUGH, speeds)
    for length, size, drift, speeds in itertools.product(LENGTHS, SIZES, DRIFTS, SPEEDS)
) + tuple(
    Point(length, size, *drift, ROUGH, SPEEDS[0], ripple)
    for length, size, drift, ripple in itertools.product(LENGTHS, SIZES, (DRIFTS[0], DRIFTS[2]), RIPPLES)
)
NEAR_FILE = tuple(
    Point(0.0, size, *noise, 0.1)
    for size, noise in itertools.product(
        (0.003, 0.03, 0.15), ((0.05, 0.3, 0.02), (0.2, 2.0, 0.05), (0.005, 0.3, 0.002), (5e-4, 0.3, 5e-4))
    )
)
"""With a model file that is right to 0.3, 3 or 15 %."""
CLOCK = tuple(point for point in GRID if not point.ripple and point.drift != DRIFTS[1][0])
"""Enough to compare delays."""
FEW = tuple(
    point._replace(rough=0.1)
    for point in GRID
    if point.size == SIZES[2] and point.speeds == SPEEDS[0] and point.drift == DRIFTS[2][0]
)
"""Enough to compare models of some rows with one model of all; a right log is no odder than a tenth."""
LEVEL = 4.0  # variance of a command's mean, at least
SWAY = 0.7  # of the chain's kernel: how much of a weight turns with one joint
SMALL_TRAVEL = 0.3  # rad: a joint with less travel is no angle to the springs' kernel
INERTIA, VISCOUS, COULOMB, DROP, TORQUE = range(5)  # regressors, in the order of their columns
GRADUAL = tuple(range(TORQUE + 1, TORQUE + 1 + len(DISTANCES) + len(WIDTHS)))
TERMS = ((INERTIA, VISCOUS, COULOMB), (INERTIA,), (INERTIA, VISCOUS, COULOMB, DROP))  # friction may be none
FRICTION = (VISCOUS, COULOMB, DROP, *GRADUAL)
TURNS = GRADUAL[:3], GRADUAL[2:5], GRADUAL[4:7], GRADUAL[7:]
CLOCK_TERMS = TERMS + tuple((INERTIA, VISCOUS, *one, DROP) for one in TURNS)
"""Where delays are compared: friction that turns round over a distance looks late. Neighbours with positive
coefficients are any distance between them (Iwan 1966); in a slow turn 1.4 times a distance is 40 ms."""
NEITHER = np.log(0.05)  # prior of a command that no sign explains
INVERTED = np.log(0.03)  # prior of an inverted one, where orders and delays are compared
BEST = 2  # points of a class whose orthants are computed
FAR = 40.0  # nats below the best point: excluded
REACH = 25.0  # nats below the best class within which a class counts


@dataclass(frozen=True, eq=False)
class ColumnEvidence:
    """Log evidences (p, c) of p pairs of a joint and a column, in c classes of processes; -inf: excluded.

    Attributes:
        right, inverted: of non-negative coefficients, and of an inverted command.
        reversed, opposed: of rows that run backwards, and of an inverted command in such rows.
        free: of any coefficients.
    """

    right: Array
    inverted: Array
    reversed: Array
    opposed: Array
    free: Array

    def whole(self) -> Array:
        """(p,) of the column whatever its sign."""
        parts = [log_sum(one, axis=1) for one in (self.right, self.inverted, self.free)]
        return np.asarray(log_sum([parts[0], parts[1], parts[2] + NEITHER], axis=0))

    def by_class(self) -> Array:
        """(p, c) of the column whatever its sign, in each class; inverted ones have a prior of INVERTED."""
        parts = [self.right, self.inverted + INVERTED, self.free + NEITHER]
        return np.asarray(log_sum(parts, axis=0))

    def strange(self) -> Mask:
        """(p,) where neither sign explains the column, which then counts for neither."""
        best = np.maximum(log_sum(self.right, axis=1), log_sum(self.inverted, axis=1))
        return np.asarray(NEITHER + log_sum(self.free, axis=1) > best)

    def signs(self) -> tuple[Array, Array]:
        """(p,) each: evidence of the right and the inverted sign, by the least favourable class."""
        strange = self.strange()
        best = np.maximum(log_sum(self.right, axis=1), log_sum(self.inverted, axis=1))
        level = np.where(strange, NEITHER + log_sum(self.free, axis=1), best)
        apart = np.where(strange, 0.0, least(self.right, self.inverted))
        return level + np.minimum(apart, 0.0), level - np.maximum(apart, 0.0)

    def take(self, which: Index | slice) -> ColumnEvidence:
        """Of some pairs."""
        return ColumnEvidence(*(getattr(self, field.name)[which] for field in fields(self)))

    def either(self, other: ColumnEvidence) -> ColumnEvidence:
        """Of two models that are as likely before the data, pair by pair."""
        both = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return ColumnEvidence(*(np.asarray(log_sum(one, axis=0)) for one in both))


def least(one: Array, other: Array) -> Array:
    """(p,) the log odds of one to the other (p, c) that are least in magnitude, among the classes in which
    either is within REACH of the best; 0 where these differ in sign. Excluded classes are FAR below the best.
    """
    size = np.maximum(one, other)
    near = size > size.max(axis=1, keepdims=True) - REACH
    odds = _filled(one) - _filled(other)
    low = np.where(near, odds, np.inf).min(axis=1)
    high = np.where(near, odds, -np.inf).max(axis=1)
    return np.asarray(np.where(low > 0.0, low, np.where(high < 0.0, high, 0.0)))


def _filled(values: Array) -> Array:
    return np.where(np.isneginf(values), values.max(axis=1, keepdims=True) - FAR, values)


class _Whitened(NamedTuple):
    """The small stored results of a grid point. The factor (n, n) of the covariance is recomputed.

    Attributes:
        X: (n, k r) regressors through the factor's inverse.
        stands: of each joint that stands, the factor (m, m) of its stands, of unit variance, and its
            regressors (m, r) through the inverse. They are part of its own covariance (Woodbury).
        products: (k, r, r) of regressors. log_det: (k,) half the log determinant of the covariance.
    """

    X: Array
    stands: dict[int, tuple[Array, Array]]
    products: Array
    log_det: Array


@dataclass(frozen=True, eq=False)
class WhitenedMotion:
    """Whitened regressors of n rows: k joints, r regressors of each, at the points of a grid.

    Attributes:
        odd: (n,) rows that share no model with the others, but for the size of their noise; None: all do.
        terms: the sets of regressors that are tried.
        covariance: (n, n) of each point; None: by these rows alone.
    """

    rows: FilteredRows
    joint_indices: Index
    grid: tuple[Point, ...]
    odd: Mask | None = None
    covariance: Callable[[Point], Array] | None = None
    terms: tuple[tuple[int, ...], ...] = TERMS
    whitened: list[_Whitened] = field(default_factory=list)

    @classmethod
    def of(cls, rows: FilteredRows, joints: Index) -> WhitenedMotion:
        """At as many points as there are sizes and memories."""
        return cls(rows, joints, GRID + (NEAR_FILE if rows.torque is not None else ()), terms=TERMS)

    @cached_property
    def without_turns(self) -> WhitenedMotion:
        """The same motion without reversals, at the points that delays take."""
        return WhitenedMotion(self.rows.without_turns(), self.joint_indices, self._clock)

    @cached_property
    def with_memory(self) -> WhitenedMotion:
        """The same motion with friction that turns round over a distance, at the points that delays take."""
        return WhitenedMotion(self.rows, self.joint_indices, self._clock, terms=CLOCK_TERMS)

    @property
    def _clock(self) -> tuple[Point, ...]:
        return CLOCK + (NEAR_FILE if self.rows.torque is not None else ())

    def _points(self) -> Iterator[tuple[Array, _Whitened]]:
        """For each point, the lower Cholesky factor of the covariance, common to all joints and columns."""
        for i, point in enumerate(self.grid):
            L, _ = dpotrf(self._covariance(point), lower=1, clean=0, overwrite_a=1)
            if i == len(self.whitened):
                self.whitened.append(self._at(L))
            yield L, self.whitened[i]

    @cached_property
    def _covariance(self) -> Callable[[Point], Array]:
        covariance, odd = self.covariance or covariances(self.rows), self.odd
        if odd is None:
            return covariance
        same = np.equal.outer(odd, odd)
        return lambda point: covariance(point) * same

    @cached_property
    def _right(self) -> tuple[Array, list[tuple[int, slice]]]:
        """(n, k r + m) regressors and stands, and where those of each joint that stands are."""
        last = max(TORQUE, *(i for indices in self.terms for i in indices))
        stands = [self.rows.stands[j] for j in self.joint_indices]
        X = regressors(self.rows, self.joint_indices, last)
        if self.odd is not None:
            X = np.concatenate([X * self.odd[:, None, None], X * ~self.odd[:, None, None]], axis=2)
        flat = X.reshape(len(X), -1)
        ends = flat.shape[1] + np.cumsum([0, *(one.shape[1] for one in stands)])
        which = [(j, slice(a, b)) for j, (a, b) in enumerate(itertools.pairwise(ends)) if b > a]
        return np.asfortranarray(np.hstack([flat, *stands])), which

    def _at(self, L: Array) -> _Whitened:
        right, which = self._right
        R, k = dtrsm(1.0, L, right, lower=1), len(self.joint_indices)
        r = (which[0][1].start if which else R.shape[1]) // k
        X = R[:, : k * r].copy()
        products = (X.T @ X).reshape(k, r, k, r)[range(k), :, range(k)]
        half = np.full(k, np.log(np.diag(L)).sum())
        stands = {j: _stands(R[:, columns], X[:, j * r : (j + 1) * r]) for j, columns in which}
        for j, (M, U) in stands.items():
            half[j] += np.log(np.diag(M)).sum()
            products[j] -= U.T @ U
        return _Whitened(X, stands, products, half)

    def evidence(self, command: Array, joints: Index, columns: Index, variants: Index) -> ColumnEvidence:
        """Of each pair: the column `columns[i]` in `variants[i]` as the command of joint `joints[i]`.

        Args:
            command: (n, J, d) as that of the rows. joints, columns: (p,) indices into `joint_indices`.
        """
        terms, torque = self.terms, self.rows.torque
        if torque is not None:
            terms += tuple((TORQUE, *indices) for indices in terms)
        target = columns * command.shape[2] + variants
        square, across = self._products(_columns(command[:, self.joint_indices]), joints, target)
        idle = np.zeros(len(self.joint_indices), dtype=np.bool_)
        idle |= False if torque is None else torque[:, self.joint_indices].std(axis=0) == 0.0
        fits = []
        prior = -np.log(len(self.terms))
        for indices in terms:
            fit = self._fitted(square, across, indices, joints)
            unknown = idle[joints] if TORQUE in indices else np.zeros(len(joints), dtype=bool)
            fits.append((replace(fit, evidence=np.where(unknown, -np.inf, fit.evidence + prior)), indices))
        return _summed(fits, self.grid)

    def free(self, command: Array, variants: Sequence[int] = (AS_LOGGED,)) -> Array:
        """(k, v) log evidence of each joint's own column in v variants of the commands, of any coefficients.

        Args:
            command: (n, J, d) as that of the rows.
        """
        joints = np.repeat(np.arange(len(self.joint_indices)), len(variants))
        target = joints * command.shape[2] + np.tile(variants, len(self.joint_indices))
        square, across = self._products(_columns(command[:, self.joint_indices]), joints, target)
        copies, evidences = 1 if self.odd is None else 2, []
        for indices in self.terms:
            each = [i + across.shape[2] // copies * copy for copy in range(copies) for i in indices]
            evidences.append(self._fitted(square, across, tuple(each), joints).evidence)
        return np.asarray(log_sum(np.concatenate(evidences), axis=0)).reshape(-1, len(variants))

    def _products(self, Y: Array, joints: Index, target: Index) -> tuple[Array, Array]:
        """Of each pair's column, whitened: (h, p) with itself, (h, p, r) with the joint's regressors."""
        used, target = np.unique(target, return_inverse=True)
        pairs = [np.flatnonzero(joints == j) for j in range(len(self.joint_indices))]
        Y, square, across = np.asfortranarray(Y[:, used]), [], []
        for L, (X, stands, products, _) in self._points():
            R = dtrsm(1.0, L, Y, lower=1)
            size = (R**2).sum(axis=0)[target]
            product = (X.T @ R).reshape(*products.shape[:2], -1)[joints, :, target]
            back = dtrsm(1.0, L, R, lower=1, trans_a=1) if stands else R
            for j, (M, U) in stands.items():
                members = pairs[j]
                S = self.rows.stands[self.joint_indices[j]]
                V = dtrsm(1.0, M, S.T @ back[:, target[members]], lower=1)
                size[members] -= (V**2).sum(axis=0)
                product[members] -= V.T @ U
            square.append(size)
            across.append(product)
        return np.array(square), np.array(across)

    def _fitted(self, square: Array, across: Array, indices: tuple[int, ...], joints: Index) -> _Fit:
        """Ridge regression of each pair's column on some regressors of its joint, at every point."""
        chosen, n = np.array(indices), len(self.rows.t)
        A = np.array([one.products for one in self.whitened])[:, :, chosen[:, None], chosen] + np.eye(
            len(chosen)
        )
        log_det = np.linalg.slogdet(A)[1] * 0.5 + np.array([one.log_det for one in self.whitened])
        inverse = np.linalg.inv(A)
        product = across[:, :, chosen]
        mean = np.einsum("hpij,hpj->hpi", inverse[:, joints], product)
        left = np.maximum(square - (product * mean).sum(axis=2), np.finfo(float).tiny) / n
        evidence = -log_det[:, joints] - 0.5 * n * np.log(left)
        return _Fit(evidence, mean, inverse[:, joints] * left[..., None, None])


def _stands(S: Array, X: Array) -> tuple[Array, Array]:
    """The factor (m, m) of whitened stands S (n, m), and the regressors X (n, r) through its inverse."""
    M, _ = dpotrf(S.T @ S + np.eye(S.shape[1]), lower=1, clean=0)
    return M, dtrsm(1.0, M, S.T @ X, lower=1)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Of h points and p pairs: evidence (h, p), mean (h, p, m) and covariance (h, p, m, m), any signs."""

    evidence: Array
    mean: Array
    covariance: Array


STEADY = 1e-2  # deviation of what does not vary, over its size


def unit(values: Array) -> Array:
    """Columns (n, k) of unit deviation; what hardly varies by its size, zeros as they are."""
    size = np.maximum(values.std(axis=0), STEADY * np.sqrt((values**2).mean(axis=0)))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


def _columns(command: Array) -> Array:
    """(n, k d) commands (n, k, d) less their means, in deviations of the command as it was logged."""
    size = command[..., AS_LOGGED].std(axis=0)
    Y = (command - command.mean(axis=0)) / np.where(size > 0.0, size, 1.0)[:, None]
    return np.asarray(Y.reshape(len(command), -1))


def regressors(rows: FilteredRows, joints: Index, last: int = TORQUE) -> Array:
    """(n, k, last + 1) of each joint, of unit deviation: INERTIA, VISCOUS, COULOMB, DROP, TORQUE (0 without a
    file) and GRADUAL.
    """
    torque = np.zeros_like(rows.q) if rows.torque is None else rows.torque
    parts = [rows.qdd, rows.qd, rows.friction, rows.drop, torque, *np.moveaxis(rows.gradual, 2, 0)]
    return np.stack([unit(part[:, joints]) for part in parts[: last + 1]], axis=2)


def covariances(rows: FilteredRows) -> Callable[[Point], Array]:
    """The covariance (n, n) of a point; parts common to several points are computed once, on demand."""
    qd, qdd = unit(rows.qd), unit(rows.qdd)
    joints = rows.q.shape[1]
    fast = (qdd @ qdd.T + (qd @ qd.T) ** 2 / joints) / joints
    apart = np.abs(np.subtract.outer(rows.t, rows.t))
    place = cache(lambda length: _place(rows, length))
    process = cache(lambda length, speeds: place(length) * (1.0 + speeds * fast))
    ripple = cache(lambda length: RIPPLE**2 * _ripple(rows, length))
    memory = cache(lambda tau: np.exp(-apart / tau))

    def of(point: Point) -> Array:
        K = point.size**2 * process(point.length, point.speeds)
        K += point.drift**2 * memory(point.memory)
        K += max(LEVEL, point.size**2)
        if point.ripple:
            K += ripple(point.ripple)
        K.flat[:: len(K) + 1] += point.rough**2
        return np.asarray(K.T)  # symmetric, and in the order that factors want

    return of


def _place(rows: FilteredRows, length: float) -> Array:
    """(n, n) kernel of two configurations: of a chain's weights, or of springs of that length."""
    chain, square = np.ones((len(rows.q), len(rows.q))), np.zeros((len(rows.q), len(rows.q)))
    for q, kind in zip(rows.q.T, rows.units, strict=True):
        apart = np.subtract.outer(q, q)
        if length and (kind != "rad" or np.ptp(q) <= SMALL_TRAVEL):
            square += apart**2
        elif length:
            square += 2.0 - 2.0 * np.cos(apart)
        elif kind == "rad":
            chain *= (1.0 + SWAY * np.cos(apart)) / (1.0 + SWAY)
        else:  # a weight grows in proportion to where a slide stands
            chain *= (1.0 + SWAY * np.outer(q, q) / max(float(np.abs(q).max()) ** 2, 1e-12)) / (1.0 + SWAY)
    return np.exp(-0.5 * square / length**2) if length else chain


def _ripple(rows: FilteredRows, length: float) -> Array:
    """(n, n) kernel of two configurations for a sum of functions of one joint each."""
    each = (np.exp(-0.5 * (np.subtract.outer(q, q) / length) ** 2) for q in rows.q.T)
    return np.asarray(sum(each) / rows.q.shape[1])


def _summed(fits: list[tuple[_Fit, tuple[int, ...]]], grid: tuple[Point, ...]) -> ColumnEvidence:
    """By class: the sum over its best points, each with the probability of its orthants."""
    # with a drop of any sign a fit shapes its steps: of another form than a command's friction
    plain = np.array([DROP not in indices for _, indices in fits])
    top = np.max([fit.evidence.max(axis=0) for (fit, _), one in zip(fits, plain, strict=True) if one], axis=0)
    classes = [np.flatnonzero([(point.length, point.speeds) == one for point in grid]) for one in CLASSES]
    values, cases = [], []
    for fit, indices in fits:
        h = np.stack([points[np.argsort(-fit.evidence[points], axis=0)[:BEST]] for points in classes], axis=1)
        value = np.take_along_axis(fit.evidence[:, None], h, axis=0)
        values.append(np.where(value > top - FAR, value, -np.inf))
        cases.append(_turned(fit, indices, h, np.isfinite(values[-1])))
    inside = [np.broadcast_to(value, (4, *value.shape)).copy() for value in values]
    for value, (mean, _), log_inside in zip(inside, cases, log_orthants(cases), strict=True):
        value[:, np.isfinite(value[0])] += mean.shape[1] * np.log(2.0) + log_inside.reshape(4, -1)
    free = log_sum(np.concatenate(np.array(values)[plain]), axis=0)
    right, inverted, back, opposed = np.asarray(log_sum(np.concatenate(inside, axis=1), axis=1))
    return ColumnEvidence(right.T, inverted.T, back.T, opposed.T, free.T)


def _turned(fit: _Fit, indices: tuple[int, ...], h: Index, mask: Mask) -> tuple[Array, Array]:
    """Mean (N, m) and covariance (N, m, m) of coefficients that are positive if they are right, inverted,
    reversed or opposed, one quarter after the other; of each point h (b, c, p) in `mask`.
    """
    pairs, m = np.broadcast_to(np.arange(h.shape[-1]), h.shape)[mask], len(indices)
    mean, covariance = fit.mean[h[mask], pairs], fit.covariance[h[mask], pairs]
    friction, others = np.array([(1.0, -1.0, -1.0, 1.0), (1.0, -1.0, 1.0, -1.0)])
    signs = np.where(np.isin(indices, FRICTION), friction[:, None], others[:, None])[:, None]
    turned = signs[..., None] * signs[:, :, None] * covariance
    return (signs * mean).reshape(-1, m), turned.reshape(-1, m, m)


def log_orthants(cases: Sequence[tuple[Array, Array]]) -> list[Array]:
    """`log_orthant` of each mean and covariance; those of one size at once, as many are short."""
    sizes, log_probabilities = [mean.shape[1] for mean, _ in cases], [np.zeros(0) for _ in cases]
    for size in set(sizes):
        members = [i for i, one in enumerate(sizes) if one == size]
        means, covariances_ = zip(*(cases[i] for i in members), strict=True)
        values = log_orthant(np.concatenate(means), np.concatenate(covariances_))
        ends = np.cumsum([len(cases[i][0]) for i in members])[:-1]
        for i, part in zip(members, np.split(values, ends), strict=True):
            log_probabilities[i] = part
    return log_probabilities


SWEEPS, SETTLED = 8, 1e-4
"""Most of them over the factors of an orthant, and what one may still change of a variance at the end: at the
fixed point the mass is stationary in all factors, so that this leaves 1e-11 of its log."""


def log_orthant(mean: Array, covariance: Array) -> Array:
    """(N,) log Pr(x >= 0), x ~ N(mean (N, k), covariance (N, k, k)), by expectation propagation.

    Each x_i >= 0 is replaced by a normal factor that keeps mean and variance (Minka 2001); the mass follows
    (Cunningham, Hennig and Lacoste-Julien 2011). Exact for k = 1.
    """
    m, S = np.array(np.moveaxis(mean, 0, 1), order="C"), np.array(np.moveaxis(covariance, 0, 2), order="C")
    V, mu, tau, nu = S.copy(), m.copy(), np.zeros_like(m), np.zeros_like(m)  # cases last, to work on rows
    for _ in range(SWEEPS):
        moved = 0.0
        for i in range(len(m)):
            variance, centre = _cavity(V, mu, tau, nu, i)
            root = np.sqrt(variance)
            z = centre / root
            ratio = np.sqrt(2.0 / np.pi) / erfcx(-z / np.sqrt(2.0))
            to = np.maximum(variance * (1.0 - ratio * (z + ratio)), 1e-12 * variance)
            more = np.maximum(1.0 / to - 1.0 / variance, 0.0) - tau[i]
            shift = (centre + root * ratio) / to - centre / variance - nu[i]
            column, size = V[:, i].copy(), V[i, i].copy()
            part = 1.0 / (1.0 + more * size)
            mu += column * (part * (shift - more * mu[i]))
            V -= column[:, None] * (more * part * column)
            tau[i] += more
            nu[i] += shift
            moved = max(moved, float(np.abs(more * size).max(initial=0.0)))
        if moved < SETTLED:
            break
    return np.minimum(0.0, _mass(m, S, V, mu, tau, nu))


def _cavity(V: Array, mu: Array, tau: Array, nu: Array, i: int) -> tuple[Array, Array]:
    """Variance and mean (N,) of x_i without its own factor."""
    precision = 1.0 / V[i, i]
    variance = 1.0 / np.maximum(precision - tau[i], 1e-12)
    return variance, variance * (mu[i] * precision - nu[i])


def _mass(m: Array, S: Array, V: Array, mu: Array, tau: Array, nu: Array) -> Array:
    """(N,) the log mass of the prior times all factors."""
    total = np.zeros(m.shape[1])
    for i in range(len(m)):
        variance, centre = _cavity(V, mu, tau, nu, i)
        total += log_ndtr(centre / np.sqrt(variance)) + 0.5 * np.log1p(tau[i] * variance)
        total += 0.5 * centre**2 / variance
        total -= 0.5 * (nu[i] + centre / variance) ** 2 / (tau[i] + 1.0 / variance)
    pull = np.linalg.solve(S.T, m.T[..., None])[..., 0].T
    total -= 0.5 * np.linalg.slogdet(np.eye(len(m)) + (S * tau).T)[1]
    return np.asarray(total + 0.5 * ((pull + nu) * mu).sum(axis=0) - 0.5 * (m * pull).sum(axis=0))
