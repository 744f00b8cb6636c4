"""The model as a design reads it: latent functions, planned noise, guides, or a prior from the limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude.abilities import SupportsRegressors
from etude.design.criteria import Batch, batch_of
from etude.errors import UsageError
from etude.models.config import ModelConfig
from etude.models.data.fit_data import kernel_for
from etude.models.gp.exact import ExactPosterior, posterior_given
from etude.models.process_abilities import SupportsGuide, SupportsSamples
from etude.protocols import Candidate, Inputs, Model, Physics, Posterior
from etude.types import Array


@dataclass(frozen=True, eq=False)
class Latent:
    """One latent function of a model.

    Attributes:
        posterior: its posterior; for a model without covariances, the guide.
        commands: numbers of the commands that it predicts.
        factors: from the function's unit to each command's.
    """

    posterior: Posterior
    commands: tuple[int, ...]
    factors: Array

    @property
    def raw_scale(self) -> float:
        """Divisor that turns variances into squared units of the commands, summed over these."""
        return 1.0 / float(np.sum(self.factors**2))


def latents_of(model: Model) -> tuple[Latent, ...]:
    """The model's latent functions, ordered by their first command; each command belongs to one of them.

    A structure without a Gaussian process has no uncertainty where the robot has not been. For such a command
    another structure of the model is used.

    Raises:
        UsageError: a command without any process.
    """
    latents: list[Latent] = []
    chosen = _chosen(model)
    for place in sorted(set(chosen.values())):
        candidate = model.candidates[place]
        assert candidate.process is not None
        for posterior, columns in candidate.process.latents():
            selected = [i for i in columns if chosen[candidate.commands[i]] == place]
            if selected:
                commands = tuple(candidate.commands[i] for i in selected)
                latents.append(Latent(_guide(posterior), commands, candidate.units[1, selected]))
    return tuple(sorted(latents, key=lambda latent: latent.commands))


def planned(latents: Sequence[Latent], share: float, inducing: int) -> tuple[Latent, ...]:
    """The latent functions, prepared for planned samples.

    Args:
        latents: see `latents_of`.
        share: number of planned samples over that of logged ones; 1: a planned sample counts as one logged.
        inducing: exact processes with more samples are reduced to this many; 0: never reduced.
    """
    posteriors = (fast_posterior(latent.posterior, inducing) for latent in latents)
    return tuple(
        replace(latent, posterior=p if share == 1.0 else PlannedPosterior(p, p.noise_variance * share))
        for latent, p in zip(latents, posteriors, strict=True)
    )


def of_parameters(latents: Sequence[Latent], physics: Mapping[str, Physics]) -> tuple[Latent, ...]:
    """Posteriors of each command's base parameters by linear regression on the learned samples, for `d_opt`.

    Samples and noise are those of the model's processes; the prior is that of the identification. The
    information of the weights is then Lambda0 of `d_opt`.

    Args:
        latents: the model's own.
        physics: of the kind; one of them gives the regressors of the commands.

    Raises:
        UsageError: none has regressors, or the processes keep no samples.
    """
    from etude.models.gp.bayesian_linear import BayesianLinear

    regressors = _regressed(physics).regressors()
    made = []
    for latent in latents:
        X, noise = _samples(latent.posterior), latent.posterior.noise_variance
        for command, factor in zip(latent.commands, latent.factors, strict=True):
            regression = BayesianLinear(regressors[command], -math.log(factor), 0.5 * math.log(noise))
            posterior = regression.condition(X, np.zeros(len(X)))
            made.append(Latent(posterior, (command,), np.array([factor])))
    return tuple(made)


@dataclass(frozen=True, eq=False)
class PlannedPosterior:
    """A posterior with the noise of planned samples: these are fewer than the logged ones, but less noisy.

    Attributes:
        posterior: the model's.
        noise_variance: of a planned sample: sn^2 times planned over logged samples.
    """

    posterior: Posterior
    noise_variance: float

    @property
    def signal_variance(self) -> float:
        return self.posterior.signal_variance

    def factors(self, X: Array) -> Batch:
        """The posterior's own batch, which does not depend on the noise."""
        return batch_of(self.posterior, X)

    def predict(self, X: Array) -> tuple[Array, Array]:
        return self.posterior.predict(X)

    def covariance(self, X: Array, Z: Array) -> Array:
        return self.posterior.covariance(X, Z)

    def covariance_gradient(self, X: Array, Z: Array, G: Array) -> Array:
        return self.posterior.covariance_gradient(X, Z, G)

    def variance_gradient(self, X: Array, g: Array) -> Array:
        return self.posterior.variance_gradient(X, g)

    def mean_gradient(self, X: Array) -> Array:
        return self.posterior.mean_gradient(X)


def fast_posterior(posterior: Posterior, count: int) -> Posterior:
    """Sparse form of an exact posterior with `count` inducing points; unchanged for others, or for count 0.

    All samples still count (Titsias 2009, whose variance is that of DTC), and hyperparameters stay the same.
    The inducing points are the samples that a pivoted Cholesky factorisation selects first.
    """
    if not count or not isinstance(posterior, ExactPosterior) or len(posterior.X) <= count:
        return posterior
    from etude.models.gp.inducing import InducingGP
    from etude.models.gp.inducing_training import greedy_points

    kernel, theta, X = posterior.kernel, posterior.theta, posterior.X
    Z = X[greedy_points(kernel, theta, X, count)]
    log_noise = 0.5 * math.log(posterior.noise_variance)
    return InducingGP(kernel, theta, log_noise, Z).condition(X, posterior.y)


def _chosen(model: Model) -> dict[int, int]:
    """Index of the candidate, with a process, that represents each command.

    It is the default candidate of the structure in use. If that has no process, it is the same structure with
    one, then the identified one, then the first.
    """
    places: dict[int, int] = {}
    for command in sorted({j for candidate in model.candidates for j in candidate.commands}):
        members = [(i, c) for i, c in enumerate(model.candidates) if command in c.commands]
        in_use = max(members, key=lambda pair: _weight(pair[1], command))[1].structure
        ranked = [
            (c.structure == in_use, c.structure == f"{in_use}+gp", c.structure == "identified+gp", -i)
            for i, c in members
            if c.process is not None
        ]
        if not ranked:
            raise UsageError(
                f"command {command} has no process, so its uncertainty is unknown",
                next_step="Train with a structure that has one, such as model.rung = 'auto'.",
            )
        places[command] = -max(ranked)[-1]
    return places


def _weight(candidate: Candidate, command: int) -> float:
    return float(candidate.weights[candidate.commands.index(command)])


def _guide(posterior: Posterior) -> Posterior:
    """The posterior to design with: the `guide` of a posterior without covariances, else itself."""
    return posterior.guide if isinstance(posterior, SupportsGuide) else posterior


def _regressed(physics: Mapping[str, Physics]) -> SupportsRegressors:
    """The first that offers regressors."""
    for structure in physics.values():
        if isinstance(structure, SupportsRegressors):
            return structure
    raise UsageError(
        "d_opt needs the identified model, but this robot has none",
        next_step="Add a URDF or MJCF to the robot file, or choose the criterion info_gain.",
    )


def _samples(posterior: Posterior) -> Array:
    if not isinstance(posterior, SupportsSamples):
        raise UsageError(
            f"d_opt needs the samples learned so far, and a {type(posterior).__name__} keeps none",
            next_step="Choose the criterion info_gain, or a model that keeps samples.",
        )
    return np.asarray(posterior.X, dtype=float)


SIGNAL, NOISE = 0.3, 0.01
"""Standard deviations of each term of a command and of its noise, as fractions of the command's limit."""
PLAN = "_des"
"""Suffix of the names of planned channels, which share the limits of the measured ones."""


def prior_latents(
    inputs: Inputs,
    ranges: Mapping[str, tuple[Array, Array]],
    limit: Array,
    config: ModelConfig,
    commands: tuple[str, ...],
) -> tuple[Latent, ...] | None:
    """Prior before any log: the model's kernel for each group of commands, its length scales from the limits.

    Commands are relative to their limits. A posterior needs a sample: it has one, zero at rest in the middle
    of the ranges.

    Args:
        inputs: of the model. ranges: lower and upper (parts,) of channels. limit: (J,) of the commands.
        config: of the model. commands: names of the J commands.

    Returns:
        None where an input has no limits, since its range is then unknown.
    """
    reach = _reach(inputs, ranges)
    if reach is None:
        return None
    middle, half = reach
    every = tuple(range(len(commands)))
    latents = []
    for group in [every] if config.sharing == "shared" else [(j,) for j in every]:
        names = tuple(commands[j] for j in group)
        kernel = kernel_for(config.kernel, inputs.columns, names, middle[None])
        theta = kernel.initial(half, SIGNAL)
        posterior = posterior_given(kernel, theta, NOISE**2, middle[None], np.zeros(1))
        latents.append(Latent(posterior, group, np.asarray(limit, dtype=float)[list(group)]))
    return tuple(latents)


def _reach(inputs: Inputs, ranges: Mapping[str, tuple[Array, Array]]) -> tuple[Array, Array] | None:
    """(D,) middle and half range of every input; 0 and 1 for an input with an op."""
    middle, half = [], []
    place: dict[str, int] = {}
    for channel, _, _, op in inputs.columns:
        if op:
            middle.append(0.0)
            half.append(1.0)
            continue
        name = channel.removesuffix(PLAN)
        number = place[name] = place.get(name, -1) + 1
        if name not in ranges or number >= len(ranges[name][0]):
            return None
        low, high = (float(end[number]) for end in ranges[name])
        if not (math.isfinite(high - low) and high > low):
            return None
        middle.append(0.5 * (low + high))
        half.append(0.5 * (high - low))
    return np.array(middle), np.array(half)
