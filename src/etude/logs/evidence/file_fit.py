"""The fit of a model file's torque to all commands, beside an inertia, friction and an offset of each joint.

With a factor of the file's torque for each joint no unit of the commands matters; without them the file's
links, load and gravity may be off. Joints are weighed by what is left of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from etude.abilities import SupportsVariations
from etude.logs.checks.filtered_motion import states_of
from etude.logs.evidence.changed_parameters import unit_masses
from etude.logs.evidence.rows import APART, AS_LOGGED, FLOOR, FilteredRows, rows_of
from etude.protocols import Mean
from etude.types import Array, Channel, Index, Log, Mask

SCREEN = 10.0  # log odds from which wrong positions are looked for
AHEAD = 15.0  # log odds of them to centres of mass that are off
ROUNDS = 8  # of weighing joints by what is left of them
PUSHES = 0.5  # correlation with the negative velocity; Coulomb friction alone has 0.8 and more
SAME, SMALLEST = 1e-6, 1e-300  # of a column: what another one leaves of it; of its length
EARTH = 9.81  # m/s^2
MASSES_OFF = 0.3  # part by which masses of links may differ from a right file
RIGHT, OTHER = (MASSES_OFF, 0.05, 1.0), (3.0, 1.0, 1.0)
"""Deviations of what the file says: of links, in parts; of gravity, in its own; of a load, in the file's
torque. A right file, and one of another robot or mounting."""


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
        return np.asarray(self.body.predict(self.states))

    def turned(self, signs: Array) -> Array:
        """(n, k) the file's torque if joints with signs (k,) of -1 turn the other way."""
        rows = self.rows
        return np.asarray(self.along(rows.q * signs, rows.qd * signs, rows.qdd * signs) * signs)

    def along(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(..., n, k) the file's torque along other motions (..., n, k)."""
        motion = [x.reshape(-1, x.shape[-1]) for x in (q, qd, qdd)]
        states = states_of(np.arange(len(motion[0]), dtype=np.float64), self.path, *motion)
        return np.asarray(self.body.predict(states)).reshape(q.shape)

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

    def with_factors(self, joint: int, tried: Array, deviations: tuple[float, float, float] = RIGHT) -> Array:
        """(N,) the same of factors of one joint's commands."""
        factors = np.ones((len(tried), len(self.products)))
        factors[:, joint] = tried
        return self.scores(factors, deviations)


def score_of_masses(fit: FileFit) -> float:
    """The score with the first moments of one link free, or of all, less half the logarithm of the
    independent rows for each of them (Schwarz 1978).
    """
    assert isinstance(fit.body, SupportsVariations)
    moments = fit.body.links(fit.states)[:, :, :, 1:4]
    each = [moments[:, :, b] for b in range(moments.shape[2])]
    price = 0.5 * float(np.log(len(fit.rows.t) * len(fit.joint_indices) / APART))
    tried = [*each, moments.reshape(*moments.shape[:2], -1)]
    return max(fit.score_with(columns) - price * float(columns.shape[2]) for columns in tried)
