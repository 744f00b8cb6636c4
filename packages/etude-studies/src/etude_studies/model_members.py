"""The members of the model family as `etude bench models` trains them: one row each, the same budget.

All see the same samples with the same squared exponential covariance (the sparse spectrum knows no other),
start from the data's scales and take `STEPS` steps of L-BFGS with weak priors: the sparse spectrum and the
inducing points on their own likelihood of all samples, the others on the exact one of `KEPT` samples evenly
spread. Learned spectral points spend half of the steps on the lengths, which have to be found before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np

from etude.models import ExactGP, Form, SquaredExponential, fit, fit_inducing, initial_gp, initial_inducing
from etude.types import Array
from etude_sparse import (
    LWPR,
    SOGP,
    DictionaryConfig,
    DictionaryGP,
    DownsampledGP,
    LocalGP,
    fit_sparse_spectrum,
    initial_sparse_spectrum,
)

STEPS = 25
KEPT = 300
"""Samples kept by downsampling and dictionaries, and used for the hyperparameters of exact processes."""
BASIS = 100
"""Spectral points, inducing inputs, basis points of the sparse online process."""


class Predicts(Protocol):
    """What the bench asks of a posterior."""

    @property
    def noise_variance(self) -> float: ...

    def predict(self, X: Array) -> tuple[Array, Array]: ...


Member = Callable[[Array, Array, float, np.random.Generator], Predicts]
"""(X (n, D), centred y (n,), noise floor, generator) -> trained and conditioned posterior."""


def exact(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return _exact_gp(X, y, floor).condition(X, y)


def downsampled(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return DownsampledGP(_exact_gp(X, y, floor), every=None, count=KEPT).condition(X, y)


def dictionary_variance(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return _dictionary(X, y, floor, "variance")


def dictionary_error(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return _dictionary(X, y, floor, "error")


def ssgp_fixed(X: Array, y: Array, floor: float, rng: np.random.Generator) -> Predicts:
    gp = initial_sparse_spectrum(X, y, BASIS, rng, draws=10, noise_floor=floor)
    return fit_sparse_spectrum(gp, X, y, steps=STEPS).condition(X, y)


def ssgp_learned(X: Array, y: Array, floor: float, rng: np.random.Generator) -> Predicts:
    gp = initial_sparse_spectrum(X, y, BASIS, rng, draws=10, noise_floor=floor)
    gp = fit_sparse_spectrum(gp, X, y, steps=STEPS // 2)
    learned = fit_sparse_spectrum(replace(gp, learned=True), X, y, steps=STEPS - STEPS // 2)
    return learned.condition(X, y)


def fitc(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return _inducing(X, y, floor, "fitc")


def vfe(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return _inducing(X, y, floor, "vfe")


def sogp(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    gp = _exact_gp(X, y, floor)
    return SOGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor, capacity=BASIS).condition(X, y)


def local_gp(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return LocalGP(_exact_gp(X, y, floor), capacity=KEPT).condition(X, y)


def lwpr(X: Array, y: Array, floor: float, _: np.random.Generator) -> Predicts:
    return LWPR(noise_floor=floor).condition(X, y)


MEMBERS: dict[str, Member] = {
    member.__name__: member
    for member in (
        exact,
        downsampled,
        dictionary_variance,
        dictionary_error,
        ssgp_fixed,
        ssgp_learned,
        fitc,
        vfe,
        sogp,
        local_gp,
        lwpr,
    )
}


def _kernel(X: Array) -> SquaredExponential:
    return SquaredExponential(tuple(range(X.shape[1])))


def _exact_gp(X: Array, y: Array, floor: float) -> ExactGP:
    """The exact process, its hyperparameters from evenly spread samples."""
    start = initial_gp(_kernel(X), X, y, noise_floor=floor)
    selected = DownsampledGP(start, every=None, count=KEPT).keep(len(y))
    return fit(start, X[selected], y[selected], steps=STEPS)


def _dictionary(X: Array, y: Array, floor: float, rule: Literal["variance", "error"]) -> Predicts:
    return DictionaryGP(_exact_gp(X, y, floor), DictionaryConfig(size=KEPT, rule=rule)).condition(X, y)


def _inducing(X: Array, y: Array, floor: float, form: Form) -> Predicts:
    gp = initial_inducing(_kernel(X), X, y, BASIS, form=form, noise_floor=floor)
    return fit_inducing(gp, X, y, steps=STEPS).condition(X, y)
