"""Parameters that change by the model file, within a log or between logs: a load, masses of links, friction.

    u_j = own columns of joint j + s(t) (D_j friction + E_j qd + sum_b m_b L_jb(q, qd, qdd)) + f + n

L holds the commands for each kg at a link; all joints share the masses m. s goes from 0 to 1 where they
change. Process f and noise n are those of `likelihood`. The masses have a normal prior with which they change
commands by as much as the file's torque. The mixture over the grid is followed by expectation maximisation
(Dempster, Laird and Rubin 1977), and masses are integrated out (Laplace).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude._runtime.scipy_parts import dpotrf, dtrsm
from etude.abilities import SupportsVariations
from etude.logs.checks.filtered_motion import states_of
from etude.logs.evidence.likelihood import (
    COULOMB,
    GRADUAL,
    NEAR_FILE,
    VISCOUS,
    covariances,
    log_sum,
    regressors,
)
from etude.logs.evidence.rows import AS_LOGGED, FilteredRows
from etude.protocols import Mean
from etude.types import Array, Channel, Index, Mask

GRID = (*NEAR_FILE, *(point._replace(size=0.5) for point in NEAR_FILE[:3]))
"""Of processes: masses of the file may be far off."""
ROUNDS = 12  # of expectation maximisation: odds settle to 0.1


@dataclass(frozen=True, eq=False)
class ChangeEvidence:
    """The evidence of c changes in n rows; k joints, p links.

    Attributes:
        products: (h, k, m, m) of each joint's whitened columns: its own, the last link's mass and moments,
            the command, and of each change qd, friction and the links. half: (h, k) half the log determinant
            of the covariance.
        unit: (p,) kg of the columns of links. informative: (c, k) whether a joint counts for a change.
    """

    products: Array
    half: Array
    n: int
    unit: Array
    informative: Mask

    @classmethod
    def of(
        cls,
        rows: FilteredRows,
        joints: Index,
        path: Channel,
        body: Mean,
        after: Array,
        informative: Mask,
        most: int | None = None,
    ) -> ChangeEvidence:
        """The evidence of rows that hold the file's torque.

        Args:
            after: (n, c) from 0 to 1: how much each row holds of each change.
            most: number of links that may change, counted from the last; None: all.
        """
        assert rows.torque is not None
        assert isinstance(body, SupportsVariations)
        command = rows.command[:, joints, AS_LOGGED]
        size = command.std(axis=0)
        y = ((command - command.mean(axis=0)) / size)[:, :, None]
        states = states_of(rows.t, path, rows.q, rows.qd, rows.qdd)
        links = body.links(states)[:, joints] / size[:, None, None]
        L = links[:, :, -(most or 0) :, 0]
        X = regressors(rows, joints, GRADUAL[-1])
        unit = unit_masses(rows.torque[:, joints] / size, L)
        L = L * unit
        changed = np.concatenate([X[:, :, [VISCOUS, COULOMB]], L], axis=2)
        moved = (after[:, None, :, None] * changed[:, :, None]).reshape(*X.shape[:2], -1)
        # what the last link carries all the time may have its centre anywhere
        carried = links[:, :, -1, :4] * unit_masses(rows.torque[:, joints] / size, links[:, :, -1, :4])
        products, half = _products(rows, joints, np.concatenate([X, carried, y, moved], axis=2))
        return cls(products, half, len(rows.t), unit, informative)

    def _columns(self, change: int) -> tuple[list[int], int, int, list[int]]:
        """Of the joint's own columns with qd after the change, the command, friction and links after it."""
        links = len(self.unit)
        y = self.products.shape[-1] - len(self.informative) * (2 + links) - 1
        first = y + 1 + change * (2 + links)
        return [*range(y), first], y, first + 1, list(range(first + 2, first + 2 + links))

    def load(self, change: int) -> tuple[float, float]:
        """Log odds of a load at the last link against none, and its kg; friction may change too."""
        odds, kg = self._shared(change, slice(-1, None))
        return odds, float(kg[0])

    def masses(self, change: int) -> float:
        """Log odds of changed masses of all links against the same ones; friction may change too."""
        return self._shared(change, slice(None))[0]

    def friction(self, change: int) -> tuple[Array, Array]:
        """(k,) each: log odds of changed Coulomb friction against the same, and its factor."""
        nuisance, y, friction, _ = self._columns(change)
        nuisance = [i for i in nuisance if i not in GRADUAL]  # the factor is of Coulomb friction
        same, other = self._evidence(nuisance, y), self._evidence([*nuisance, friction], y)
        columns, every = np.array([*nuisance, friction]), np.arange(other.shape[1])
        A = self.products[..., columns[:, None], columns] + np.eye(len(columns))
        coefficients = np.linalg.solve(A, self.products[..., columns, y, None])
        coefficients = coefficients[other.argmax(axis=0), every, :, 0]
        odds = log_sum(other, axis=0) - log_sum(same, axis=0)
        factor = 1.0 + coefficients[:, -1] / coefficients[:, COULOMB]
        return np.where(self.informative[change], odds, 0.0), factor

    def _evidence(self, nuisance: list[int], y: int) -> Array:
        """(h, k) log evidence of the commands with some columns."""
        left, half = _regressed_out(self.products, self.half, nuisance, [y])
        return -half - 0.5 * self.n * np.log(left[..., 0, 0] / self.n)

    def _shared(self, change: int, which: slice) -> tuple[float, Array]:
        nuisance, y, friction, links = self._columns(change)
        left, half = _regressed_out(self.products, self.half, [*nuisance, friction], [y, *links[which]])
        odds, weights = _shared(left, half, self.n, self.informative[change])
        return odds, weights * self.unit[which]


def unit_masses(torque: Array, L: Array) -> Array:
    """(p,) kg with which commands L (n, k, p) for each kg are as large as the file's torque (n, k)."""
    size, each = np.sqrt((torque**2).mean()), np.sqrt((L**2).mean(axis=(0, 1)))
    return np.asarray(size / np.where(each > 0.0, each, np.inf))


def _products(rows: FilteredRows, joints: Index, columns: Array) -> tuple[Array, Array]:
    """(h, k, m, m) products of each joint's columns (n, k, m), whitened at each point of the grid, and (h, k)
    half the log determinant of its covariance. Static friction explains any command of a joint at rest
    (Woodbury).
    """
    n, k, m = columns.shape
    covariance, flat = covariances(rows), np.asfortranarray(columns.reshape(n, -1))
    products, half = np.empty((len(GRID), k, m, m)), np.empty((len(GRID), k))
    for h, point in enumerate(GRID):
        factor, _ = dpotrf(covariance(point), lower=1, clean=0, overwrite_a=1)
        white = dtrsm(1.0, factor, flat, lower=1).reshape(n, k, m)
        half[h] = np.log(np.diag(factor)).sum()
        for j in range(k):
            W, stands = white[:, j], rows.stands[joints[j]]
            products[h, j] = W.T @ W
            if stands.shape[1]:
                S = dtrsm(1.0, factor, stands, lower=1)
                M, _ = dpotrf(S.T @ S + np.eye(S.shape[1]), lower=1, clean=0)
                U = dtrsm(1.0, M, S.T @ W, lower=1)
                products[h, j] -= U.T @ U
                half[h, j] += np.log(np.diag(M)).sum()
    return products, half


def _regressed_out(
    products: Array, half: Array, nuisance: list[int], targets: list[int]
) -> tuple[Array, Array]:
    """Products of the columns `targets` after the regression on a joint's columns `nuisance`, with a prior of
    unit variance, and (h, k) half the log determinant with them.
    """
    nuisance_, targets_ = np.array(nuisance), np.array(targets)
    A = products[..., nuisance_[:, None], nuisance_] + np.eye(len(nuisance))
    across = products[..., nuisance_[:, None], targets_]
    left = products[..., targets_[:, None], targets_] - np.swapaxes(across, 2, 3) @ np.linalg.solve(A, across)
    return left, half + 0.5 * np.linalg.slogdet(A)[1]


def _shared(left: Array, half: Array, n: int, informative: Mask) -> tuple[float, Array]:
    """Log odds of weights (p,) common to all joints against none, and the weights.

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
        part = np.exp(evidence - log_sum(evidence, axis=0)) * informative * n / squares
        A = np.einsum("hk,hkpq->pq", part, Q) + np.eye(p)
        weights = np.linalg.solve(A, np.einsum("hk,hkp->p", part, b))
    gains = log_sum(at(weights)[1], axis=0) - before
    price = 0.5 * float(weights @ weights) + 0.5 * float(np.linalg.slogdet(A)[1])
    return float(gains[informative].sum()) - price, weights
