"""Estimate of friction from logs of a robot without known masses.

Gravity, inertia and centrifugal forces are even in the speeds, friction is odd. A motion that passes a pose
in both directions separates them.

    command_j = even_j(q, qd, qdd) + viscous qd_j + [coulomb + stribeck exp(-(qd_j / v_s)^2)] tanh(qd_j / v0)

The even part is a Gaussian process. The forces of a chain are sums of products of 1, sin q_i, cos q_i;
accelerations and squared speeds are multiplied by products of second degree. Cogging is periodic in the
joint's position. The scales of the parts maximise the marginal likelihood. Friction by load and by direction
is partly even, so it cannot be identified.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.models.scatter import scattered
from etude.types import Array, Index, Mask, Samples
from etude_arm.identified.parameter_fit import (
    COULOMB,
    FASTEST_SHAPE,
    LEAST_STRETCH,
    LONGEST_STEP,
    SHAPE,
    SHAPE_ROUNDS,
    SLOWEST_SHAPE,
    STRIBECK,
    STRIBECK_SPEEDS,
    TERMS,
    TURNS,
    VISCOUS,
    Friction,
    savage_dickey,
    slopes_of_shape,
)
from etude_arm.physics.identification import steady
from etude_arm.spec import FIRST_WAVE, PATH, PLAN, RIPPLES, ArmSpec

LEAST, MOST = 30, 400
"""Least and largest number of moving samples of a joint; evenly drawn, since the cost is cubic."""
LEAST_TURNS = 10
"""Reversals of a joint below which no interval is stated: postures are then passed one way alone, and what a
posture takes is mistaken for friction."""
OWN = (VISCOUS, COULOMB, STRIBECK)
LARGEST = 0.3
"""Prior deviation of each term at full speed, as a part of the command limit."""
LEAST_LEVEL = 1e-3
"""Least friction of a joint as a part of the command limit, for the prior of stiction."""
STEPS = 40
"""Iterations of the search for the scales."""


@dataclass(frozen=True, eq=False)
class _Joint:
    """Data of one joint: t, group (n,), speed (n,), command (n,), and kernels of the even parts (K, n, n)."""

    t: Array
    group: Index
    speed: Array
    command: Array
    kernels: Array


def friction_alone(spec: ArmSpec, samples: Samples, v0: Array, *, desired: bool) -> Friction:
    """Of all joints.

    Args:
        v0: (J,) largest transition speed of friction, rad/s (m/s). desired: use the planned motion, not the
            measured one.
    """
    motion = tuple(samples.log[name] for name in (PLAN if desired else PATH))
    rows = steady(samples, motion[1])
    fits = [
        _fitted(_joint(spec, samples, motion, rows[:, j], j), float(v0[j]), spec, j) for j in range(spec.dof)
    ]
    friction = Friction(*(np.array(part) for part in zip(*fits, strict=True)))
    often = reversals(samples, motion[1]) >= LEAST_TURNS
    return replace(friction, deviation=np.where(often[:, None], friction.deviation, 0.0))


def reversals(samples: Samples, speed: Array) -> Index:
    """(J,) changes of the sign of each joint's speed (n, J) within logs."""
    turns = (np.diff(np.sign(speed), axis=0) != 0.0) & (np.diff(samples.group) == 0)[:, None]
    return np.asarray(turns.sum(axis=0))


def _joint(spec: ArmSpec, samples: Samples, motion: tuple[Array, ...], rows: Mask, j: int) -> _Joint:
    indices = np.flatnonzero(rows)
    indices = indices[np.unique(np.linspace(0, len(indices) - 1, min(len(indices), MOST)).astype(np.int64))]
    q, qd, qdd = (part[indices] for part in motion)
    hinge = np.array([axis.unit == "rad" for axis in spec.axes])
    apart = q[:, None] - q[None]
    near = np.where(hinge, 0.5 + 0.5 * np.cos(apart), np.exp(-0.5 * (apart / (spec.upper - spec.lower)) ** 2))
    posture = near.prod(axis=2)
    pull, speed = (part / scale for part, scale in ((qdd, spec.acceleration), (qd, spec.velocity)))
    turns = [np.cos(k * apart[..., j]) for k in range(FIRST_WAVE, FIRST_WAVE + RIPPLES)]
    kernels = [posture, (pull @ pull.T) * posture**2, (speed @ speed.T) ** 2 * posture**2]
    kernels += [np.mean(turns, axis=0)] if hinge[j] else []
    return _Joint(
        samples.t[indices], samples.group[indices], qd[:, j], samples.command[indices, j], np.array(kernels)
    )


def _fitted(joint: _Joint, widest: float, spec: ArmSpec, j: int) -> tuple[Array, Array, Array, float, float]:
    """Terms, deviations, evidence (E,), v_s and v0 of maximum likelihood."""
    estimates = np.zeros((3, len(TERMS)))
    if len(joint.t) < LEAST:
        return estimates[0], estimates[1], estimates[2], widest, widest
    size = float(spec.command[j])
    prior = LARGEST * size / np.array([spec.velocity[j], 1.0, 1.0])
    candidates = [(s * widest, t * widest) for t in TURNS for s in STRIBECK_SPEEDS]
    first = _columns(joint.speed, *candidates[0])
    sizes = _sizes(joint, first * prior, size)
    # prior: stiction exceeds sliding friction by about as much as sliding friction itself
    level, _ = _solved(first[:, :2], joint, _covariance(sizes, joint, size), prior[:2])
    prior[2] = max(abs(float(level[1])), LEAST_LEVEL * size)
    V = _covariance(sizes, joint, size)
    evidence = np.zeros(3)
    for terms in (3, 2):
        columns = [(_columns(joint.speed, *speeds) * prior)[:, :terms] for speeds in candidates]
        losses = [_loss(sizes, joint, H, size)[0] for H in columns]
        start = np.array(candidates[int(np.argmin(losses))])
        value, deviation, speeds = _with_shape(joint, V, prior[:terms], start, widest)
        evidence[:terms] = savage_dickey(value, deviation, prior[:terms])
        # a dip below zero would stand for a wider v0
        if value[-1] > 0.0:
            break
    estimates[0, OWN[:terms]], estimates[1, OWN[:terms]], estimates[2, OWN] = value, deviation, evidence
    return estimates[0], estimates[1], estimates[2], float(speeds[0]), float(speeds[1])


def _with_shape(
    joint: _Joint, V: Array, prior: Array, start: Array, widest: float
) -> tuple[Array, Array, Array]:
    """The first terms of OWN, as many as `prior` has, their deviations, and (2,) v_s and v0."""
    terms, speeds = len(prior), start
    value, deviation = _solved(_columns(joint.speed, *start)[:, :terms], joint, V, prior)
    for _ in range(SHAPE_ROUNDS):
        slow, v0 = speeds
        dip = np.asarray(value[2] if terms == 3 else 0.0)
        level = value[1] + dip * np.exp(-((joint.speed / slow) ** 2))
        slopes = slopes_of_shape(joint.speed, slow, v0, level, dip)
        H = np.column_stack([_columns(joint.speed, slow, v0)[:, :terms], slopes])
        value, deviation = _solved(H, joint, V, np.append(prior, [SHAPE, SHAPE]))
        step = np.clip(value[-2:], -LONGEST_STEP, LONGEST_STEP)
        bounds = widest * np.array([SLOWEST_SHAPE, FASTEST_SHAPE])
        speeds = np.clip(speeds * np.exp(step), *bounds)
    return value[:terms], deviation[:terms], speeds


def _columns(speed: Array, slow: float, v0: float) -> Array:
    """(n, 3) of OWN."""
    sign = np.tanh(speed / v0)
    return np.column_stack([speed, sign, sign * np.exp(-((speed / slow) ** 2))])


def _sizes(joint: _Joint, H: Array, size: float) -> Array:
    """(K + 1,) logarithms of the deviations of the parts and of the noise, in parts of the command limit."""
    from scipy.optimize import minimize

    start = np.log(np.append(np.full(len(joint.kernels), 0.1), 0.01))
    bounds = [(-12.0, 2.0)] * len(start)
    minimum = minimize(
        _loss, start, (joint, H, size), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": STEPS}
    )
    return np.asarray(minimum.x)


def _covariance(sizes: Array, joint: _Joint, size: float) -> Array:
    parts = size**2 * np.exp(2.0 * sizes)
    return np.asarray(np.tensordot(parts[:-1], joint.kernels, 1) + parts[-1] * np.eye(len(joint.command)))


def _loss(sizes: Array, joint: _Joint, H: Array, size: float) -> tuple[float, Array]:
    """Minus the logarithm of the marginal likelihood, and its gradient; H (n, p) by its prior deviations."""
    V = _covariance(sizes, joint, size) + H @ H.T
    inverse = np.linalg.inv(V)
    weights = inverse @ joint.command
    value = 0.5 * (joint.command @ weights + np.linalg.slogdet(V)[1])
    change = 0.5 * (inverse - np.outer(weights, weights))
    parts = 2.0 * size**2 * np.exp(2.0 * sizes)
    slope = np.append(np.einsum("ij,kij->k", change, joint.kernels), np.trace(change))
    return float(value), parts * slope


def _solved(H: Array, joint: _Joint, V: Array, prior: Array) -> tuple[Array, Array]:
    """(p,) generalised least squares, and deviations by the scatter of the score between stretches of log."""
    # whitened in time order, so that stretches are independent
    root = np.linalg.cholesky(V)
    rows, whitened = np.linalg.solve(root, H), np.linalg.solve(root, joint.command)
    posterior = np.linalg.inv(rows.T @ rows + np.diag(prior**-2))
    value = posterior @ rows.T @ whitened
    _, stretch = np.unique(joint.group * 10.0**6 + np.floor(joint.t / LEAST_STRETCH), return_inverse=True)
    scores = np.zeros((stretch.max() + 1, len(value)))
    np.add.at(scores, stretch, (whitened - rows @ value)[:, None] * rows)
    return value, np.sqrt(scattered(posterior, prior, scores, 1.0).diagonal())
