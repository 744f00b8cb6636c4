"""`etude bench models`: what the members of the model family do in the time and with the memory they take."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.linalg.blas import dsymv, dsyr2

from etude.progress import counted
from etude.threads import threads_for
from etude_sparse import DictionaryConfig, DictionaryGP, DictionaryStream
from etude_studies.arm_accuracy import member_rows
from etude_studies.crazyflie_accuracy import crazyflie_accuracy_rows
from etude_studies.model_latency import latency_rows
from etude_studies.model_table import show
from etude_studies.online_rows import online_rows
from etude_studies.real_accuracy import real_rows
from etude_studies.rows import Row, rows_json
from etude_studies.streams import INPUTS, NOISE, motions, outputs, process

SIZE = 500
DRIFT_NOISE = 1e-4
"""Noise variance, in signal variances; `streams.NOISE` where rates are measured."""
SWAP_SHARE = 0.3
REPLACEMENTS = 10_000


def run(*, json: bool = False, seed: int = 0, quick: bool = False, logs: Path | None = None) -> list[Row]:
    """Measure all rows and print them: tables, or with `json` the one line of `rows_json`.

    `quick` measures the same rows with fewer seeds; `logs` is a folder with further recordings (`real_logs`).
    """
    with threads_for(0):
        rows = measured(seed, quick, logs)
    if json:
        command = (
            "etude bench models" + " --quick" * quick + " --logs FOLDER" * (logs is not None) + " --json"
        )
        print(rows_json(rows, command))  # noqa: T201
    else:
        show(rows, "model family")
    return rows


def measured(seed: int, quick: bool, logs: Path | None) -> list[Row]:
    """The rows, in the order in which they are measured; each measure draws from a generator of its own."""
    rng = partial(np.random.default_rng, seed)
    measures: tuple[Callable[[np.random.Generator], list[Row]], ...] = (
        dictionary_points_per_s,
        dictionary_drift_10k,
        latency_rows,
        partial(real_rows, logs=logs),
        crazyflie_accuracy_rows,
        partial(member_rows, quick=quick),
        partial(online_rows, quick=quick),
    )
    return [row for measure in counted(measures) for row in measure(rng())]


def dictionary_points_per_s(rng: np.random.Generator) -> list[Row]:
    """Candidates a full dictionary of one output deals with in a second, at least 30 % of them swapped in.

    Neighbouring samples of random motions, ageing the faster the longer too few are swapped in. The
    reference is the time BLAS takes for the same: one product with P a candidate, and for a swap two
    more and a rank-2 update.
    """
    half_life, share, rate = 32.0 * SIZE, 0.0, 0.0
    while share < SWAP_SHARE and half_life > 1.0:
        stream = _stream(NOISE, half_life, rng)
        X = motions(2, rng)
        y = outputs(X, rng)
        start = time.perf_counter()
        share = stream.offer(X, y) / len(X)
        rate = len(X) / (time.perf_counter() - start)
        half_life /= 2.0
    product, update = _blas_seconds(rng)
    floor = 1.0 / (product + share * (2.0 * product + update))
    named = f"BLAS for the same, {100 * share:.0f} % swaps, size {SIZE}"
    return [Row("dictionary_points_per_s", rate, "1/s", named, floor)]


def dictionary_drift_10k(rng: np.random.Generator) -> list[Row]:
    """Largest max |P K - I| seen in 10,000 replacements at a noise of 1e-4 of the signal variance.

    Looked at between the refreshes, where it is worst. The reference is that of an inverse just computed.
    """
    stream = _stream(DRIFT_NOISE, half_life=1000.0, rng=rng)
    worst = 0.0
    while stream.replacements < REPLACEMENTS:
        X = motions(1, rng)
        for part in np.array_split(np.arange(len(X)), 13):
            stream.offer(X[part], outputs(X[part], rng))
            worst = max(worst, stream.drift())
    stream.refresh()
    return [Row("dictionary_drift_10k", worst, "1", "inverse computed anew", stream.drift())]


def _stream(noise: float, half_life: float, rng: np.random.Generator) -> DictionaryStream:
    """A dictionary that has been filled from one motion, and compiled."""
    stream = DictionaryGP(process(noise), DictionaryConfig(size=SIZE, half_life=half_life)).stream(INPUTS)
    X = motions(1, rng)
    stream.offer(X, outputs(X, rng))
    return stream


def _blas_seconds(rng: np.random.Generator, repeats: int = 200) -> tuple[float, float]:
    """Median seconds of one symmetric product and one rank-2 update of order SIZE, in place."""
    P = np.asfortranarray(np.eye(SIZE))
    v, w = rng.normal(size=SIZE), rng.normal(size=SIZE) * 1e-6
    times = np.empty((repeats, 2))
    for i in range(repeats):
        start = time.perf_counter()
        dsymv(1.0, P, v, lower=1)
        middle = time.perf_counter()
        dsyr2(1e-9, v, w, lower=1, a=P, overwrite_a=1)
        times[i] = middle - start, time.perf_counter() - middle
    product, update = np.median(times, axis=0)
    return float(product), float(update)
