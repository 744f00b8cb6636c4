"""What one sample costs: a mean for a controller's tick, and a dictionary that learns it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP
from etude.models.gp.single_point import PointMean
from etude.studies.bench_models import INPUTS, RATE_NOISE, motions, outputs, process
from etude.studies.rows import Row

OUTPUTS = 4
POINTS = 500
MEMBERS = 300
REPEATS = 2000
AIM_PREDICT_US, AIM_UPDATE_US = 40.0, 500.0


def latency_rows(rng: np.random.Generator) -> list[Row]:
    """`predict_one_point_us` of all outputs and `online_update_us` of one: medians, beside the aims.

    A tick of 100 Hz has 10,000 µs. The updates are of a full dictionary that samples of a smooth motion
    stream through one by one, swaps and refreshes included.
    """
    return [_predict_row(rng), _update_row(rng)]


def _predict_row(rng: np.random.Generator) -> Row:
    posteriors = [
        process(RATE_NOISE).condition(rng.normal(size=(POINTS, INPUTS)), rng.normal(size=POINTS))
        for _ in range(OUTPUTS)
    ]
    mean, inputs = PointMean(posteriors), rng.normal(size=(REPEATS, INPUTS))
    value = _median_us(lambda i: mean(inputs[i]))
    return Row("predict_one_point_us", value, "us", f"aim; {OUTPUTS} outputs, n = {POINTS}", AIM_PREDICT_US)


def _update_row(rng: np.random.Generator) -> Row:
    X = motions(1, rng)
    y = outputs(X, rng)
    stream = DictionaryGP(process(RATE_NOISE), DictionaryConfig(size=MEMBERS)).stream(INPUTS)
    stream.offer(X[:MEMBERS], y[:MEMBERS])
    stream.offer(X[MEMBERS - 1 : MEMBERS], y[MEMBERS - 1 : MEMBERS])  # compiles the update
    value = _median_us(lambda i: stream.offer(X[MEMBERS + i, None], y[MEMBERS + i, None]))
    share = 100 * stream.replacements / REPEATS
    return Row("online_update_us", value, "us", f"aim; n = {MEMBERS}, {share:.0f} % swaps", AIM_UPDATE_US)


def _median_us(call: Callable[[int], object]) -> float:
    times = np.empty(REPEATS)
    for i in range(REPEATS):
        start = time.perf_counter()
        call(i)
        times[i] = time.perf_counter() - start
    return float(1e6 * np.median(times))
