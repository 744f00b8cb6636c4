"""One rigid body for all commands: where they are forces, a link has the same inertia in each of them.

    command_j = [M(q)^-T Y(q, qd, qdd)]_j (phi_0 + D z) + X_j e_j,    z ~ N(0, 1),  e_j ~ N(0, extra prior)

phi_0 are the model file's parameters, D the directions that motion reveals, X_j the drive's own terms. All
commands are one least squares problem in z and e_1 .. e_J, each weighted by its noise. What a joint's own
torque hardly shows, the torques of the joints before it do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDS = 6
"""Of noise and parameters in turn; the noise changes by less than a part in a thousand after four."""
LEAST_NOISE, MOST_NOISE = 1e-4, 0.1
"""Of the command limit: between them the noise deviation is looked for."""


@dataclass(frozen=True)
class OutputColumns:
    """What one command says, at the n samples in which its joint moves.

    Attributes:
        rigid: (n, r) regressors of the rigid body along the directions D. extra: (n, E) X of the drive.
        left: (n,) command less what phi_0 explains.
        deviations: (E,) prior deviations of the drive's terms.
        noise: deviation to begin with, command units.
    """

    rigid: Array
    extra: Array
    left: Array
    deviations: Array
    noise: float


@dataclass(frozen=True)
class SharedFit:
    """z (r,) of all commands, extra (J, E) of the drives with posterior deviations (J, E), noise (J,)."""

    z: Array
    extra: Array
    spread: Array
    noise: Array


def shared_fit(outputs: Sequence[OutputColumns], weight: float, limits: Array) -> SharedFit:
    """Maximum a posteriori z and e, the noise of each command from its own residual.

    Args:
        weight: of one sample against the prior. limits: (J,) command limits.
    """
    r = outputs[0].rigid.shape[1]
    squares = [np.concatenate([o.rigid, o.extra, o.left[:, None]], axis=1) for o in outputs]
    grams = [weight * rows.T @ rows for rows in squares]
    noise = np.array([o.noise for o in outputs])
    for _ in range(ROUNDS):
        x, covariance = _solved(grams, outputs, noise, r)
        extra = x[r:].reshape(len(outputs), -1)
        counts = weight * np.array([len(o.left) for o in outputs])
        left = np.array(
            [_residual(gram, np.append(x[:r], own)) for gram, own in zip(grams, extra, strict=True)]
        )
        noise = np.sqrt(left / np.maximum(counts, 1.0))
        noise = np.clip(noise, LEAST_NOISE * limits, MOST_NOISE * limits)
    spread = np.sqrt(np.maximum(covariance.diagonal()[r:], 0.0)).reshape(extra.shape)
    return SharedFit(x[:r], extra, spread, noise)


def _solved(
    grams: Sequence[Array], outputs: Sequence[OutputColumns], noise: Array, r: int
) -> tuple[Array, Array]:
    """Means and covariance of (z, e_1 .. e_J), scaled by the prior so that the matrix is well conditioned."""
    E = len(outputs[0].deviations)
    scale = np.concatenate([np.ones(r), *(o.deviations for o in outputs)])
    A, b = np.zeros((len(scale), len(scale))), np.zeros(len(scale))
    for j, gram in enumerate(grams):
        place = np.concatenate([np.arange(r), r + j * E + np.arange(E)])
        A[np.ix_(place, place)] += gram[:-1, :-1] / noise[j] ** 2
        b[place] += gram[:-1, -1] / noise[j] ** 2
    inverse: Array = np.linalg.inv(A * np.outer(scale, scale) + np.eye(len(scale))).astype(np.float64)
    return scale * (inverse @ (scale * b)), inverse * np.outer(scale, scale)


def _residual(gram: Array, x: Array) -> float:
    """Weighted sum of squares of what x (r + E,) leaves of the last column."""
    with_left = np.append(-x, 1.0)
    return max(float(with_left @ gram @ with_left), 0.0)
