"""Methods of online learning: each continues from an exact posterior, in its own representation.

A new one is a class with `learn` and `mean`, a function that begins it, and a row in METHODS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np

from etude.errors import UsageError
from etude.models.gp.exact import ExactGP, ExactPosterior
from etude.models.gp.single_point import PointMean
from etude.types import Array
from etude_online.learner import Method, OnlineConfig, OnlineOutput

if TYPE_CHECKING:  # only the method in use is loaded
    from etude_sparse.dictionary_stream import DictionaryStream
    from etude_sparse.incremental_spectrum import IncrementalSpectrum
    from etude_sparse.sogp import OnlineProcess

Begin = Callable[[ExactPosterior, OnlineConfig, np.random.Generator], Method]
DICTIONARY_SIZE, BASIS_SIZE = 300, 100
"""Members and basis points unless the configuration says otherwise: each below 0.5 ms an update."""
LEAST_NOISE = 1e-8
"""Least noise variance of a method that divides by it, as a part of the prior variance."""


def dictionary(rule: Literal["variance", "error"], guard: float | None = 3.0) -> Begin:
    """`DictionaryGP` of that rule, filled from the posterior's points: evenly spread ones, then the rest."""

    def begin(start: ExactPosterior, config: OnlineConfig, _: np.random.Generator) -> Method:
        from etude_sparse.dictionary import DictionaryConfig, DictionaryGP

        size = config.size or DICTIONARY_SIZE
        choice = DictionaryConfig(size=size, rule=rule, guard=guard, half_life=config.half_life)
        gp = ExactGP(start.kernel, start.theta, _log_noise(start))
        stream = DictionaryGP(gp, choice).stream(start.X.shape[1])
        n = len(start.y)
        spread = np.arange(min(size, n)) * n // min(size, n)
        order = np.concatenate([spread, np.setdiff1d(np.arange(n), spread)])
        stream.offer(start.X[order], start.y[order], np.zeros(n))
        return _Dictionary(stream)

    return begin


class _Dictionary:
    """Times count from the first sample, so that what the dictionary started from has no age by then."""

    STATE_FIELDS: tuple[str, ...] = (
        "_first",
        *(f"_stream.{n}" for n in ("diagonal", "signal_variance", "offered", "refreshes", "_members")),
    )

    def __init__(self, stream: DictionaryStream) -> None:
        self._stream, self._first = stream, np.nan

    def learn(self, x: Array, y: float, t: float) -> None:
        if np.isnan(self._first):
            self._first = t
        self._stream.offer(x[None], np.array([y]), np.array([t - self._first]))

    def mean(self, x: Array) -> float:
        return self._stream.mean(x)


def sogp(start: ExactPosterior, config: OnlineConfig, _: np.random.Generator) -> Method:
    """The sparse online process, taught the posterior's points one after the other."""
    from etude_sparse.sogp import SOGP

    capacity = config.size or BASIS_SIZE
    process = SOGP(start.kernel, start.theta, _log_noise(start), capacity=capacity).begin(start.X.shape[1])
    for x, y in zip(start.X, start.y, strict=True):
        process.update(x, float(y))
    return _Sogp(process)


class _Sogp:
    STATE_FIELDS: tuple[str, ...] = (
        *(f"_process.{n}" for n in ("samples", "log_density", "_diagonal_sum", "basis")),
        *(f"_process.{n}" for n in ("_L", "_S", "_m", "_weights")),
    )

    def __init__(self, process: OnlineProcess) -> None:
        self._process = process

    def learn(self, x: Array, y: float, _: float) -> None:
        self._process.update(x, y)

    def mean(self, x: Array) -> float:
        return self._process.mean(x)


def random_spectrum(start: ExactPosterior, config: OnlineConfig, rng: np.random.Generator) -> Method:
    """I-SSGPR of what the posterior leaves, on random features of its kernel, taught its points first.

    Given its points, a process has the posterior's mean and covariance. Only the covariance is approximated
    by features; the mean stays exact, and where nothing new was learned it stays what it was.
    """
    from etude_sparse.incremental_spectrum import IncrementalSpectrum
    from etude_sparse.random_features import FeatureProcess, random_features

    features = random_features(start.kernel, start.theta, start.X.shape[1], config.frequencies, rng)
    noise = float(np.exp(2.0 * _log_noise(start)))
    forgetting = 1.0 if config.half_life is None else 0.5 ** (1.0 / (config.half_life * config.rate_hz))
    model = IncrementalSpectrum.start(
        FeatureProcess(features, noise, start.signal_variance), forgetting=forgetting
    )
    for x in start.X:
        model.update(x, 0.0)
    return _Spectrum(PointMean([start]), model)


class _Spectrum:
    STATE_FIELDS: tuple[str, ...] = tuple(
        f"_model.{n}" for n in ("A", "R", "b", "prior", "count", "_weights", "_next")
    )

    def __init__(self, before: PointMean, model: IncrementalSpectrum) -> None:
        self._before, self._model = before, model

    def learn(self, x: Array, y: float, _: float) -> None:
        self._model.update(x, y - float(self._before(x)[0]))

    def mean(self, x: Array) -> float:
        return float(self._before(x)[0]) + self._model.mean(x)


def _log_noise(start: ExactPosterior) -> float:
    """log of the noise deviation, not below what a method that divides by it can bear."""
    return 0.5 * float(np.log(max(start.noise_variance, LEAST_NOISE * start.signal_variance)))


METHODS: dict[str, Begin] = {
    "variance": dictionary("variance"),
    "error": dictionary("error"),
    "error_literal": dictionary("error", guard=None),
    "ssgp": random_spectrum,
    "sogp": sogp,
}
"""By the name that `OnlineConfig.method` gives."""


def begin(start: ExactPosterior, config: OnlineConfig, rng: np.random.Generator) -> OnlineOutput:
    """A learner of one output with the posterior of `start`, as far as its size allows.

    Args:
        start: exact process (a dictionary included): kernel, hyperparameters, points.
        rng: of what a method draws.

    Raises:
        UsageError: an unknown method.
    """
    method = METHODS[known(config.method)]
    return OnlineOutput(method(start, config, rng), start.X.shape[1])


def known(method: str) -> str:
    """The method's name. UsageError with the choices: there is none of that name."""
    if method not in METHODS:
        names = ", ".join(METHODS)
        raise UsageError(f"there is no online method {method!r}", next_step=f"Choose one of: {names}.")
    return method
