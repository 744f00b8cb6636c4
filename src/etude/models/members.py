"""The members of the model family by name: how each learns a group of commands, one or several.

A new member is a row in MEMBERS, or a plug-in: entry point `etude.models`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from etude import plugins
from etude.contracts import Array, FitData, Member, Posterior
from etude.models.gp.exact import columns_of
from etude.models.hyperparameters import before, columns, counted, initial_process, trained_process, weak
from etude.models.plugin_member import PluginMember
from etude.models.process import Posteriors, Teaching, restored, taught
from etude.models.thesis_dictionary import thesis_dictionary

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.inducing import Form
    from etude.models.gp.sparse_spectrum import SparseSpectrumGP


@dataclass(frozen=True)
class BuiltIn:
    """A member of Étude: `learn` says how it is taught."""

    learn: Callable[[FitData], Teaching]

    def __call__(self, fit: FitData) -> Posteriors:
        """The process of the group."""
        return taught(self.learn(fit))

    def restore(self, arrays: Mapping[str, Array]) -> Posteriors:
        """The process whose arrays these are."""
        return restored(arrays)


def _each(condition: Callable[[Array, Array], Posterior]) -> Callable[[Array, Array], tuple[Posterior, ...]]:
    """Condition the outputs one by one."""
    return lambda X, Y: tuple(condition(X, y) for y in columns_of(Y))


def _together(gp: ExactGP) -> Callable[[Array, Array], tuple[Posterior, ...]]:
    """Condition all outputs at the price of one."""

    def condition(X: Array, Y: Array) -> tuple[Posterior, ...]:
        if Y.shape[1] == 1:
            return (gp.condition(X, columns(Y)),)
        from etude.models.gp.shared_exact import condition_shared

        return condition_shared(gp, X, Y).outputs

    return condition


def _exact(fit: FitData) -> Teaching:
    """Exact regression on the samples kept: downsampling is in their choice.

    Where these are `inducing` ones of more, all teach through them, and an exact process on `points` guides.
    """
    gp, every = trained_process(fit), counted(fit)
    if len(fit.kept) != fit.config.inducing or len(every) <= len(fit.kept):
        return Teaching(fit, _together(gp), fit.kept)
    from etude.models.induced import Induced

    kept, points = fit.kept, min(fit.config.points, len(fit.kept))
    guided = kept[np.arange(points) * len(kept) // points]
    guides = _together(gp)(fit.X[guided], fit.Y[guided])
    return Teaching(fit, Induced(gp, fit.X[kept], fit.X[every], every, fit.fold), every, guides)


def _dictionary(rule: Literal["variance", "error"], fit: FitData) -> Teaching:
    """Exact regression on `points` samples: evenly spread ones, improved by offering every other.

    Hyperparameters come from the chosen samples, not from the members: those of the error rule were picked
    for their errors, and would teach too large a noise.
    """
    from etude.models.gp.dictionary import DictionaryConfig, DictionaryGP

    points = fit.config.points
    gp = DictionaryGP(trained_process(fit), DictionaryConfig(size=points, rule=rule))

    def condition(X: Array, y: Array) -> Posterior:
        count = min(points, len(y))
        return gp.select(X, y, start=np.arange(count) * len(y) // count).posterior

    return Teaching(fit, _each(condition), counted(fit))


def _thesis(rule: Literal["variance", "error"], fit: FitData) -> Teaching:
    """The dictionary as the thesis has it, carried from log to log."""
    gp, members = thesis_dictionary(rule, fit)
    return Teaching(fit, _together(gp), members)


def _ssgp_fixed(fit: FitData) -> Teaching:
    """A sparse spectrum with the likeliest of 100 draws of its points, or with those of the earlier one."""
    return Teaching(fit, _each(_spectrum(fit).condition), counted(fit))


def _ssgp_learned(fit: FitData) -> Teaching:
    """A sparse spectrum whose points are learned, until the newest trajectory is predicted no better.

    Without a prior, by maximum likelihood over points and hyperparameters at once, as the thesis: no guard.
    """
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum

    config, rows = fit.config, fit.chosen
    X, Y, group = fit.X[rows], fit.Y[rows], fit.group[rows]
    train = partial(fit_sparse_spectrum, method=config.method, steps=config.steps)
    if config.prior == "none":
        drawn = replace(_drawn_spectrum(fit), learned=True)
        gp = train(drawn, X, columns(Y), prior=None, point_prior=False)
        return Teaching(fit, _each(gp.condition), counted(fit))
    newest = group == group.max()
    held_out = None if newest.all() else (X[newest], columns(Y[newest]))
    known = np.ones_like(newest) if held_out is None else ~newest
    start = replace(_spectrum(fit), learned=True)
    gp = train(start, X[known], columns(Y[known]), prior="weak", held_out=held_out)
    return Teaching(fit, _each(gp.condition), counted(fit))


def _spectrum(fit: FitData) -> SparseSpectrumGP:
    """Points that stay, and the hyperparameters found with them."""
    from etude.models.gp.sparse_spectrum_training import fit_sparse_spectrum

    config, X, y = fit.config, fit.X[fit.chosen], columns(fit.Y[fit.chosen])
    gp, prior = _drawn_spectrum(fit), weak(fit, X, y)
    return fit_sparse_spectrum(gp, X, y, method=config.method, steps=config.steps, prior=prior)


def _drawn_spectrum(fit: FitData) -> SparseSpectrumGP:
    """The earlier points if there are as many, else the likeliest of 100 draws, as the authors' code."""
    from etude.models.gp.sparse_spectrum import SparseSpectrumGP
    from etude.models.gp.sparse_spectrum_training import redrawn
    from etude.models.gp.spectral_posterior import SparseSpectrumPosterior

    gp, earlier, shape = initial_process(fit), before(fit), (fit.config.basis, fit.X.shape[1])
    start = earlier.own[0] if isinstance(earlier, Posteriors) else None
    if isinstance(start, SparseSpectrumPosterior) and start.points.shape == shape:
        return SparseSpectrumGP(start.points, gp.theta, gp.log_noise, gp.noise_floor)
    blank = SparseSpectrumGP(np.zeros(shape), gp.theta, gp.log_noise, gp.noise_floor)
    return redrawn(blank, fit.X[fit.chosen], columns(fit.Y[fit.chosen]), fit.rng)


def _inducing(form: Form, fit: FitData) -> Teaching:
    """`basis` inducing inputs, moved together with the hyperparameters to explain the chosen samples.

    They are chosen anew among the samples each time; with held hyperparameters they stay there.
    """
    from etude.models.gp.inducing import InducingGP
    from etude.models.gp.inducing_training import fit_inducing, greedy_points

    config, X, y = fit.config, fit.X[fit.chosen], columns(fit.Y[fit.chosen])
    gp = initial_process(fit)
    Z = X[greedy_points(gp.kernel, gp.theta, X, config.basis)]
    start = InducingGP(gp.kernel, gp.theta, gp.log_noise, Z, form, gp.noise_floor)
    prior = weak(fit, X, y)
    trained = fit_inducing(start, X, y, method=config.method, steps=config.steps, prior=prior)
    return Teaching(fit, _each(trained.condition), counted(fit))


def _sogp(fit: FitData) -> Teaching:
    """The sparse online process, sample by sample through those kept, with an exact process's parameters."""
    from etude.models.gp.sogp import SOGP

    gp = trained_process(fit)
    online = SOGP(gp.kernel, gp.theta, gp.log_noise, gp.noise_floor, capacity=fit.config.basis)
    return Teaching(fit, _each(online.condition), fit.kept)


def _local_gp(fit: FitData) -> Teaching:
    """Local processes of `points` samples each, with an exact process's parameters; that process guides."""
    from etude.models.gp.local import LocalGP

    gp = trained_process(fit)
    member = LocalGP(gp, capacity=fit.config.points)
    return Teaching(fit, _each(member.condition), counted(fit), _guides(gp, fit))


def _lwpr(fit: FitData) -> Teaching:
    """Receptive fields on every sample that counts; an exact process is trained beside them, to guide."""
    from etude.models.lwpr.regression import LWPR

    member = LWPR(noise_floor=float(fit.floor.max()))
    return Teaching(fit, _each(member.condition), counted(fit), _guides(trained_process(fit), fit))


def _guides(gp: ExactGP, fit: FitData) -> tuple[Posterior, ...]:
    return _together(gp)(fit.X[fit.kept], fit.Y[fit.kept])


exact = BuiltIn(_exact)
dictionary_variance = BuiltIn(partial(_dictionary, "variance"))
dictionary_error = BuiltIn(partial(_dictionary, "error"))
thesis_dictionary_variance = BuiltIn(partial(_thesis, "variance"))
thesis_dictionary_error = BuiltIn(partial(_thesis, "error"))
ssgp_fixed = BuiltIn(_ssgp_fixed)
ssgp_learned = BuiltIn(_ssgp_learned)
fitc = BuiltIn(partial(_inducing, "fitc"))
vfe = BuiltIn(partial(_inducing, "vfe"))
sogp = BuiltIn(_sogp)
local_gp = BuiltIn(_local_gp)
lwpr = BuiltIn(_lwpr)

MEMBERS: dict[str, Member] = {
    "exact": exact,
    "dictionary_variance": dictionary_variance,
    "dictionary_error": dictionary_error,
    "thesis_dictionary_variance": thesis_dictionary_variance,
    "thesis_dictionary_error": thesis_dictionary_error,
    "ssgp_fixed": ssgp_fixed,
    "ssgp_learned": ssgp_learned,
    "fitc": fitc,
    "vfe": vfe,
    "sogp": sogp,
    "local_gp": local_gp,
    "lwpr": lwpr,
}
"""The members that learn commands one by one, by the name that `model.process` gives."""


def member_named(name: str) -> Member:
    """A built-in member, or a plug-in's, whose processes are checked.

    Raises:
        UsageError: there is none of that name, or it cannot be stored.
    """
    if name in MEMBERS:
        return MEMBERS[name]
    if name in plugins.BUILT_IN["etude.models"]:  # loaded only when it is asked for
        return cast("Member", plugins.load("etude.models", name))
    return PluginMember.of(name, plugins.load("etude.models", name))
