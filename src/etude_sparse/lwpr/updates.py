"""The compiled core of LWPR: one sample after the other through the receptive fields it activates.

Equation numbers and tables are those of Vijayakumar, D'Souza and Schaal 2005, "Incremental online learning in
high dimensions". A field k weighs a sample by w = exp(-|M (x - c)|²/2), so its metric is D = MᵀM. Its local
model is partial least squares of the weighted samples, one direction after the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from etude._runtime.compilation import compiled, compiled_part
from etude.types import Array, Index

TINY = 1e-10
"""Start of every sum that is divided by."""
LEAST_FREE = 0.1
"""Least 1 - h: the leave-one-out error is at most ten times the residual."""
LARGEST_STEP = 0.1
"""A gradient step that would change M by more than this part of it halves the rate instead."""
DONE, FULL = 0, 1  # why an update ended


class Fields(NamedTuple):
    """The receptive fields in arrays with room for K of them, up to R directions and D inputs.

    All sums are weighted by w and forgotten with `forget`.

    Attributes:
        used: (1,) fields in use.
        c: (K, D) centres; M: (K, D, D) upper triangular factors of the metrics, diagonal unless learned full.
        seen: (K,) samples absorbed; added: (K,) of them, before the newest direction was added.
        r: (K,) directions in use, the newest included. rate: (K,) of the metric's gradient steps.
        forget: (K,) forgetting factor. W: (K,) sum of weights.
        x0: (K, D), y0: (K,) weighted means.
        u: (K, R, D) sums of w z res, the directions; SZ: (K, R, D) of w z s.
        SS, SR: (K, R) sums of w s², w s res. Q: (K, R + 1) of w res² before each direction and after the
        last, WQ: (K, R + 1) the weights in these.
        H: (K, R), G: (K, R) memory of the metric's gradient, the paper's H and R.
        E: (K,) sum of w e_cv²; E0: (K,) of w e². freedom: (K,) of w h, the degrees of freedom used.
    """

    used: Index
    c: Array
    M: Array
    seen: Index
    added: Index
    r: Index
    rate: Array
    forget: Array
    W: Array
    x0: Array
    y0: Array
    u: Array
    SZ: Array
    SS: Array
    SR: Array
    Q: Array
    WQ: Array
    H: Array
    G: Array
    E: Array
    E0: Array
    freedom: Array


class Rule(NamedTuple):
    """Numbers of the algorithm; see `regression.LWPR`."""

    generate: float
    prune: float
    active: float
    add: float
    penalty: float
    rate: float
    forget: float
    forget_last: float
    annealing: float
    full: bool


@compiled_part
def activation(fields: Fields, k: int, x: Array, full: bool) -> float:
    """w of field k at x."""
    distance = 0.0
    for i in range(len(x)):
        along = fields.M[k, i, i] * (x[i] - fields.c[k, i])
        if full:
            for j in range(i + 1, len(x)):
                along += fields.M[k, i, j] * (x[j] - fields.c[k, j])
        distance += along * along
    w: float = np.exp(-0.5 * distance)
    return w


@compiled_part
def _generate(fields: Fields, x: Array, M: Array, rule: Rule) -> int:
    """A new field at x with metric MᵀM and two directions (table 3)."""
    D = len(x)
    k: int = fields.used[0]
    for i in range(D):
        fields.c[k, i] = x[i]
        for j in range(D):
            fields.M[k, i, j] = M[i, j]
    fields.seen[k] = fields.added[k] = 0
    fields.r[k] = min(2, D)
    fields.rate[k], fields.forget[k] = rule.rate, rule.forget
    fields.W[k] = fields.y0[k] = fields.E[k] = fields.E0[k] = fields.freedom[k] = 0.0
    fields.x0[k] = 0.0
    for table in (fields.SS, fields.WQ):
        table[k] = TINY
    for table in (fields.SR, fields.Q, fields.H, fields.G):
        table[k] = 0.0
    fields.u[k] = 0.0
    fields.SZ[k] = 0.0
    fields.used[0] = k + 1
    return k


@compiled_part
def _remove(fields: Fields, k: int) -> None:
    """The last field takes the place of field k; by loops, see `dictionary_updates`."""
    last = fields.used[0] - 1
    for block in (fields.M, fields.u, fields.SZ):
        for i in range(block.shape[1]):
            for j in range(block.shape[2]):
                block[k, i, j] = block[last, i, j]
    for table in (fields.c, fields.x0, fields.SS, fields.SR, fields.Q, fields.WQ, fields.H, fields.G):
        for i in range(table.shape[1]):
            table[k, i] = table[last, i]
    for column in (fields.rate, fields.forget, fields.W, fields.y0, fields.E, fields.E0, fields.freedom):
        column[k] = column[last]
    for counter in (fields.seen, fields.added, fields.r):
        counter[k] = counter[last]
    fields.used[0] = last


@compiled_part
def _project(fields: Fields, k: int, x: Array, y: float, w: float, z: Array, s: Array) -> float:
    """Incremental partial least squares with forgetting (table 2); returns the residual, fills s (r,)."""
    D, keep = len(x), fields.forget[k]
    total = keep * fields.W[k] + w
    for d in range(D):
        fields.x0[k, d] += w * (x[d] - fields.x0[k, d]) / total
        z[d] = x[d] - fields.x0[k, d]
    fields.y0[k] += w * (y - fields.y0[k]) / total
    fields.W[k] = total
    residual: float = y - fields.y0[k]
    for i in range(fields.r[k]):
        fields.Q[k, i] = keep * fields.Q[k, i] + w * residual * residual
        fields.WQ[k, i] = keep * fields.WQ[k, i] + w
        u, SZ = fields.u[k, i], fields.SZ[k, i]
        length, score = 0.0, 0.0
        for d in range(D):
            u[d] = keep * u[d] + w * z[d] * residual
            length += u[d] * u[d]
            score += z[d] * u[d]
        score = score / np.sqrt(length) if length > 0.0 else 0.0
        fields.SS[k, i] = keep * fields.SS[k, i] + w * score * score
        fields.SR[k, i] = keep * fields.SR[k, i] + w * score * residual
        SS = max(fields.SS[k, i], TINY)
        for d in range(D):
            SZ[d] = keep * SZ[d] + w * z[d] * score
            z[d] -= score * SZ[d] / SS
        residual -= score * fields.SR[k, i] / SS
        s[i] = score
    i = fields.r[k]
    fields.Q[k, i] = keep * fields.Q[k, i] + w * residual * residual
    fields.WQ[k, i] = keep * fields.WQ[k, i] + w
    return residual


@compiled_part
def _weight_gradient(fields: Fields, k: int, w: float, e: float, s: Array) -> float:
    """d J1 / d w of the leave-one-out cost (eq. 12), and its memory brought up to date.

    More weight on this sample counts its error and reduces the share of the others. It also moves the
    regression, which changes their residuals (H) and their influence on themselves (G).
    """
    keep, used = fields.forget[k], 0.0
    for i in range(fields.r[k]):
        used += w * s[i] * s[i] / max(fields.SS[k, i], TINY)
    free = max(1.0 - used, LEAST_FREE)
    e_cv = e / free
    weighted = w * e_cv * e_cv
    fields.E[k] = keep * fields.E[k] + weighted
    fields.E0[k] = keep * fields.E0[k] + w * e * e
    fields.freedom[k] = keep * fields.freedom[k] + w * used
    W = fields.W[k]
    slope: float = e_cv * e_cv / W - fields.E[k] / (W * W)
    for i in range(fields.r[k]):
        SS = max(fields.SS[k, i], TINY)
        slope -= 2.0 / W * (s[i] / SS * e * fields.H[k, i] + (s[i] / SS) ** 2 * fields.G[k, i])
        fields.H[k, i] = keep * fields.H[k, i] + w * e_cv * s[i] / free
        fields.G[k, i] = keep * fields.G[k, i] + w * weighted * s[i] * s[i] / free
    return slope


@compiled_part
def _learn_metric(fields: Fields, k: int, x: Array, w: float, slope: float, rule: Rule, work: Array) -> None:
    """One stochastic gradient step of M (eq. 11): leave-one-out cost and the penalty sum(D²) / inputs.

    Early on, while the leave-one-out error far exceeds the residual, the step is small.
    """
    D, M, W = len(x), fields.M[k], fields.W[k]
    rate = fields.rate[k] * min(1.0, (fields.E0[k] / (fields.E[k] + TINY)) ** 4)
    largest, change = 0.0, 0.0
    delta, metric = work[0], work[1 : 1 + D]
    for d in range(D):
        delta[d] = x[d] - fields.c[k, d]
    for i in range(D):  # D = MᵀM
        for j in range(D if rule.full else 0):
            metric[i, j] = 0.0
            for h in range(min(i, j) + 1):
                metric[i, j] += M[h, i] * M[h, j]
    steps = work[1 + D : 1 + 2 * D]
    for i in range(D):
        along = M[i, i] * delta[i]
        if rule.full:
            for j in range(i + 1, D):
                along += M[i, j] * delta[j]
        for j in range(i, D if rule.full else i + 1):
            flat = M[i, i] ** 3
            if rule.full:
                flat = 0.0
                for h in range(i, D):
                    flat += M[i, h] * metric[h, j]
            gradient = -w * along * delta[j] * slope + w / W * 4.0 * rule.penalty / D * flat
            steps[i, j] = rate * gradient
            change = max(change, abs(steps[i, j]))
            largest = max(largest, abs(M[i, j]))
    if not change <= LARGEST_STEP * largest:
        fields.rate[k] *= 0.5
        return
    for i in range(D):
        for j in range(i, D if rule.full else i + 1):
            M[i, j] -= steps[i, j]


@compiled_part
def _add_direction(fields: Fields, k: int, rule: Rule) -> None:
    """One direction more if the newest reduced the error enough, and was given the samples to show it."""
    r, D = fields.r[k], fields.c.shape[1]
    if r >= fields.SS.shape[1] or fields.seen[k] - fields.added[k] <= 2 * D:
        return
    before, after = fields.Q[k, r - 1] / fields.WQ[k, r - 1], fields.Q[k, r] / fields.WQ[k, r]
    if after < rule.add * before:
        fields.r[k] = r + 1
        fields.added[k] = fields.seen[k]
        fields.Q[k, r + 1], fields.WQ[k, r + 1] = 0.0, TINY


@compiled_part
def _update(fields: Fields, k: int, x: Array, y: float, w: float, rule: Rule, work: Array) -> None:
    """Field k absorbs a sample of weight w."""
    s = work[1 + 2 * len(x)]
    e = _project(fields, k, x, y, w, work[0], s)
    slope = _weight_gradient(fields, k, w, e, s)
    fields.seen[k] += 1
    if fields.seen[k] > 2 * len(x) and rule.rate > 0.0:
        _learn_metric(fields, k, x, w, slope, rule, work)
    _add_direction(fields, k, rule)
    fields.forget[k] = rule.annealing * fields.forget[k] + (1.0 - rule.annealing) * rule.forget_last


@compiled
def absorb(
    fields: Fields, X: Array, y: Array, order: Index, first: int, M: Array, rule: Rule, work: Array
) -> tuple[int, int]:
    """Samples X[order[first:]] one after the other (table 3); M is a new field's metric factor.

    Returns the number of samples dealt with and DONE, or FULL where a new field finds no room.
    `work` is (2 D + 2, D), to write on.
    """
    for n in range(first, len(order)):
        if fields.used[0] >= len(fields.c):
            return n, FULL
        x, target = X[order[n]], y[order[n]]
        best = second = fields.used[0]  # none so far; a literal would compile `_remove` twice
        top, next_top = 0.0, 0.0
        for k in range(fields.used[0]):
            w = activation(fields, k, x, rule.full)
            if w > top:
                second, next_top, best, top = best, top, k, w
            elif w > next_top:
                second, next_top = k, w
            if w > rule.active:
                _update(fields, k, x, target, w, rule, work)
        if top <= rule.generate:
            k = _generate(fields, x, M, rule)
            _update(fields, k, x, target, 1.0, rule, work)
        elif next_top > rule.prune:
            worse = fields.E[best] / fields.W[best] > fields.E[second] / fields.W[second]
            _remove(fields, best if worse else second)
    return len(order), DONE
