"""A deep Lagrangian network (Lutter, Ritter and Peters 2019): energies of an arm from one neural network.

Two hidden layers of tanh give L(q) and V(q). Forces follow by Lagrange's equations from the kinetic energy
qd' H qd / 2 with H = L L' + e I and the potential energy V, and from terms of friction that are linear:

    tau_i = [H qdd]_i + sum_k qd_k [d_k H qd]_i - qd' d_i H qd / 2 + d_i V + friction_i.

Coordinates are positions in units of their deviation, and time has the unit in which velocities are one in
the mean. Lagrange's equations hold in any coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.types import Array, Index
from etude_studies.thesis.regressors import NetworkSetting, Predict, Weights, by_adam, first_weights

LEAST_INERTIA = 1e-3
"""e, in the units of the network."""
WIDE = 64
"""Most units of a layer: with all derivatives of H a step costs 1 + J times that of a plain network."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Scaled q, qd, qdd (n, J), and columns (n, J, F) in which each joint's friction is linear."""

    q: Array
    qd: Array
    qdd: Array
    friction: Array

    def take(self, rows: Index) -> Motion:
        """Those rows."""
        return Motion(self.q[rows], self.qd[rows], self.qdd[rows], self.friction[rows])


@dataclass(frozen=True, eq=False)
class Scales:
    """centre, size: (J,) of positions. time: s. force: (J,) of commands."""

    centre: Array
    size: Array
    time: float
    force: Array

    @classmethod
    def of(cls, X: Array, Y: Array) -> Scales:
        """Of columns q, qd, ... (n, D) and commands (n, J)."""
        J = Y.shape[1]
        size = np.maximum(X[:, :J].std(axis=0), 1e-9)  # rad: a joint that stands still
        speed = float(np.sqrt(np.mean((X[:, J : 2 * J] / size) ** 2)))
        # work is the same in all coordinates: a scaled force is the command times the size of its coordinate
        energy = float(np.sqrt(np.mean((Y.std(axis=0) * size) ** 2)))
        return cls(X[:, :J].mean(axis=0), size, 1.0 / max(speed, 1e-9), energy / size)

    def motion(self, X: Array) -> Motion:
        """Of columns q, qd, qdd and, for all joints one after the other, each friction term (n, D)."""
        J = len(self.size)
        q, qd, qdd = (X[:, i * J : (i + 1) * J] for i in range(3))
        scaled = qd * (self.time / self.size)
        terms = [scaled, np.ones_like(qd), *np.split(X[:, 3 * J :], X.shape[1] // J - 3, axis=1)]
        pull = qdd * (self.time**2 / self.size)
        return Motion((q - self.centre) / self.size, scaled, pull, np.stack(terms, axis=2))


def lagrangian_network(setting: NetworkSetting, X: Array, Y: Array, rng: np.random.Generator) -> Predict:
    """What predicts commands (m, J) at (m, D), learned from X (n, D) and Y (n, J), by Adam.

    Args:
        setting: as for a network. X: columns q, qd, qdd of all joints, and friction terms (see `Scales`).
    """
    scales = Scales.of(X, Y)
    J, motion, target = Y.shape[1], scales.motion(X), Y / scales.force
    width = min(setting.width, WIDE)
    weights = [
        (W.astype(float), b.astype(float)) for W, b in first_weights((J, width, width, outputs(J)), rng)
    ]
    friction = np.zeros(motion.friction.shape[1:])
    spread = target.std(axis=0)
    values = [*(w for layer in weights for w in layer), friction]

    def slopes(rows: Index) -> Sequence[Array]:
        return loss_gradient(weights, friction, motion.take(rows), target[rows], spread, setting.decay)[1]

    by_adam(values, slopes, len(X), setting.rate, rng)
    return lambda new: scales.force * forces(weights, friction, scales.motion(new))


def outputs(joints: int) -> int:
    """Of the network: a lower triangle and V."""
    return joints * (joints + 1) // 2 + 1


def forces(weights: Weights, friction: Array, motion: Motion) -> Array:
    """(n, J) scaled forces."""
    rigid = _lagrange(motion, *_energies(_layers(weights, motion.q), motion.q.shape[1]))
    return np.asarray(rigid + np.einsum("njf,jf->nj", motion.friction, friction))


def loss_gradient(
    weights: Weights, friction: Array, motion: Motion, target: Array, spread: Array, decay: float
) -> tuple[float, list[Array]]:
    """Half the mean squared error in units of `spread` (J,) plus half the decay of all matrices; its gradient
    in every W, b, one after the other, and in the friction.
    """
    J = motion.q.shape[1]
    activations = _layers(weights, motion.q)
    L, dL, H, dV = _energies(activations, J)
    predicted = _lagrange(motion, L, dL, H, dV) + np.einsum("njf,jf->nj", motion.friction, friction)
    wrong = (predicted - target) / spread
    loss = 0.5 * float(np.mean(wrong**2)) + 0.5 * decay * sum(float(np.sum(W**2)) for W, _ in weights)
    e = wrong / spread / wrong.size
    in_L, in_dL = _through_inertia(e, motion, L, dL)
    rows, columns = np.tril_indices(J)
    slope = np.concatenate([in_L[:, rows, columns], np.zeros((len(e), 1))], axis=1)
    slopes = np.concatenate([in_dL[:, :, rows, columns], e.T[:, :, None]], axis=2)
    gradients = [part for layer in _back(weights, activations, slope, slopes, decay) for part in layer]
    return loss, [*gradients, np.einsum("nj,njf->jf", e, motion.friction)]


def _layers(weights: Weights, q: Array) -> list[tuple[Array, Array, Array]]:
    """Of inputs and every layer: values (n, w), derivatives in each coordinate (J, n, w), and those before
    tanh.
    """
    J = q.shape[1]
    seed = np.broadcast_to(np.eye(J)[:, None, :], (J, len(q), J))
    activations = [(q, seed, seed)]
    for place, (W, b) in enumerate(weights, start=1):
        value, slope = activations[-1][0] @ W + b, activations[-1][1] @ W
        if place == len(weights):
            activations.append((value, slope, slope))
        else:
            value = np.tanh(value)
            activations.append((value, slope * (1.0 - value**2), slope))
    return activations


def _energies(activations: list[tuple[Array, Array, Array]], J: int) -> tuple[Array, Array, Array, Array]:
    """L (n, J, J), dL (J, n, J, J), H (n, J, J) and dV (J, n)."""
    value, slope, _ = activations[-1]
    rows, columns = np.tril_indices(J)
    L, dL = np.zeros((len(value), J, J)), np.zeros((J, len(value), J, J))
    L[:, rows, columns], dL[:, :, rows, columns] = value[:, :-1], slope[:, :, :-1]
    return L, dL, L @ L.transpose(0, 2, 1) + LEAST_INERTIA * np.eye(J), slope[:, :, -1]


def _lagrange(motion: Motion, L: Array, dL: Array, H: Array, dV: Array) -> Array:
    """(n, J) forces without friction."""
    turned = np.einsum("nba,nb->na", L, motion.qd)  # L' qd
    # d_k H qd = d_k L L' qd + L d_k L' qd
    slopes = np.einsum("knab,nb->kna", dL, turned) + np.einsum(
        "nab,kncb,nc->kna", L, dL, motion.qd, optimize=True
    )
    along = np.einsum("nk,kna->na", motion.qd, slopes)
    return np.asarray(
        np.einsum("nab,nb->na", H, motion.qdd)
        + along
        - 0.5 * np.einsum("na,kna->nk", motion.qd, slopes)
        + dV.T
    )


def _through_inertia(e: Array, motion: Motion, L: Array, dL: Array) -> tuple[Array, Array]:
    """Gradients of sum(e * forces) in L (n, J, J) and dL (J, n, J, J).

    The forces are linear in H and d_k H: sum(e * forces) = <A, H> + sum_k <P_k, d_k H> with
    A = sym(e qdd') and P_k = qd_k sym(e qd') - e_k qd qd' / 2.
    """
    A, both = _symmetric(e, motion.qdd), _symmetric(e, motion.qd)
    square = np.einsum("na,nb->nab", motion.qd, motion.qd)
    P = np.einsum("nk,nab->knab", motion.qd, both) - 0.5 * np.einsum("nk,nab->knab", e, square)
    return 2.0 * (A @ L + (P @ dL).sum(axis=0)), 2.0 * P @ L


def _symmetric(a: Array, b: Array) -> Array:
    outer = np.einsum("na,nb->nab", a, b)
    return np.asarray(0.5 * (outer + outer.transpose(0, 2, 1)))


def _back(
    weights: Weights, activations: list[tuple[Array, Array, Array]], slope: Array, slopes: Array, decay: float
) -> list[tuple[Array, Array]]:
    """Gradients in each W and b from those in the outputs (n, w) and in their derivatives (J, n, w)."""
    gradients = []
    for place in range(len(weights) - 1, -1, -1):
        W, (below, tangents, before) = weights[place][0], activations[place]
        in_W = below.T @ slope + np.einsum("kni,kno->io", tangents, slopes, optimize=True) + decay * W
        gradients.append((in_W, slope.sum(axis=0)))
        if place:
            bend = 1.0 - below**2
            onto, ahead = slope @ W.T, slopes @ W.T
            slope = bend * (onto - 2.0 * below * (ahead * before).sum(axis=0))
            slopes = bend * ahead
    return gradients[::-1]
