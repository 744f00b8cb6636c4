"""The members of the model family by name: how each learns one output. A new member is a row in PROCESSES."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from etude.models.contracts import Posterior
from etude.models.lesson import Lesson, Member, Trained, initial_process, trained_process
from etude.models.thesis_dictionary import thesis_dictionary

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.inducing import Form
    from etude.models.gp.sparse_spectrum import SparseSpectrumGP

__all__ = ["PROCESSES", "SPECTRAL", "Lesson", "Member", "Trained", "initial_process", "trained_process"]

Array = NDArray[np.float64]


def exact(lesson: Lesson) -> Trained:
    """Exact regression on the samples kept: downsampling is in their choice."""
    return Trained(trained_process(lesson).condition, lesson.kept)


def dictionary(rule: Literal["variance", "error"]) -> Member:
    """Exact regression on `points` samples: evenly spread ones, improved by offering every other.

    Hyperparameters come from the chosen samples, not from the members: those of the error rule were picked
    for their errors, and would teach too large a noise.
    """

    def train(lesson: Lesson) -> Trained:
        from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP

        gp = DictionaryGP(trained_process(lesson), DictionaryConfig(size=lesson.points, rule=rule))

        def condition(X: Array, y: Array) -> Posterior:
            count = min(lesson.points, len(y))
            return gp.select(X, y, start=np.arange(count) * len(y) // count).posterior

        return Trained(condition, lesson.moving)

    return train


def ssgp_fixed(lesson: Lesson) -> Trained:
    """A sparse spectrum with the likeliest of 100 draws of its points, or with those of the earlier one."""
    return Trained(_spectrum(lesson).condition, lesson.moving)


def ssgp_learned(lesson: Lesson) -> Trained:
    """A sparse spectrum whose points are learned, until the newest trajectory is predicted no better.

    Without a prior, by maximum likelihood over points and hyperparameters at once, as the thesis: no guard.
    """
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum

    X, y, group = lesson.X[lesson.chosen], lesson.y[lesson.chosen], lesson.group[lesson.chosen]
    fit = partial(fit_sparse_spectrum, method=lesson.method, steps=lesson.steps, prior=lesson.prior)
    if lesson.prior is None:
        gp = fit(replace(_drawn_spectrum(lesson), learned=True), X, y, point_prior=False)
        return Trained(gp.condition, lesson.moving)
    newest = group == group.max()
    held_out = None if newest.all() else (X[newest], y[newest])
    known = np.ones_like(newest) if held_out is None else ~newest
    gp = fit(replace(_spectrum(lesson), learned=True), X[known], y[known], held_out=held_out)
    return Trained(gp.condition, lesson.moving)


def _spectrum(lesson: Lesson) -> SparseSpectrumGP:
    """Points that stay, and the hyperparameters found with them."""
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum

    X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
    gp = _drawn_spectrum(lesson)
    return fit_sparse_spectrum(gp, X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)


def _drawn_spectrum(lesson: Lesson) -> SparseSpectrumGP:
    """The earlier points if there are as many, else the likeliest of 100 draws, as the authors' code."""
    from etude.models.gp.sparse_spectrum import SparseSpectrumGP
    from etude.models.gp.sparse_spectrum_training import redrawn
    from etude.models.gp.spectral_posterior import SparseSpectrumPosterior

    gp, start, shape = initial_process(lesson), lesson.start, (lesson.basis, lesson.X.shape[1])
    if isinstance(start, SparseSpectrumPosterior) and start.points.shape == shape:
        return SparseSpectrumGP(start.points, gp.theta, gp.log_noise, gp.noise_floor)
    blank = SparseSpectrumGP(np.zeros(shape), gp.theta, gp.log_noise, gp.noise_floor)
    return redrawn(blank, lesson.X[lesson.chosen], lesson.y[lesson.chosen], lesson.rng)


def inducing(form: Form) -> Member:
    """`basis` inducing inputs, moved together with the hyperparameters to explain the chosen samples.

    They are chosen anew among the samples each time; with constant hyperparameters they stay there.
    """

    def train(lesson: Lesson) -> Trained:
        from etude.models.gp.inducing import InducingGP
        from etude.models.gp.inducing_training import fit_inducing, greedy_points

        X, y = lesson.X[lesson.chosen], lesson.y[lesson.chosen]
        gp = initial_process(lesson)
        Z = X[greedy_points(gp.kernel, gp.theta, X, lesson.basis)]
        start = InducingGP(gp.kernel, gp.theta, gp.log_noise, Z, form, gp.noise_floor)
        trained = fit_inducing(start, X, y, method=lesson.method, steps=lesson.steps, prior=lesson.prior)
        return Trained(trained.condition, lesson.moving)

    return train


def sogp(lesson: Lesson) -> Trained:
    """The sparse online process, sample by sample through those kept, with an exact process's parameters."""
    from etude.models.gp.sogp import SOGP

    gp = trained_process(lesson)
    online = SOGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor, capacity=lesson.basis)
    return Trained(online.condition, lesson.kept)


def local_gp(lesson: Lesson) -> Trained:
    """Local processes of `points` samples each, with an exact process's parameters; that process guides."""
    from etude.models.gp.local import LocalGP

    gp = trained_process(lesson)
    return Trained(LocalGP(gp, capacity=lesson.points).condition, lesson.moving, _guide(gp, lesson))


def lwpr(lesson: Lesson) -> Trained:
    """Receptive fields on every moving sample; an exact process is trained beside them, to guide."""
    from etude.models.lwpr.regression import LWPR

    member = LWPR(noise_floor=lesson.floor)
    return Trained(member.condition, lesson.moving, _guide(trained_process(lesson), lesson))


def _guide(gp: ExactGP, lesson: Lesson) -> Posterior:
    return gp.condition(lesson.X[lesson.kept], lesson.y[lesson.kept])


PROCESSES: dict[str, Member] = {
    "exact": exact,
    "dictionary_variance": dictionary("variance"),
    "dictionary_error": dictionary("error"),
    "thesis_dictionary_variance": thesis_dictionary("variance"),
    "thesis_dictionary_error": thesis_dictionary("error"),
    "ssgp_fixed": ssgp_fixed,
    "ssgp_learned": ssgp_learned,
    "fitc": inducing("fitc"),
    "vfe": inducing("vfe"),
    "sogp": sogp,
    "local_gp": local_gp,
    "lwpr": lwpr,
}
"""The members by the name that `model.process` gives."""
SPECTRAL = ("ssgp_fixed", "ssgp_learned")
"""Members that stand for the squared exponential kernel alone."""
