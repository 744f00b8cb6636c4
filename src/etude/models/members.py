"""The members of the model family by name, built in or brought by another package.

A new member is a row of the table of plug-ins, `etude.models`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from etude import plugins
from etude.errors import EtudeError, UsageError
from etude.models.data.fit_data import columns, complete_samples, initial_process, trained_process, weak
from etude.models.gp.exact import columns_of
from etude.models.process import Condition, Posteriors, Teaching, restored, taught
from etude.protocols import FitData, Member, Posterior, Process
from etude.types import Array

if TYPE_CHECKING:  # a campaign loads only the member that it uses
    from etude.models.gp.exact import ExactGP
    from etude.models.gp.inducing import Form


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


def each_output(
    condition: Callable[[Array, Array], Posterior],
) -> Callable[[Array, Array], tuple[Posterior, ...]]:
    """Condition the outputs one by one."""
    return lambda X, Y: tuple(condition(X, y) for y in columns_of(Y))


def shared_outputs(gp: ExactGP) -> Condition:
    """Condition all outputs at the price of one."""

    def condition(X: Array, Y: Array) -> tuple[Posterior, ...]:
        if Y.shape[1] == 1:
            return (gp.condition(X, columns(Y)),)
        from etude.models.gp.shared_exact import condition_shared

        return condition_shared(gp, X, Y).outputs

    return condition


TEACH = 4
"""Samples for each inducing input at most: with all of 11,000 no error of a simulated arm was less."""


def _exact(fit: FitData) -> Teaching:
    """Exact regression on the samples kept: downsampling is in their choice.

    Where these are `inducing` ones of more, up to `TEACH` times as many teach through those of them that tell
    something, and an exact process on `points` guides.
    """
    gp, every = trained_process(fit), complete_samples(fit)
    most = min(len(every), TEACH * fit.config.inducing)
    every = every[np.arange(most) * len(every) // most] if fit.config.inducing else every
    if len(fit.kept) != fit.config.inducing or len(every) <= len(fit.kept):
        return Teaching(fit, shared_outputs(gp), fit.kept)
    from etude.models.gp.inducing import Induced, telling_inputs

    basis, points = fit.kept, min(fit.config.points, len(fit.kept))
    guided = basis[np.arange(points) * len(basis) // points]
    guides = shared_outputs(gp)(fit.X[guided], fit.Y[guided])
    Z = telling_inputs(gp, fit.X[basis])
    return Teaching(fit, Induced(gp, Z, fit.X[every], every, fit.fold), every, guides)


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
    return Teaching(fit, each_output(trained.condition), complete_samples(fit))


def guides(gp: ExactGP, fit: FitData) -> tuple[Posterior, ...]:
    """Exact posteriors that a design sees in place of a member without covariances."""
    return shared_outputs(gp)(fit.X[fit.kept], fit.Y[fit.kept])


exact = BuiltIn(_exact)
fitc = BuiltIn(partial(_inducing, "fitc"))
vfe = BuiltIn(partial(_inducing, "vfe"))


METHODS = ("latents", "predict", "held_out", "arrays", "c")
VALUES = ("noise_variance", "signal_variance")


@dataclass(frozen=True)
class PluginMember:
    """What a plug-in names, as a member of the family."""

    name: str
    wrapped: Any

    @classmethod
    def of(cls, name: str, member: Any) -> PluginMember:
        """The member. UsageError if it cannot learn or be stored."""
        if not callable(member) or not isinstance(member, Member):
            raise UsageError(
                f"the model {name!r} is not a function with an attribute `restore`", next_step=_ASK
            )
        return cls(name, member)

    def __call__(self, fit: FitData) -> Process:
        """The process of the group. UsageError if it is none."""
        return self._checked(self._call(lambda: self.wrapped(fit)), fit.X[:3], fit.Y.shape[1])

    def restore(self, arrays: Mapping[str, Array]) -> Process:
        """The process whose arrays these are."""
        return cast("Process", self._call(lambda: self.wrapped.restore(arrays)))

    def _call(self, what: Callable[[], Any]) -> Any:
        try:
            return what()
        except EtudeError:
            raise
        except Exception as error:
            raise self._error(f"fails ({type(error).__name__}: {error})") from error

    def _checked(self, process: Any, X: Array, commands: int) -> Process:
        missing = [name for name in METHODS if not callable(getattr(process, name, None))]
        missing += [name for name in VALUES if not hasattr(process, name)]
        if missing:
            raise self._error(f"makes a process without {', '.join(missing)}")
        mean, variance = self._call(lambda: process.predict(X))
        values = {"mean": mean, "variance": variance}
        for name, shape in {
            **dict.fromkeys(values, (len(X), commands)),
            **dict.fromkeys(VALUES, (commands,)),
        }.items():
            value = np.asarray(values.get(name, getattr(process, name, None)), dtype=float)
            if value.shape != shape:
                raise self._error(f"gives a {name} of shape {value.shape}, not {shape}")
            if not np.isfinite(value).all() or (name != "mean" and bool((value < 0.0).any())):
                raise self._error(f"returns a {name} that is not a number, or below zero")
        return cast("Process", process)

    def _error(self, what: str) -> UsageError:
        return UsageError(f"the model {self.name!r} {what}", next_step=_ASK)


_ASK = "Ask the author of the plug-in; etude.testing.ProcessSuite shows the failure."


def member_named(name: str) -> Member:
    """A built-in member, or a plug-in's, whose processes are checked.

    Raises:
        UsageError: there is none of that name, or it cannot be stored.
    """
    if name in plugins.BUILT_IN["etude.models"]:  # loaded only when it is asked for
        return cast("Member", plugins.load("etude.models", name))
    return PluginMember.of(name, plugins.load("etude.models", name))
