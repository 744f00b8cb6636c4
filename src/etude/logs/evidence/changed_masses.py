"""Masses that change by the model file: a load that is taken up or put down, within a log or between logs.

    u_j = own columns of joint j + s(t) sum_b m_b L_jb(q, qd, qdd) + f(q, qd, qdd) + n

L holds the commands for each kg at a link; all joints share the masses m. s goes from 0 to 1 where they
change; friction may change there, too, by joint. Process f and noise n are those of `likelihood`. The masses
have a normal prior with which they change commands by as much as the file's torque. The mixture over the grid
is followed by expectation maximisation (Dempster, Laird and Rubin 1977); masses are integrated out (Laplace).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude._runtime.scipy_parts import dpotrf, dtrsm
from etude.logs.evidence.likelihood import (
    COULOMB,
    NEAR_FILE,
    VISCOUS,
    covariances,
    log_sum,
    regressors,
)
from etude.logs.evidence.rows import AS_LOGGED, FilteredRows
from etude.types import Array, Index, Mask

GRID = (*NEAR_FILE, *(point._replace(size=0.5) for point in NEAR_FILE[:3]))
"""Of processes: masses of the file may be far off."""
ROUNDS = 12  # of expectation maximisation: odds settle to 0.1


@dataclass(frozen=True, eq=False)
class ChangedMasses:
    """What changed masses explain, at each of c times or of c groups of rows.

    Attributes:
        odds: (c,) log odds to no change of masses. each: (c, k) what each joint gains of them.
        kg: (c, p) the masses that explain most.
    """

    odds: Array
    each: Array
    kg: Array


def changed_masses(rows: FilteredRows, own: Index, masses: Array, after: Array, heard: Mask) -> ChangedMasses:
    """The evidence of masses that differ in some rows.

    Args:
        rows: n rows that hold the file's torque. own: (k,) joints whose commands are looked at.
        masses: (n, J, p) commands of all joints for each kg.
        after: (n, c) from 0 to 1: how much each row holds of each change.
        heard: (c, k) joints that have a say of each change.
    """
    assert rows.torque is not None
    command = rows.command[:, own, AS_LOGGED]
    size = command.std(axis=0)
    y = ((command - command.mean(axis=0)) / size)[:, :, None]
    X, L = regressors(rows, own), masses[:, own] / size[:, None]
    (n, k, r), p, c = X.shape, L.shape[2], after.shape[1]
    unit = _unit(rows.torque[:, own] / size, L)
    L = L * unit
    changed = np.concatenate([X[:, :, [VISCOUS, COULOMB]], L], axis=2)
    moved = (after[:, None, :, None] * changed[:, :, None]).reshape(n, k, -1)
    products, half = _products(rows, own, np.concatenate([X, L, y, moved], axis=2))
    found = []
    for i in range(c):
        first = r + p + 1 + i * (p + 2)
        friction, load = [first, first + 1], list(range(first + 2, first + 2 + p))
        mine, kept = [*range(r + p), *friction], [r + p, *load]
        found.append(_shared(*_without(products, half, mine, kept), n, heard[i]))
    odds, each, kg = (np.array(part) for part in zip(*found, strict=True))
    return ChangedMasses(odds, each, kg * unit)


def _unit(torque: Array, L: Array) -> Array:
    """(p,) kg with which commands L (n, k, p) for each kg are as large as the file's torque (n, k)."""
    size, each = np.sqrt((torque**2).mean()), np.sqrt((L**2).mean(axis=(0, 1)))
    return np.asarray(size / np.where(each > 0.0, each, np.inf))


def _products(rows: FilteredRows, own: Index, columns: Array) -> tuple[Array, Array]:
    """(h, k, m, m) products of each joint's columns (n, k, m), whitened at each point of the grid, and (h, k)
    half the log determinant of its covariance. Where the joint stands, any command is held (Woodbury).
    """
    n, k, m = columns.shape
    covariance, flat = covariances(rows), np.asfortranarray(columns.reshape(n, -1))
    products, half = np.empty((len(GRID), k, m, m)), np.empty((len(GRID), k))
    for h, point in enumerate(GRID):
        factor, _ = dpotrf(covariance(point), lower=1, clean=0, overwrite_a=1)
        white = dtrsm(1.0, factor, flat, lower=1).reshape(n, k, m)
        half[h] = np.log(np.diag(factor)).sum()
        for j in range(k):
            W, stands = white[:, j], rows.stands[own[j]]
            products[h, j] = W.T @ W
            if stands.shape[1]:
                S = dtrsm(1.0, factor, stands, lower=1)
                M, _ = dpotrf(S.T @ S + np.eye(S.shape[1]), lower=1, clean=0)
                U = dtrsm(1.0, M, S.T @ W, lower=1)
                products[h, j] -= U.T @ U
                half[h, j] += np.log(np.diag(M)).sum()
    return products, half


def _without(products: Array, half: Array, mine: list[int], kept: list[int]) -> tuple[Array, Array]:
    """Products of the columns `kept` less what a joint's own columns explain, with a prior of unit variance,
    and (h, k) half the log determinant with them.
    """
    mine_, kept_ = np.array(mine), np.array(kept)
    A = products[..., mine_[:, None], mine_] + np.eye(len(mine))
    across = products[..., mine_[:, None], kept_]
    left = products[..., kept_[:, None], kept_] - np.swapaxes(across, 2, 3) @ np.linalg.solve(A, across)
    return left, half + 0.5 * np.linalg.slogdet(A)[1]


def _shared(left: Array, half: Array, n: int, heard: Mask) -> tuple[float, Array, Array]:
    """Log odds of weights (p,) that all joints share to none, (k,) what each joint gains, and the weights.

    Args:
        left: (h, k, 1 + p, 1 + p) products of commands, and of what they are weights of.
    """
    y, b, Q = left[..., 0, 0], left[..., 1:, 0], left[..., 1:, 1:]
    p = b.shape[2]

    def at(weights: Array) -> tuple[Array, Array]:
        squares = y - 2.0 * b @ weights + np.einsum("hkpq,p,q->hk", Q, weights, weights)
        squares = np.maximum(squares, np.finfo(float).tiny)
        return squares, -half - 0.5 * n * np.log(squares / n)

    weights, before = np.zeros(p), log_sum(at(np.zeros(p))[1], axis=0)
    for _ in range(ROUNDS):
        squares, evidence = at(weights)
        part = np.exp(evidence - log_sum(evidence, axis=0)) * heard * n / squares
        A = np.einsum("hk,hkpq->pq", part, Q) + np.eye(p)
        weights = np.linalg.solve(A, np.einsum("hk,hkp->p", part, b))
    each = np.where(heard, log_sum(at(weights)[1], axis=0) - before, 0.0)
    price = 0.5 * float(weights @ weights) + 0.5 * float(np.linalg.slogdet(A)[1])
    return float(each.sum()) - price, each, weights
