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
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import erfcx, log_ndtr, logsumexp

from etude._runtime.scipy_parts import dpotrf
from etude.logs.evidence.rows import AS_LOGGED, FilteredRows
from etude.types import Array, Index, Mask


class Point(NamedTuple):
    """Of the grid. Sizes are in deviations of a regressor.

    Attributes:
        length: rad, of springs and other functions of the place; 0: a chain's weights.
        size: of the process. speeds: its part that grows with accelerations and squared velocities.
        drift: of the noise with memory. memory: s. rough: of the noise of each row.
    """

    length: float
    size: float
    drift: float
    memory: float
    rough: float
    speeds: float


LENGTHS, SPEEDS = (0.7, 2.0, 0.0), (0.1, 2.0)  # of `Point`
CLASSES = tuple(itertools.product(LENGTHS, SPEEDS))
"""Of processes: an evidence is that of the class that says least."""
DRIFTS = ((0.05, 0.3), (0.2, 0.3), (0.2, 2.0))  # and memories, of `Point`
GRID = tuple(
    Point(length, size, *drift, rough, speeds)
    for length, size, drift, rough, speeds in itertools.product(
        LENGTHS, (0.5, 2.0, 10.0), DRIFTS, (0.02, 0.1), SPEEDS
    )
)
NEAR_FILE = tuple(
    Point(0.0, size, *noise, 0.1)
    for size, noise in itertools.product(
        (0.003, 0.03, 0.15), ((0.05, 0.3, 0.02), (0.2, 2.0, 0.05), (0.005, 0.3, 0.002), (5e-4, 0.3, 5e-4))
    )
)
"""With a model file that is right to 0.3, 3 or 15 %."""
LEVEL = 4.0  # variance of a command's mean, at least
SWAY = 0.7  # of the chain's kernel: how much of a weight turns with one joint
SMALL_WAY = 0.3  # rad: a joint that goes less far is no angle to the springs' kernel
INERTIA, VISCOUS, COULOMB, DROP, TORQUE = range(5)  # regressors, in the order of their columns
TERMS = ((INERTIA, VISCOUS, COULOMB), (INERTIA,), (INERTIA, VISCOUS, COULOMB, DROP))  # friction may be none
FRICTION = (VISCOUS, COULOMB, DROP)
NEITHER = np.log(0.05)  # prior of a command that no sign explains
INVERTED = np.log(0.03)  # prior of an inverted one, where orders and delays are compared
BEST = 2  # points of a class whose orthants are computed
FAR = 40.0  # nats below the best point: no say
REACH = 25.0  # nats below the best class within which a class has a say


@dataclass(frozen=True, eq=False)
class ColumnEvidence:
    """Log evidences (p, c) of p pairs of a joint and a column, in c classes of processes; -inf: no say.

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
        parts = [logsumexp(one, axis=1) for one in (self.right, self.inverted, self.free)]
        return np.asarray(logsumexp([parts[0], parts[1], parts[2] + NEITHER], axis=0))

    def by_class(self) -> Array:
        """(p, c) of the column whatever its sign, in each class; inverted ones have a prior of INVERTED."""
        parts = [self.right, self.inverted + INVERTED, self.free + NEITHER]
        return np.asarray(logsumexp(parts, axis=0))

    def strange(self) -> Mask:
        """(p,) where neither sign explains the column, which then has no say."""
        best = np.maximum(logsumexp(self.right, axis=1), logsumexp(self.inverted, axis=1))
        return np.asarray(NEITHER + logsumexp(self.free, axis=1) > best)

    def signs(self) -> tuple[Array, Array]:
        """(p,) each: the evidence of right and of inverted, apart by what the least favourable class says."""
        strange = self.strange()
        best = np.maximum(logsumexp(self.right, axis=1), logsumexp(self.inverted, axis=1))
        level = np.where(strange, NEITHER + logsumexp(self.free, axis=1), best)
        apart = np.where(strange, 0.0, least(self.right, self.inverted))
        return level + np.minimum(apart, 0.0), level - np.maximum(apart, 0.0)

    def take(self, which: Index | slice) -> ColumnEvidence:
        """Of some pairs."""
        return ColumnEvidence(*(getattr(self, field.name)[which] for field in fields(self)))


def least(one: Array, other: Array) -> Array:
    """(p,) the log odds of one to the other (p, c) that are least in magnitude, among the classes in which
    either is within REACH of the best; 0 where these differ in sign. What has no say is FAR below its best.
    """
    size = np.maximum(one, other)
    near = size > size.max(axis=1, keepdims=True) - REACH
    odds = _filled(one) - _filled(other)
    low = np.where(near, odds, np.inf).min(axis=1)
    high = np.where(near, odds, -np.inf).max(axis=1)
    return np.asarray(np.where(low > 0.0, low, np.where(high < 0.0, high, 0.0)))


def _filled(values: Array) -> Array:
    return np.where(np.isneginf(values), values.max(axis=1, keepdims=True) - FAR, values)


def evidence_of(
    rows: FilteredRows, own: Index, joints: Index, columns: Index, variants: Index
) -> ColumnEvidence:
    """Of each pair: the column `columns[i]` in `variants[i]` as the command of joint `joints[i]`.

    Args:
        own: joints whose columns are looked at; the others count as indices into it.
    """
    terms: list[tuple[tuple[int, ...], float]] = [(indices, -np.log(len(TERMS))) for indices in TERMS]
    if rows.torque is not None:
        terms += [((TORQUE, *indices), -np.log(len(TERMS))) for indices in TERMS]
    grid = GRID + (NEAR_FILE if rows.torque is not None else ())
    products = _products(rows, own, grid)
    target = columns * rows.command.shape[2] + variants
    idle = np.zeros(len(own), dtype=bool) if rows.torque is None else rows.torque[:, own].std(axis=0) == 0.0
    fits = []
    for indices, prior in terms:
        fit = _fitted(products, len(rows.t), indices, joints, target)
        unknown = idle[joints] if TORQUE in indices else np.zeros(len(joints), dtype=bool)
        fits.append((replace(fit, evidence=np.where(unknown, -np.inf, fit.evidence + prior)), indices))
    return _summed(fits, grid)


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


@dataclass(frozen=True, eq=False)
class _Products:
    """Whitened products at h points, for k joints, r regressors of each and c columns.

    Attributes:
        square: (h, k, c) of each column with itself. across: (h, k, r, c). regressors: (h, k, r, r).
        log_det: (h, k) half the log determinant of the covariance.
    """

    square: Array
    across: Array
    regressors: Array
    log_det: Array


def _products(rows: FilteredRows, own: Index, grid: tuple[Point, ...]) -> _Products:
    """A joint's stands, of unit variance, are part of its own covariance (Woodbury's identity)."""
    Y, X, stands = _columns(rows, own), _regressors(rows, own), [rows.stands[j] for j in own]
    n, (k, r), c = len(rows.t), X.shape[1:], Y.shape[1]
    right = np.asfortranarray(np.hstack([X.reshape(n, -1), Y, *stands]))
    ends = np.cumsum([0, k * r, c, *(own.shape[1] for own in stands)])
    covariance, found = _covariances(rows), []
    for point in grid:
        L, _ = dpotrf(covariance(point), lower=1, clean=0, overwrite_a=1)
        R = solve_triangular(L, right, lower=True, check_finite=False)
        parts = [R[:, a:b] for a, b in itertools.pairwise(ends)]
        half = float(np.log(np.diag(L)).sum())
        each = [_beside(parts[0][:, j * r : (j + 1) * r], parts[1], parts[2 + j], half) for j in range(k)]
        found.append([np.stack(values) for values in zip(*each, strict=True)])
    return _Products(*(np.stack(values) for values in zip(*found, strict=True)))


def _beside(X: Array, Y: Array, S: Array, log_det: float) -> tuple[Array, Array, Array, Array]:
    """The products of one joint, with its stands S (n, m) in the covariance."""
    square, across, own = (Y**2).sum(axis=0), X.T @ Y, X.T @ X
    if not S.shape[1]:
        return square, across, own, np.asarray(log_det)
    L = np.linalg.cholesky(S.T @ S + np.eye(S.shape[1]))
    U, V = (solve_triangular(L, S.T @ part, lower=True, check_finite=False) for part in (X, Y))
    log_det += float(np.log(np.diag(L)).sum())
    return square - (V**2).sum(axis=0), across - U.T @ V, own - U.T @ U, np.asarray(log_det)


def _columns(rows: FilteredRows, own: Index) -> Array:
    """(n, k d) commands in all variants, less their means, in deviations of the command as it was logged."""
    command = rows.command[:, own]
    size = command[..., AS_LOGGED].std(axis=0)
    Y = (command - command.mean(axis=0)) / np.where(size > 0.0, size, 1.0)[:, None]
    return np.asarray(Y.reshape(len(rows.t), -1))


def _regressors(rows: FilteredRows, own: Index) -> Array:
    """(n, k, r) of each joint, of unit deviation."""
    parts = [rows.qdd, rows.qd, rows.friction, rows.drop]
    parts += [] if rows.torque is None else [rows.torque]
    return np.stack([unit(part[:, own]) for part in parts], axis=2)


def _covariances(rows: FilteredRows) -> Callable[[Point], Array]:
    """The covariance (n, n) of a point; what points share is computed once."""
    places = {length: _place(rows, length) for length in LENGTHS}
    qd, qdd = unit(rows.qd), unit(rows.qdd)
    joints = rows.q.shape[1]
    fast = (qdd @ qdd.T + (qd @ qd.T) ** 2 / joints) / joints
    process = {(length, speeds): places[length] * (1.0 + speeds * fast) for length, speeds in CLASSES}
    apart = np.abs(np.subtract.outer(rows.t, rows.t))
    memory = {tau: np.exp(-apart / tau) for tau in {memory for _, memory in DRIFTS}}

    def of(point: Point) -> Array:
        K = point.size**2 * process[point.length, point.speeds]
        K += point.drift**2 * memory[point.memory]
        K += max(LEVEL, point.size**2)
        K.flat[:: len(K) + 1] += point.rough**2
        return np.asfortranarray(K)

    return of


def _place(rows: FilteredRows, length: float) -> Array:
    """(n, n) likeness of two places: of a chain's weights, or of springs of that length."""
    chain, square = np.ones((len(rows.q), len(rows.q))), np.zeros((len(rows.q), len(rows.q)))
    for q, kind in zip(rows.q.T, rows.units, strict=True):
        apart = np.subtract.outer(q, q)
        if length and (kind != "rad" or np.ptp(q) <= SMALL_WAY):
            square += apart**2
        elif length:
            square += 2.0 - 2.0 * np.cos(apart)
        elif kind == "rad":
            chain *= (1.0 + SWAY * np.cos(apart)) / (1.0 + SWAY)
        else:  # a weight grows in proportion to where a slide stands
            chain *= (1.0 + SWAY * np.outer(q, q) / max(float(np.abs(q).max()) ** 2, 1e-12)) / (1.0 + SWAY)
    return np.exp(-0.5 * square / length**2) if length else chain


def _fitted(products: _Products, n: int, indices: tuple[int, ...], joints: Index, target: Index) -> _Fit:
    """Ridge regression of each target on some regressors of its joint, at every point of the grid."""
    chosen = np.array(indices)
    A = products.regressors[:, :, chosen[:, None], chosen] + np.eye(len(indices))
    inverse, log_det = np.linalg.inv(A), np.linalg.slogdet(A)[1] * 0.5 + products.log_det
    product = products.across[:, joints[:, None], chosen, target[:, None]]
    mean = np.einsum("hpij,hpj->hpi", inverse[:, joints], product)
    left = products.square[:, joints, target] - (product * mean).sum(axis=2)
    left = np.maximum(left, np.finfo(float).tiny) / n
    evidence = -log_det[:, joints] - 0.5 * n * np.log(left)
    return _Fit(evidence, mean, inverse[:, joints] * left[..., None, None])


def _summed(fits: list[tuple[_Fit, tuple[int, ...]]], grid: tuple[Point, ...]) -> ColumnEvidence:
    """By class: the sum over its best points, each with the probability of its orthants."""
    # with a drop of any sign a fit shapes its steps: of another form than a command's friction
    plain = [(fit, indices) for fit, indices in fits if DROP not in indices]
    top = np.max([fit.evidence.max(axis=0) for fit, _ in plain], axis=0)
    found = [
        [
            *(_class(fits, grid, one, top, way) for way in ("right", "inverted", "reversed", "opposed")),
            _class(plain, grid, one, top, "free"),
        ]
        for one in CLASSES
    ]
    parts = [np.stack([row[i] for row in found], axis=1) for i in range(5)]
    return ColumnEvidence(*parts)


def _class(
    fits: list[tuple[_Fit, tuple[int, ...]]],
    grid: tuple[Point, ...],
    one: tuple[float, float],
    top: Array,
    way: str,
) -> Array:
    own = np.flatnonzero([(point.length, point.speeds) == one for point in grid])
    sums = []
    for fit, indices in fits:
        best = np.argsort(-fit.evidence[own], axis=0)[:BEST]
        h, p = own[best], np.arange(fit.evidence.shape[1])
        value = fit.evidence[h, p]
        value = np.where(value > top - FAR, value, -np.inf)
        if way != "free":
            told = np.isfinite(value)
            mean, covariance = fit.mean[h, p][told], fit.covariance[h, p][told]
            signs = _signs(indices, way)
            inside = log_orthant(signs * mean, np.outer(signs, signs) * covariance)
            value[told] += len(indices) * np.log(2.0) + inside
        sums.append(value)
    return np.asarray(logsumexp(np.concatenate(sums), axis=0))


def _signs(indices: tuple[int, ...], way: str) -> Array:
    friction = 1.0 if way in ("right", "opposed") else -1.0
    others = 1.0 if way in ("right", "reversed") else -1.0
    return np.array([friction if i in FRICTION else others for i in indices])


SWEEPS = 12  # over the factors of an orthant: they settle to rounding in fewer


def log_orthant(mean: Array, covariance: Array) -> Array:
    """(N,) log Pr(x >= 0), x ~ N(mean (N, k), covariance (N, k, k)), by expectation propagation.

    Each x_i >= 0 is replaced by a normal factor that keeps mean and variance (Minka 2001); the mass follows
    (Cunningham, Hennig and Lacoste-Julien 2011). Exact for k = 1.
    """
    m, S = np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    N, k = m.shape
    V, mu = S.copy(), m.copy()
    tau, nu = np.zeros((N, k)), np.zeros((N, k))
    for _ in range(SWEEPS):
        for i in range(k):
            variance, centre = _cavity(V, mu, tau, nu, i)
            z = centre / np.sqrt(variance)
            ratio = np.sqrt(2.0 / np.pi) / erfcx(-z / np.sqrt(2.0))
            to = np.maximum(variance * (1.0 - ratio * (z + ratio)), 1e-12 * variance)
            more = np.maximum(1.0 / to - 1.0 / variance, 0.0) - tau[:, i]
            shift = (centre + np.sqrt(variance) * ratio) / to - centre / variance - nu[:, i]
            column, size = V[:, :, i].copy(), V[:, i, i].copy()
            part = 1.0 / (1.0 + more * size)
            mu += column * (part * (shift - more * mu[:, i]))[:, None]
            V -= (more * part)[:, None, None] * column[:, :, None] * column[:, None, :]
            tau[:, i] += more
            nu[:, i] += shift
    return np.minimum(0.0, _mass(m, S, V, mu, tau, nu))


def _cavity(V: Array, mu: Array, tau: Array, nu: Array, i: int) -> tuple[Array, Array]:
    """Variance and mean (N,) of x_i without its own factor."""
    precision = 1.0 / V[:, i, i]
    variance = 1.0 / np.maximum(precision - tau[:, i], 1e-12)
    return variance, variance * (mu[:, i] * precision - nu[:, i])


def _mass(m: Array, S: Array, V: Array, mu: Array, tau: Array, nu: Array) -> Array:
    """(N,) the log mass of the prior times all factors."""
    k = m.shape[1]
    total = np.zeros(len(m))
    for i in range(k):
        variance, centre = _cavity(V, mu, tau, nu, i)
        total += log_ndtr(centre / np.sqrt(variance)) + 0.5 * np.log1p(tau[:, i] * variance)
        total += 0.5 * centre**2 / variance
        total -= 0.5 * (nu[:, i] + centre / variance) ** 2 / (tau[:, i] + 1.0 / variance)
    pull = np.linalg.solve(S, m[..., None])[..., 0]
    total -= 0.5 * np.linalg.slogdet(np.eye(k) + S * tau[:, None, :])[1]
    return np.asarray(total + 0.5 * ((pull + nu) * mu).sum(axis=1) - 0.5 * (m * pull).sum(axis=1))
