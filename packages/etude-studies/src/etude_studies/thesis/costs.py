"""Cost of processes by their size: processor seconds on one thread and their growth (2.3, 2.4, 6.2, 7.1.4).

Every figure is one of time, so its name begins with "cpu_": two computations of it differ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from etude.models import ExactGP, initial_gp, minimize
from etude.threads import threads_for
from etude.types import Array
from etude_sparse import DictionaryConfig, DictionaryGP, SparseSpectrumGP
from etude_studies.measured import Measured
from etude_studies.streams import INPUTS, NOISE, motions, outputs, process

REPEATS = 5
"""Of a measurement; the median counts."""
GRAM_BYTES = 8
TRAINING, MEAN, VARIANCE = "cpu_train", "cpu_mean_each", "cpu_predict_each"
SLOPES = {"cpu_slope_train": TRAINING, "cpu_slope_mean": MEAN, "cpu_slope_variance": VARIANCE}


@dataclass(frozen=True)
class CostSettings:
    """At which sizes costs are measured.

    Attributes:
        exact: numbers of samples of exact processes. sloped: from where on growth is fitted: below, what
            a call costs in any case hides it.
        points: numbers of spectral points, with `samples` samples. points_sloped: as `sloped`.
        taught: numbers of samples that `basis` spectral points are taught.
        members: of the dictionary. offered: samples offered to it.
        block: states predicted in one call: enough to hide what a call costs in any case, few enough for
            their covariances to stay in the cache.
        searches: line searches of a training, counted on `counted` samples.
        beyond: numbers of samples that are extrapolated to.
        least_s: processor seconds for which a call is repeated.
    """

    exact: Sequence[int] = (250, 500, 1000, 2000, 3000, 6000)
    sloped: int = 1000
    points: Sequence[int] = (25, 50, 100, 200, 400)
    points_sloped: int = 100
    samples: int = 3000
    taught: Sequence[int] = (500, 1000, 2000, 3000, 6000, 12000)
    basis: int = 200
    members: int = 500
    offered: int = 2000
    block: int = 100
    searches: int = 25
    counted: int = 500
    beyond: Sequence[int] = (12000, 36000)
    least_s: float = 0.02


def run(settings: Mapping[str, Any], seed: int, _: Mapping[str, pl.DataFrame]) -> list[Measured]:
    """All costs of one output on made-up motions of twelve inputs; k is the size, 0 for growth.

    Models "exact" and "exact_extrapolated" (k samples), "spectrum" (k spectral points), "spectrum_n" (k
    samples, fixed points) and "dictionary" (k members). `cpu_train` is one likelihood with its gradient,
    `cpu_mean` and `cpu_predict` (mean and variance) one state asked alone, `..._each` one of a block of
    states, s; `cpu_slope_...` is the growth of log time in log size, of single states in blocks.
    `cpu_evaluations` counts likelihoods in a training, `cpu_train_hours` is that many of them, and
    `cpu_gram_gb` the memory of the covariances.

    Args:
        settings: of `CostSettings`. seed: of the motions.
    """
    config, rng = CostSettings(**settings), np.random.default_rng(seed)
    X = motions(3, rng)
    X = X[rng.permutation(len(X))]
    y = outputs(X, rng)
    with threads_for(0):
        exact = list(_exact(config, X, y))
        rows = [*exact]
        for m in config.points:
            rows += _spectrum(config, X, y, config.samples, m, m, "spectrum", rng)
        for n in config.taught:
            rows += _spectrum(config, X, y, n, config.basis, n, "spectrum_n", rng)
        rows += _slopes(exact, config.sloped) + _slopes(rows, config.points_sloped, "spectrum")
        rows += _slopes(rows, config.sloped, "spectrum_n")
        rows += _extrapolated(config, exact, evaluations(config, X, y))
        rows.append(Measured(config.members, "", "dictionary", "mean", "cpu_swap", _swap(config, X, y)))
    return rows


def _exact(config: CostSettings, X: Array, y: Array) -> Iterator[Measured]:
    for n in config.exact:
        gp = process(NOISE)
        yield from _costs(gp, X[:n], y[:n], X[-config.block :], n, "exact", config.least_s)


def _spectrum(
    config: CostSettings, X: Array, y: Array, n: int, m: int, k: int, model: str, rng: np.random.Generator
) -> list[Measured]:
    """m learned spectral points taught n samples."""
    gp = process(NOISE)
    points = rng.standard_normal((m, INPUTS))
    spectrum = SparseSpectrumGP(points, gp.theta, gp.log_noise, gp.noise_floor, learned=True)
    return list(_costs(spectrum, X[:n], y[:n], X[-config.block :], k, model, config.least_s))


def _costs(
    gp: ExactGP | SparseSpectrumGP, X: Array, y: Array, queries: Array, k: int, model: str, least_s: float
) -> Iterator[Measured]:
    posterior, one = gp.condition(X, y), queries[:1]
    calls: dict[str, tuple[Callable[[], object], int]] = {
        TRAINING: (lambda: gp.log_marginal_likelihood(X, y), 1),
        "cpu_mean": (lambda: posterior.mean(one), 1),
        "cpu_predict": (lambda: posterior.predict(one), 1),
        MEAN: (lambda: posterior.mean(queries), len(queries)),
        VARIANCE: (lambda: posterior.predict(queries), len(queries)),
    }
    for name, (call, parts) in calls.items():
        yield Measured(k, "", model, "mean", name, seconds(call, least_s) / parts)


def seconds(call: Callable[[], object], least_s: float) -> float:
    """Median processor time of a call after a first one, s; a long call is measured once."""
    times = [_spent(call, least_s) for _ in range(2)]
    while len(times) <= REPEATS and sum(times) < 1.0:
        times.append(_spent(call, least_s))
    return float(np.median(times[1:]))


def _spent(call: Callable[[], object], least: float) -> float:
    """Processor seconds of one call, from as many as take `least` seconds."""
    began, count, spent = time.process_time(), 0, 0.0
    while not count or spent < least:
        call()
        count, spent = count + 1, time.process_time() - began
    return spent / count


def growth(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Slope of log cost in log size by least squares; NaN for fewer than two sizes."""
    if len(sizes) < 2:
        return float("nan")
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def _slopes(measurements: Sequence[Measured], least: int, model: str = "exact") -> list[Measured]:
    rows = [row for row in measurements if row.model == model and row.k >= least]
    slopes = []
    for name, measure in SLOPES.items():
        series = [row for row in rows if row.measure == measure]
        slope = growth([row.k for row in series], [row.value for row in series])
        slopes.append(Measured(0, "", model, "mean", name, slope))
    return slopes


def evaluations(config: CostSettings, X: Array, y: Array) -> int:
    """Likelihoods that a training of so many line searches evaluates, from the thesis's start values."""
    X, y = X[: config.counted], y[: config.counted] - y[: config.counted].mean()
    start = initial_gp(process(NOISE).kernel, X, y)

    def objective(parameters: Array) -> tuple[float, Array]:
        value, gradient = start.with_parameters(parameters).log_marginal_likelihood(X, y)
        return -value, -gradient

    return minimize(objective, start.parameters, config.searches).evaluations


def _extrapolated(config: CostSettings, exact: Sequence[Measured], count: int) -> Iterator[Measured]:
    """From the largest size measured: training as its cube, the variance as its square, the Gram matrix."""
    model, largest = "exact_extrapolated", max(config.exact)
    measured = {row.measure: row.value for row in exact if row.k == largest}
    yield Measured(0, "", "exact", "mean", "cpu_evaluations", count)
    for n in config.beyond:
        factor = n / largest
        train, predict = measured[TRAINING] * factor**3, measured["cpu_predict"] * factor**2
        figures = {TRAINING: train, "cpu_train_hours": count * train / 3600.0}
        figures |= {"cpu_predict": predict, "cpu_gram_gb": GRAM_BYTES * n**2 / 1e9}
        yield from (Measured(n, "", model, "mean", name, value) for name, value in figures.items())


def _swap(config: CostSettings, X: Array, y: Array) -> float:
    """Median over samples that took a member's place of the cost of offering them, s."""
    stream = DictionaryGP(process(NOISE), DictionaryConfig(size=config.members)).stream(INPUTS)
    first = config.members + 1  # one more than it holds: the exchange is compiled
    stream.offer(X[:first], y[:first])
    times = []
    for i in range(first, first + config.offered):
        before, began = stream.replacements, time.process_time()
        stream.offer(X[i : i + 1], y[i : i + 1])
        spent = time.process_time() - began
        times += [spent] if stream.replacements > before else []
    return float(np.median(times)) if times else float("nan")
