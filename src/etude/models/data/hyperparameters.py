"""Hyperparameters from round to round, and the training of an exact process, which many members borrow."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from etude.models.protocols import HasKernel
from etude.protocols import FitData, Process
from etude.types import Array, Index

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.training import Prior

LENGTH_FACTORS = (1.0, 3.0, 1.0 / 3.0, 10.0, 0.1)
"""Starts of a training: half ranges of the inputs as lengths, times these."""


def counted(fit: FitData) -> Index:
    """Positions of the samples at which every command of the group says something."""
    return np.flatnonzero((fit.usable & fit.moving).all(axis=1))


def columns(Y: Array) -> Array:
    """Outputs as trainings take them: (n,) of a single command, else (n, m)."""
    return Y[:, 0].copy() if Y.shape[1] == 1 else Y


def before(fit: FitData) -> Process | None:
    """The last round's process, if training is to go on from it."""
    return None if fit.config.schedule == "reinitialise" else fit.start


def hyperparameters(fit: FitData) -> tuple[Array, float] | None:
    """theta and noise variance to train on from, if the last round's kernel was the same."""
    start = before(fit)
    if start is None:
        return None
    latent = start.latents()[0][0]
    noise = latent.noise_variance
    if not isinstance(latent, HasKernel) or latent.kernel != fit.kernels[0]:
        return None
    return latent.theta, noise


def is_held(fit: FitData) -> bool:
    """Whether the hyperparameters stay as they are: a schedule that keeps them, and there are some."""
    return fit.config.schedule in ("constant", "first") and hyperparameters(fit) is not None


def on_schedule(fit: FitData) -> FitData:
    """The data with what the schedule leaves to do: held hyperparameters come with no steps, no floor; fewer
    steps go on from earlier ones.
    """
    if not is_held(fit):
        warm = fit.config.warm_steps
        if not warm or hyperparameters(fit) is None:
            return fit
        return replace(fit, config=replace(fit.config, steps=warm))
    return replace(fit, config=replace(fit.config, steps=0), floor=np.zeros_like(fit.floor))


def initial_process(fit: FitData) -> ExactGP:
    """The process to train from: the earlier hyperparameters if they fit, else the data's scales."""
    known = _known(fit)
    return _fresh(fit) if known is None else known


def trained_process(fit: FitData) -> ExactGP:
    """An exact process with the hyperparameters of the chosen samples."""
    config, start = fit.config, initial_process(fit)
    X, y = fit.X[fit.chosen], columns(fit.Y[fit.chosen])
    if y.ndim == 1 and config.starts == 1:
        from etude.models.gp.training import fit as fit_one

        return fit_one(start, X, y, method=config.method, steps=config.steps, prior=weak(fit, X, y))
    return start if config.steps == 0 else _shared(fit)


def weak(fit: FitData, X: Array, y: Array) -> Prior | None:
    """The weak prior of these data, if the configuration has one."""
    from etude.models.gp.training import weak_prior

    return weak_prior(fit.kernels[0], X, y) if fit.config.prior == "weak" else None


def _fresh(fit: FitData) -> ExactGP:
    from etude.models.gp.training import initial_gp

    floor = float(fit.floor.max())
    return initial_gp(fit.kernels[0], fit.X[fit.chosen], telling(fit), noise_floor=floor)


def _known(fit: FitData) -> ExactGP | None:
    earlier = hyperparameters(fit)
    if earlier is None:
        return None
    from etude.models.gp.exact import ExactGP

    (theta, noise), floor = earlier, float(fit.floor.max())
    learned = max(noise - floor**2, 1e-4 * noise)  # what was found above the floor stays learned noise
    return ExactGP(fit.kernels[0], theta, 0.5 * float(np.log(learned)), floor)


def telling(fit: FitData) -> Array:
    """The chosen outputs that vary, or the first: a constant one says nothing about lengths."""
    Y = fit.Y[fit.chosen]
    if Y.shape[1] == 1:
        return columns(Y)
    varying = np.flatnonzero(Y.std(axis=0) > 0.0)
    return Y[:, varying] if len(varying) else Y[:, :1]


def _shared(fit: FitData) -> ExactGP:
    """Trained from several starts, or for several commands."""
    from etude.models.gp.shared_exact import fit_shared

    config, known = fit.config, _known(fit)
    X, Y = fit.X[fit.chosen], telling(fit)
    Y = Y[:, None] if Y.ndim == 1 else Y
    start, others = known, []
    if known is None or config.starts > 1:
        start = _fresh(fit)
        lengths = np.array([role == "length" for role in fit.kernels[0].roles()] + [False])
        others = [start.parameters + np.log(f) * lengths for f in LENGTH_FACTORS[1 : config.starts]]
        others += [] if known is None else [known.parameters]
    assert start is not None
    prior = weak(fit, X, Y)
    return fit_shared(start, X, Y, steps=config.steps, method=config.method, prior=prior, others=others)
