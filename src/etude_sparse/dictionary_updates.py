"""The compiled core of a dictionary: candidates one after the other, rank-1 insertions and rank-2 swaps.

With A = k(D, D) + d I over the dictionary D, everything follows from P = A^-1 and alpha = P y. For a
candidate x with k = k(x, D), a = P k and variance delta = k(x, x) + d - k·a (thesis 2.7 with the diagonal d):

* member i given all other members: variance 1 / P_ii, error alpha_i / P_ii;
* candidate given the members without i: variance delta + a_i² / P_ii, error e + a_i alpha_i / P_ii;
* swap of i for x: det A grows by the factor (delta + a_i² / P_ii) P_ii.

So a candidate costs one product P k, and a swap one step of refinement and one pass over P. All compiled
code is in this file because numba's cache watches only the file of the function it stores. Rows are copied by
loops: an assignment of arrays compiles the text of its error too, which takes a second.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from etude._runtime.compilation import compiled, compiled_part
from etude.types import Array, Index

VARIANCE, ERROR, GUARDED_ERROR = 0, 1, 2  # rules of insertion
DONE, REFRESH_DUE, PIVOT_LOST = 0, 1, 2  # why an update ended


class Members(NamedTuple):
    """The dictionary, in arrays of its full size u; the first counts[0] slots are in use.

    Attributes:
        X: (u, D) inputs; y, t, alpha: (u,); number: (u,) place of the member in the stream.
        A: (u, u) k(X, X) + d I; P: (u, u) its inverse.
        counts: (3,) members, replacements since the last refresh, replacements.
        log_det: (1,) log det A.
    """

    X: Array
    y: Array
    t: Array
    alpha: Array
    number: Index
    A: Array
    P: Array
    counts: Index
    log_det: Array


class Candidates(NamedTuple):
    """A block of b candidates and their prior covariances.

    Attributes:
        X: (b, D); y, t: (b,); number: (b,) place in the stream.
        rows: (b, m) covariances with the m members at the start of the block.
        own: (b, b) covariances with each other; prior: (b,) k(x, x).
        taken: (u,) which candidate of this block sits in a slot, -1 for none.
    """

    X: Array
    y: Array
    t: Array
    number: Index
    rows: Array
    own: Array
    prior: Array
    taken: Index


class Rule(NamedTuple):
    """Numbers of the selection rule; see `dictionary.DictionaryConfig`.

    Attributes:
        kind: VARIANCE, ERROR or GUARDED_ERROR.
        guard: standardised error above which a point counts as an outlier.
        novelty, error: least variance beyond d, least absolute error of a candidate.
        gain: part by which a swap has to raise the score.
        decay: rate 1/s of the age weight, 0 for none.
        diagonal: d. refresh_every: replacements between two refreshes.
    """

    kind: int
    guard: float
    novelty: float
    error: float
    gain: float
    decay: float
    diagonal: float
    refresh_every: int


@compiled_part
def _product(P: Array, k: Array, n: int, a: Array) -> None:
    """a = P k, as sums of rows: P is symmetric, and sums of rows vectorise without reordering a reduction."""
    for j in range(n):
        a[j] = 0.0
    paired = n - n % 4
    for i in range(0, paired, 4):
        k0, k1, k2, k3 = k[i], k[i + 1], k[i + 2], k[i + 3]
        r0, r1, r2, r3 = P[i], P[i + 1], P[i + 2], P[i + 3]
        for j in range(n):
            a[j] += k0 * r0[j] + k1 * r1[j] + k2 * r2[j] + k3 * r3[j]
    for i in range(paired, n):
        k0, r0 = k[i], P[i]
        for j in range(n):
            a[j] += k0 * r0[j]


@compiled_part
def _refine(members: Members, right: Array, solution: Array, residual: Array, step: Array) -> None:
    """One step of iterative refinement of A solution = right.

    A product with P alone leaves a residual of the condition number times rounding. An update then divides it
    by a variance near d; this, not the number of updates, spoils P.
    """
    n = members.counts[0]
    _product(members.A, solution, n, residual)
    for j in range(n):
        residual[j] = right[j] - residual[j]
    _product(members.P, residual, n, step)
    for j in range(n):
        solution[j] += step[j]


@compiled_part
def _score(kind: int, guard: float, diagonal: float, error: float, variance: float) -> float:
    """What a point is worth, from its error and variance (d included) given the others.

    Guarded error: v (1 + g v / (v + d)) with v the latent variance and g = z² up to guard², falling as guard⁴
    / z² beyond, z² = error² / (v + d). A large error raises the worth of a point only as far as data there
    can reduce it. An implausible error hardly raises it, and no point is worth less than its variance.
    """
    if kind == VARIANCE:
        return variance
    if kind == ERROR:
        return abs(error)
    latent = max(variance - diagonal, 0.0)
    z2 = error * error / variance
    if z2 > guard * guard:
        z2 = guard**4 / z2
    return latent * (1.0 + z2 * latent / variance)


@compiled_part
def _weakest(members: Members, rule: Rule, now: float) -> tuple[int, float]:
    """The member of least score weighted by age, and that score."""
    best, least = 0, np.inf
    for i in range(members.counts[0]):
        pivot = members.P[i, i]
        score = _score(rule.kind, rule.guard, rule.diagonal, members.alpha[i] / pivot, 1.0 / pivot)
        if rule.decay > 0.0:
            score *= np.exp(-rule.decay * max(now - members.t[i], 0.0))
        if score < least:
            best, least = i, score
    return best, least


@compiled_part
def _fill_slot(members: Members, block: Candidates, diagonal: float, slot: int, c: int, k: Array) -> None:
    """Candidate c takes a slot: its data, and its row and column of A."""
    n = members.counts[0]
    for j in range(n):
        members.A[slot, j] = k[j]
        members.A[j, slot] = k[j]
    members.A[slot, slot] = block.prior[c] + diagonal
    for d in range(members.X.shape[1]):
        members.X[slot, d] = block.X[c, d]
    members.y[slot] = block.y[c]
    members.t[slot] = block.t[c]
    members.number[slot] = block.number[c]
    block.taken[slot] = c


@compiled_part
def _insert(members: Members, a: Array, delta: float, error: float) -> None:
    """One more member: P grows by [a; -1][a; -1]ᵀ / delta."""
    n = members.counts[0]
    P, alpha = members.P, members.alpha
    root = np.sqrt(delta)
    for i in range(n):
        a[i] /= root
    a[n] = -1.0 / root
    for i in range(n + 1):
        P[i, n] = 0.0
        P[n, i] = 0.0
    alpha[n] = 0.0
    for i in range(n + 1):
        w, row = a[i], P[i]
        for j in range(n + 1):
            row[j] += w * a[j]
        alpha[i] -= w * error / root
    members.counts[0] = n + 1
    members.log_det[0] += np.log(delta)


@compiled_part
def _swap(members: Members, i: int, a: Array, p: Array, variance: float, error: float) -> None:
    """Member i leaves and the candidate takes its slot: P + w wᵀ - q qᵀ, symmetric to the last bit.

    `variance` and `error` are the candidate's given the members without i; a and p are used up.
    """
    n, P, alpha = members.counts[0], members.P, members.alpha
    pivot = P[i, i]
    share, left, root, root_pivot = a[i] / pivot, alpha[i] / pivot, np.sqrt(variance), np.sqrt(pivot)
    for j in range(n):
        p[j] = P[i, j]
    for j in range(n):
        a[j] = (a[j] - share * p[j]) / root
        alpha[j] -= p[j] * left + a[j] * error / root
        p[j] /= root_pivot
    a[i] = -1.0 / root
    alpha[i] = error / variance
    for r in range(n):
        w, q, row = a[r], p[r], P[r]
        for j in range(n):
            row[j] += w * a[j] - q * p[j]
    for j in range(n):
        P[i, j] = a[i] * a[j]
        P[j, i] = P[i, j]
    members.counts[1] += 1
    members.counts[2] += 1
    members.log_det[0] += np.log(variance * pivot)


@compiled_part
def _variance(block: Candidates, c: int, diagonal: float, k: Array, a: Array, n: int) -> float:
    """Of candidate c given all members, thesis (2.7) with the diagonal d."""
    delta: float = block.prior[c] + diagonal
    for j in range(n):
        delta -= k[j] * a[j]
    return delta


@compiled_part
def _exchange(
    members: Members, block: Candidates, rule: Rule, c: int, delta: float, error: float, work: Array
) -> bool:
    """Swap the weakest member for candidate c if that is worth more. False if the member's pivot is lost."""
    k, a, d, n = work[0], work[1], rule.diagonal, members.counts[0]
    i, least = _weakest(members, rule, block.t[c])
    pivot = members.P[i, i]
    if not 0.0 < pivot * d <= 2.0:
        return False
    least *= 1.0 + rule.gain
    scored_error = error if rule.kind == ERROR else error + a[i] * members.alpha[i] / pivot
    if not _score(rule.kind, rule.guard, d, scored_error, delta + a[i] * a[i] / pivot) > least:
        return True
    _refine(members, k, a, work[2], work[3])
    variance = _variance(block, c, d, k, a, n) + a[i] * a[i] / pivot
    remaining = error + a[i] * members.alpha[i] / pivot
    scored_error = error if rule.kind == ERROR else remaining
    if _score(rule.kind, rule.guard, d, scored_error, variance) > least:
        _swap(members, i, a, work[2], variance, remaining)
        _fill_slot(members, block, d, i, c, k)
    return True


@compiled
def stream(
    members: Members, block: Candidates, rule: Rule, first: int, skip: int, work: Array
) -> tuple[int, int]:
    """Offer the candidates from `first` on, in order; `work` is (4, u), to write on.

    Returns the number of candidates dealt with and DONE, or the first that was not and why: REFRESH_DUE, or
    PIVOT_LOST if a variance fell below half of d, which only accumulated rounding can do. Candidate `skip` is
    passed over if that happens to it.
    """
    k, a, d = work[0], work[1], rule.diagonal
    for c in range(first, len(block.y)):
        if members.counts[1] >= rule.refresh_every:
            return c, REFRESH_DUE
        n = members.counts[0]
        for j in range(n):
            k[j] = block.rows[c, j] if block.taken[j] < 0 else block.own[c, block.taken[j]]
        _product(members.P, k, n, a)
        delta, error = _variance(block, c, d, k, a, n), block.y[c]
        for j in range(n):
            error -= k[j] * members.alpha[j]
        sound = delta >= 0.5 * d
        if sound and (delta - d < rule.novelty or abs(error) < rule.error):
            continue
        if sound and n < len(members.y):
            _refine(members, k, a, work[2], work[3])
            _insert(members, a, max(_variance(block, c, d, k, a, n), d), error)
            _fill_slot(members, block, d, n, c, k)
        elif sound:
            sound = _exchange(members, block, rule, c, delta, error, work)
        if not sound and c != skip:
            return c, PIVOT_LOST
    return len(block.y), DONE
