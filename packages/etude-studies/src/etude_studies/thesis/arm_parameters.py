"""Hyperparameters of a run's processes, and how far training moved them (table 6.2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from etude.models import ExactPosterior, LearnedModel, ModelConfig, SquaredExponential, fit, initial_gp
from etude.protocols import Posterior
from etude.types import Array
from etude_studies.measured import Measured


def parameter_figures(model: LearnedModel, before: LearnedModel | None, k: int) -> Iterator[Measured]:
    """Of every command's process: lengths by input, deviations of signal and noise in the command's unit, the
    negative log likelihood, and how far the lengths moved from those of the model `before`; and the means.
    """
    yield from with_means(list(_own_figures(model, before, k)))


def with_means(rows: list[Measured]) -> Iterator[Measured]:
    """The rows, and of each measure the mean over commands."""
    yield from rows
    for name, line, k in dict.fromkeys((row.measure, row.model, row.k) for row in rows):
        values = [row.value for row in rows if (row.measure, row.model) == (name, line)]
        yield Measured(k, "", line, "mean", name, float(np.mean(values)))


def _own_figures(model: LearnedModel, before: LearnedModel | None, k: int) -> Iterator[Measured]:
    lengths_before = (
        {}
        if before is None
        else {name: lengths_of(posterior_before) for name, posterior_before, _ in _processes(before)}
    )
    for name, posterior, factor in _processes(model):
        yield Measured(k, "", "", name, "noise_sd", factor * math.sqrt(posterior.noise_variance))
        yield Measured(k, "", "", name, "signal_sd", factor * math.sqrt(posterior.signal_variance))
        if isinstance(posterior, ExactPosterior):
            yield Measured(k, "", "", name, "nlml", negative_log_likelihood(posterior))
        yield from _length_rows(model, k, "", name, lengths_of(posterior), lengths_before)


def trained_again(
    model: LearnedModel, before: LearnedModel, config: ModelConfig, k: int
) -> Iterator[Measured]:
    """The members kept and the hyperparameters trained from the start values: the last row of table 6.2."""
    yield from with_means(list(_anew(model, before, config, k)))


def _anew(model: LearnedModel, before: LearnedModel, config: ModelConfig, k: int) -> Iterator[Measured]:
    lengths_before = {name: lengths_of(posterior_before) for name, posterior_before, _ in _processes(before)}
    for name, learned, _ in _processes(model):
        assert isinstance(learned, ExactPosterior)
        start = initial_gp(learned.kernel, learned.X, learned.y)
        anew = fit(start, learned.X, learned.y, method=config.method, steps=config.steps, prior=None)
        yield from _length_rows(model, k, "again", name, np.exp(anew.theta[1:]), lengths_before)


def negative_log_likelihood(posterior: ExactPosterior) -> float:
    """-log p(y | X): Rasmussen and Williams (2006), (2.30)."""
    y, diagonal = posterior.y, np.diagonal(posterior.L)
    constant = 0.5 * len(y) * math.log(2.0 * math.pi)
    return float(0.5 * y @ posterior.alpha + np.log(diagonal).sum() + constant)


def lengths_of(posterior: object) -> Array:
    """(D,) lengths of a squared exponential process; none of one that has another kernel."""
    if not isinstance(getattr(posterior, "kernel", None), SquaredExponential):
        return np.zeros(0)
    return np.asarray(np.exp(posterior.theta[1:]))  # type: ignore[attr-defined]


def log_distance(lengths: Array, others: Array) -> float:
    """Root mean square of the log ratios of two sets of lengths (D,)."""
    return float(np.sqrt(np.mean(np.log(lengths / others) ** 2)))


def _length_rows(
    model: LearnedModel, k: int, line: str, name: str, lengths: Array, lengths_before: Mapping[str, Array]
) -> Iterator[Measured]:
    for column, length in zip(model.inputs.columns, lengths, strict=False):
        if not column[3]:  # friction columns of one channel have no name of their own
            yield Measured(k, "", line, name, f"length_{column[0]}_{column[1]}", float(length))
    if len(lengths) and len(lengths_before.get(name, ())) == len(lengths):
        yield Measured(k, "", line, name, "length_change", log_distance(lengths, lengths_before[name]))


def _processes(model: LearnedModel) -> Iterator[tuple[str, Posterior, float]]:
    """Command, posterior and factor of the default's processes of one command each, of structures in use."""
    for candidate in model.candidates:
        if len(candidate.commands) > 1 or candidate.process is None:
            continue
        (j,), latents = candidate.commands, candidate.process.latents()
        in_use = candidate.structure == model.chosen[j] and getattr(candidate, "name", "default") == "default"
        if latents and in_use:
            yield model.commands[j], latents[0][0], float(candidate.units[1, 0])
