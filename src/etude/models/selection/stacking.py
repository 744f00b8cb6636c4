"""Stacking: weights that minimise the candidates' average error on logs left out of training.

Each log has a noise level of its own, as the likelihood of normal errors says whose variances are unknown:

    w = argmin over w >= 0, sum w = 1 of  sum_g N_g log(mse_g(w) + FLOOR m),

m the median over logs of the least error of a candidate. Without these levels one log of large errors decides
alone. The other commands of the robot add their logs, which together count as much as `OTHERS` of the
command's own: what predicts one joint on new motion tends to predict the next one. A sample counts the less
the more all candidates err there (`HARD`): near a reversal filters smear friction, which no law repeats.

Stacked generalisation: Wolpert, Neural Networks 5 (1992); Breiman, Machine Learning 24 (1996).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.models.data.fit_data import Folds
from etude.models.selection.candidate_errors import CandidateErrors, mixed, of_command
from etude.models.selection.width import LEAST_LOGS, LEAST_ROWS
from etude.types import Array, Index, Mask

OTHERS = 2.0
"""Own logs that those of all other commands count as together."""
FLOOR = 0.05
"""Of the median error, added to that of each log: one that is easy does not decide alone."""
HARD = 16.0
"""Median square of all candidates at a sample, in that of a usual one, at which it counts half."""
FAR_WORSE = 4.0
"""Mean square of a candidate over the best one's, geometric mean over logs, from which it takes no part."""
PASSES = 8
"""Of least squares with the noise levels that the weights before gave."""
SHRINK = 0.5
"""Part of the weights that the best single candidate gets at two logs, where each weight rests on one."""
PRUNED = 0.05
"""Weight below which a candidate is left out: it costs as much time in every use as one of large weight."""


def is_stacked(folds: Folds) -> bool:
    """Whether candidates are combined so: several may be, and there is a log to leave out."""
    config = folds.config
    return config.rung == "auto" and config.stacks and folds.trajectories >= LEAST_LOGS


@dataclass(frozen=True, eq=False)
class Stack:
    """Weights of all K candidates of a model for one command, 0 of those that do not predict it.

    Attributes:
        weights: (K,), their sum 1.
        without: by number of a log, the weights (K,) that did not see it.
    """

    weights: Array
    without: dict[int, Array]


@dataclass(frozen=True, eq=False)
class Moments:
    """Errors of C candidates in one command, on samples that all of them predicted.

    Attributes:
        keys: (C,) structure and name of each. places: (C,) of each among all candidates.
        logs: (G,) numbers. grams: (G, C, C) mean products of errors, in units of the best one's median
            square. counts: (G,) samples.
    """

    keys: tuple[tuple[str, str], ...]
    places: Index
    logs: tuple[int, ...]
    grams: Array
    counts: Array

    @staticmethod
    def of(every: Sequence[CandidateErrors], j: int, fold: Index) -> Moments | None:
        """Of command j; None where fewer than two logs say something."""
        members, error, _ = of_command(every, j)
        there = np.isfinite(error).any(axis=1)
        places, error = np.array(members)[there], error[there]
        finite: Mask = np.asarray(np.isfinite(error).all(axis=0))
        logs = [g for g in np.unique(fold[finite]).tolist() if np.sum(finite & (fold == g)) >= LEAST_ROWS]
        if len(logs) < LEAST_LOGS:
            return None
        rows = [error[:, finite & (fold == g)] for g in logs]
        hard = np.median(error[:, finite] ** 2, axis=0)
        usual = max(HARD * float(np.median(hard)), float(np.finfo(float).tiny))
        grams = np.stack([_mean_products(log_errors, usual) for log_errors in rows])
        level = float(np.median(np.einsum("gcc->gc", grams).min(axis=1)))
        unit = max(level, float(np.finfo(float).tiny))
        counts = np.array([log_errors.shape[1] for log_errors in rows], dtype=float)
        return Moments(tuple(every[k].key for k in places), places, tuple(logs), grams / unit, counts)

    def of_keys(self, keys: Sequence[tuple[str, str]]) -> Array:
        """(G, c, c) of some candidates."""
        places = [self.keys.index(key) for key in keys]
        return self.grams[:, places][:, :, places]


def stacks(folds: Folds, every: Sequence[CandidateErrors]) -> dict[int, Stack]:
    """By command its stack, where there is one."""
    if not is_stacked(folds):
        return {}
    by_command = {j: Moments.of(every, j, folds.fold) for j in range(len(folds.commands))}
    present = {j: moments for j, moments in by_command.items() if moments is not None}
    return {
        j: stacked(moments, [present[i] for i in present if i != j], len(every))
        for j, moments in present.items()
    }


def stacked(moments: Moments, others: Sequence[Moments], count: int) -> Stack:
    """The stack of one of `count` candidates' commands; others: of the other commands."""
    beside = [other for other in others if set(moments.keys) <= set(other.keys)]
    parts = []
    for log in moments.logs:
        mine = np.array([g != log for g in moments.logs])
        terms = [(moments.grams[mine], moments.counts[mine] / moments.counts[mine].sum())]
        for other in beside:
            remaining = np.array([g != log for g in other.logs])
            part = OTHERS / (len(moments.logs) * len(beside))
            terms.append(
                (
                    other.of_keys(moments.keys)[remaining],
                    part * other.counts[remaining] / other.counts[remaining].sum(),
                )
            )
        parts.append(combined(*(np.concatenate(values) for values in zip(*terms, strict=True))))
    whole = np.mean(parts, axis=0)
    if len(moments.logs) == LEAST_LOGS:
        grams = np.concatenate([moments.grams, *(other.of_keys(moments.keys) for other in beside)])
        best = np.argmin(geometric(grams, np.ones(len(grams))))
        whole = (1.0 - SHRINK) * whole + SHRINK * (np.arange(len(whole)) == best)

    def placed(weights: Array) -> Array:
        full = np.zeros(count)
        full[moments.places] = pruned(weights)
        return full

    return Stack(placed(whole), {g: placed(part) for g, part in zip(moments.logs, parts, strict=True)})


def _mean_products(error: Array, usual: float) -> Array:
    """(C, C) of errors (C, n); a sample whose median square is `usual` counts half."""
    share = 1.0 / (1.0 + np.median(error**2, axis=0) / usual)
    return np.asarray((error * share) @ error.T / share.sum())


def combined(grams: Array, counts: Array) -> Array:
    """(C,) weights by second moments (G, C, C) of errors in each log, and what each counts (G,)."""
    means = geometric(grams, counts)
    use = np.flatnonzero(means <= FAR_WORSE * means.min())
    selected = grams[:, use[:, None], use]
    shares = np.full(len(use), 1.0 / len(use))
    for _ in range(PASSES):
        levels = np.einsum("c,gcd,d->g", shares, selected, shares) + FLOOR
        shares = least(np.einsum("g,gcd->cd", counts / levels, selected))
    weights = np.zeros(grams.shape[1])
    weights[use] = shares
    return weights


def pruned(weights: Array) -> Array:
    """(C,) without those that weigh little."""
    large = np.where(weights >= min(PRUNED, float(weights.max())), weights, 0.0)
    return np.asarray(large / large.sum())


def geometric(grams: Array, counts: Array) -> Array:
    """(C,) geometric mean over logs of the mean squared errors in (G, C, C); counts (G,): of each log."""
    squares = np.maximum(np.einsum("gcc->gc", grams), np.finfo(float).tiny)
    return np.asarray(np.exp(counts @ np.log(squares) / counts.sum()))


def least(square: Array) -> Array:
    """argmin over w >= 0, sum w = 1 of w^T S w.

    The minimum over u >= 0 of u^T S u + (1 - sum u)^2 is a multiple of it: along each direction w its value
    grows with w^T S w alone.
    """
    from scipy.optimize import nnls

    scaled = square / max(float(np.diagonal(square).min()), float(np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(scaled)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    rows = np.vstack([root, np.ones(len(square))])
    solution = nnls(rows, np.append(np.zeros(len(square)), 1.0))[0]
    return np.asarray(solution / solution.sum())


def left_out(stack: Stack, every: Sequence[CandidateErrors], j: int, fold: Index) -> tuple[Array, Array]:
    """Errors and variances (n,) of a command's average, each log by the weights that did not see it."""
    error, variance = np.full(len(fold), np.nan), np.full(len(fold), np.nan)
    places, errors, variances = of_command(every, j)
    for number in np.unique(fold).tolist():
        at = fold == number
        weights = stack.without.get(number, stack.weights)[places]
        error[at], variance[at] = mixed(errors[:, at], variances[:, at], weights)
    return error, variance
