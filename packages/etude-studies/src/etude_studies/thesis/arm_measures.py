"""Measures of one test run of an arm: tracking, feedback, reversals, and calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

from etude.models import NORMAL_95
from etude.types import Array, Index, Log

REVERSAL_SHARE = 0.2
"""Part of the time, nearest to a reversal, of which the share of the error is taken."""
NEAR_S = 1.0
"""Around a maximum or minimum of the desired motion."""
REST = 1e-3
"""rad/s, below which a joint rests. MOVES: above which it should move. FROZEN_S: for how long it rests."""
MOVES, FROZEN_S = 0.02, 0.3
AGAIN, AGAIN_S = 0.01, 0.1
"""rad/s in the new direction, and for how long: a joint moves again after a reversal."""
NEIGHBOURS = 500
"""Samples of each side at which distances are taken."""

Figure = tuple[str, Array]


def tracking(log: Log, rate: float) -> Iterator[Figure]:
    """Name and value (J,) of each figure of a run that needs no model; angles in degrees.

    Args:
        log: of a simulated arm, with `q_des`, `q_true`, `command`, `command_ff` and `command_fb`.
        rate: Hz.
    """
    log = log.take(log.t >= 0.0)
    desired, actual = log["q_des"], log["q_true"]
    error = np.rad2deg(desired - actual)
    yield "error", np.abs(error).mean(axis=0)
    yield "error_rms", np.sqrt((error**2).mean(axis=0))
    command, feedback = log["command"], log["command_fb"]
    size = np.sqrt((command**2).mean(axis=0))
    yield "feedback_share", np.sqrt((feedback**2).mean(axis=0)) / size
    yield "feedback_median", np.median(np.abs(feedback), axis=0) / size
    yield "feedback_p95", np.quantile(np.abs(feedback), 0.95, axis=0) / size
    speed = np.gradient(actual, 1.0 / rate, axis=0)
    yield "effort", np.abs(command * speed).mean(axis=0)
    yield "nmse", ((log["command_ff"] - command) ** 2).mean(axis=0) / command.var(axis=0)
    yield "jerk", jerkiness(desired, actual, rate)
    share, missed = np.sqrt((feedback**2).mean(axis=0)) / size, np.abs(error).mean(axis=0)
    yield "share_follows_error", np.full(len(missed), rank_correlation(missed, share))


def description(log: Log, rate: float) -> Iterator[Figure]:
    """What the thesis describes of single runs: where the error occurs, and how far joints fall short.

    Args:
        log, rate: as in `tracking`.
    """
    log = log.take(log.t >= 0.0)
    desired, actual = log["q_des"], log["q_true"]
    turns = [reversals(column) for column in log["qd_des"].T]
    pairs = zip(np.abs(desired - actual).T, turns, strict=True)
    yield "reversal_share", np.array([near_share(e, places) for e, places in pairs])
    yield from excursions(np.rad2deg(desired), np.rad2deg(actual), turns, rate)
    yield "stuck_share", stuck(actual, log["qd_des"], turns, rate)


def standing(log: Log, rate: float) -> Iterator[Figure]:
    """What happens from each reversal of the desired motion until the joint moves again: each (J,).

    `after_reversal` is the share of the error there, `after_reversal_time` that of the time, `stuck_after`
    the share of reversals after which the joint rests for 0.3 s although it should move.

    Args:
        log, rate: as in `tracking`.
    """
    log = log.take(log.t >= 0.0)
    desired, speed = log["q_des"], log["qd_des"]
    actual_speed = np.gradient(log["q_true"], 1.0 / rate, axis=0)
    rests = (np.abs(actual_speed) < REST) & (np.abs(speed) > MOVES)
    error, shares = np.abs(desired - log["q_true"]), []
    for joint in range(desired.shape[1]):
        windows = until_it_moves(actual_speed[:, joint], speed[:, joint], rate)
        inside = np.zeros(len(desired), dtype=bool)
        for window in windows:
            inside[window] = True
        stuck_in = [float(_longest(rests[span, joint]) >= round(FROZEN_S * rate)) for span in windows]
        whole = error[:, joint].sum()
        share = float(error[inside, joint].sum() / whole) if windows and whole > 0.0 else math.nan
        shares.append((share, float(inside.mean()) if windows else math.nan, _mean(stuck_in)))
    names = ("after_reversal", "after_reversal_time", "stuck_after")
    yield from (
        (name, np.array(values)) for name, values in zip(names, zip(*shares, strict=True), strict=True)
    )


def until_it_moves(actual: Array, desired: Array, rate: float) -> list[slice]:
    """From each reversal of a desired speed (T,) until the actual one follows; at most until the next one."""
    turns, hold = reversals(desired), round(AGAIN_S * rate)
    windows = []
    for turn, end in zip(turns, [*turns[1:], len(desired)], strict=True):
        follows = actual[turn:end] * np.sign(desired[turn]) > AGAIN
        holding = (
            np.convolve(follows, np.ones(hold), "valid") >= hold - 0.5
            if len(follows) >= hold
            else follows[:0]
        )
        first = int(holding.argmax()) if holding.any() else end - turn
        windows.append(slice(int(turn), int(turn) + first))
    return windows


def jerkiness(desired: Array, actual: Array, rate: float) -> Array:
    """(J,) root mean square of the third difference of the error over that of the desired motion."""
    error_jerk, plan = (np.diff(rows, 3, axis=0) * rate**3 for rows in (actual - desired, desired))
    return np.asarray(np.sqrt((error_jerk**2).mean(axis=0) / (plan**2).mean(axis=0)))


def reversals(speed: Array) -> Index:
    """Positions at which a desired speed (T,) first has the other sign; a rest in between is none."""
    moving = np.flatnonzero(speed)
    signs = np.sign(speed[moving])
    return np.asarray(moving[1:][signs[1:] != signs[:-1]])


def near_share(error: Array, turns: Index) -> float:
    """Share of the error (T,) in the fifth of the time that is nearest to a reversal; NaN without any."""
    if not (len(turns) and error.any()):
        return math.nan
    distance = np.abs(np.arange(len(error))[:, None] - turns[None]).min(axis=1)
    nearest = np.argsort(distance, kind="stable")[: round(REVERSAL_SHARE * len(error))]
    return float(error[nearest].sum() / error.sum())


def excursions(desired: Array, actual: Array, turns: list[Index], rate: float) -> Iterator[Figure]:
    """By how much a joint falls short of the desired maxima and minima, deg; below 0 it overshoots.

    `spike` is the largest error within a second of a maximum, over the median error.
    """
    near, last = round(NEAR_S * rate), len(desired) - 1
    short: dict[str, list[float]] = {
        "undershoot": [],
        "undershoot_max": [],
        "undershoot_min": [],
        "spike": [],
    }
    for w, a, places in zip(desired.T, actual.T, turns, strict=True):
        tops, bottoms, peaks = [], [], []
        for turn in places:
            window = slice(max(0, turn - near), min(last, turn + near) + 1)
            if w[turn] >= w[window].mean():
                tops.append(w[window].max() - a[window].max())
                peaks.append(np.abs(w[window] - a[window]).max())
            else:
                bottoms.append(a[window].min() - w[window].min())
        short["undershoot"].append(_mean(tops + bottoms))
        short["undershoot_max"].append(_mean(tops))
        short["undershoot_min"].append(_mean(bottoms))
        short["spike"].append(_mean(peaks) / float(np.median(np.abs(w - a))))
    yield from ((name, np.array(values)) for name, values in short.items())


def stuck(actual: Array, speed: Array, turns: list[Index], rate: float) -> Array:
    """(J,) share of reversals within a second of which the joint rests for 0.3 s although it should move."""
    near, least = round(NEAR_S * rate), round(FROZEN_S * rate)
    rests = (np.abs(np.gradient(actual, 1.0 / rate, axis=0)) < REST) & (np.abs(speed) > MOVES)
    return np.array(
        [
            _mean([float(_longest(resting[max(0, turn - near) : turn + near]) >= least) for turn in places])
            for resting, places in zip(rests.T, turns, strict=True)
        ]
    )


def honesty(command: Array, mean: Array, latent: Array, noisy: Array) -> Iterator[Figure]:
    """How a model's mean and variances (T, J) fit the commands (T, J) that were applied: each (J,)."""
    error, deviation = command - mean, np.sqrt(noisy)
    yield "variance", latent.mean(axis=0)
    yield "variance_noisy", noisy.mean(axis=0)
    yield "z2", (error**2 / noisy).mean(axis=0)
    yield "coverage68", (np.abs(error) <= deviation).mean(axis=0)
    yield "coverage95", (np.abs(error) <= NORMAL_95 * deviation).mean(axis=0)
    yield "nlpd", density_loss(error, noisy)
    pairs = zip(deviation.T, np.abs(error).T, strict=True)
    yield "spearman", np.array([rank_correlation(sd, e) for sd, e in pairs])


def density_loss(error: Array, variance: Array) -> Array:
    """(J,) mean negative log density of normal errors (T, J)."""
    return np.asarray(0.5 * (np.log(2.0 * np.pi * variance) + error**2 / variance).mean(axis=0))


def nearest_distance(new: Array, training: Array, scale: Array) -> float:
    """Median distance from inputs `new` (T, D) to the nearest of `training` (n, D); unit: `scale` (D,)."""
    tree = cKDTree(_spread(training) / scale)
    return float(np.median(tree.query(_spread(new) / scale)[0]))


def _spread(rows: Array) -> Array:
    return rows[:: max(1, len(rows) // NEIGHBOURS)]


def rank_correlation(one: Array, other: Array) -> float:
    """Spearman's; NaN where one of them does not vary."""
    varies = np.ptp(one) > 0.0 and np.ptp(other) > 0.0
    return float(spearmanr(one, other).statistic) if varies else math.nan


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else math.nan


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
