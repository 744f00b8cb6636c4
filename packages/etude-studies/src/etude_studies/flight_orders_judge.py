"""Measures of the models of one seed: errors on the tests, deviations over the reference states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude.campaign import label
from etude.design import reference_states
from etude.models import ExactGP, ExactPosterior, LearnedModel, ModelSelection, score_trajectories
from etude.protocols import Trajectory
from etude.types import Array, Log, Samples
from etude_studies.flight_orders_world import World
from etude_studies.flight_world import models_by_rung

FIGURES = ("mae", "mae_after", "z2", "coverage", "nlpd", "nlpd_t", "deviation")
REFERENCE_STATES = 300
"""Along all intended flights."""


@dataclass(frozen=True, eq=False)
class Round:
    """What there is after some flights.

    Attributes:
        logs: of each flight. ladder: what learned from them. parameters: (P,) of each flight.
    """

    logs: tuple[Log, ...]
    selection: ModelSelection
    parameters: tuple[Array, ...]

    @property
    def process(self) -> LearnedModel:
        """The process on the commands: it chooses the flights, whichever model is in use."""
        return self.selection.model.of_structure("gp")


@dataclass(frozen=True, eq=False)
class Judge:
    """What the models of one seed are measured by.

    Attributes:
        reference: (r, D) model inputs along the intended flights.
        process: with the hyperparameters of the first flight, in standardised outputs.
        deviation: of what it learned, mean over the commands, V.
    """

    reference: Array
    process: ExactGP
    deviation: float

    @classmethod
    def of(cls, world: World, intended: Sequence[Trajectory], first: Round) -> Judge:
        inputs = world.judging(first.process.inputs)
        posterior, units = known_by(first.process)
        (X,) = reference_states(inputs, [tuple(range(len(units)))], REFERENCE_STATES, intended)
        process = ExactGP(posterior.kernel, posterior.theta, 0.5 * float(np.log(posterior.noise_variance)))
        return cls(X, process, float(units.mean()))

    def measures(self, last: Round, tests: Mapping[str, Samples]) -> dict[str, Any]:
        """Figures of every kind on every test set, and deviations over the reference states."""
        models = {**models_by_rung(last.selection), "ladder": last.selection.model}
        scores = {
            name: {kind: _figures(model, test) for kind, model in models.items()}
            for name, test in tests.items()
        }
        reference = {"latent": self.latent(last), "latent_common": self.latent_common(last)}
        return {"tests": scores, "reference": reference, "chosen": label(last.selection.model.in_use)}

    def latent(self, last: Round) -> float:
        """Mean predicted deviation of the process in use, without noise, V."""
        posterior, units = known_by(last.process)
        return float(units.mean() * np.sqrt(posterior.predict(self.reference)[1]).mean())

    def latent_common(self, last: Round) -> float:
        """The same with the first flight's hyperparameters: what the flights alone made of it, V."""
        X = known_by(last.process)[0].X
        posterior = self.process.condition(X, np.zeros(len(X)))
        return float(self.deviation * np.sqrt(posterior.predict(self.reference)[1]).mean())


def known_by(model: LearnedModel) -> tuple[ExactPosterior, Array]:
    """The process that all commands share, and each command's unit (J,), V."""
    ((posterior, commands),) = model.latents()
    assert isinstance(posterior, ExactPosterior)
    (candidate,) = (c for c in model.candidates if c.weights.any())
    return posterior, candidate.units[1, list(commands)]


def _figures(model: LearnedModel, test: Samples) -> dict[str, float | None]:
    scores = score_trajectories(test, *model.posterior(test.log), model.student)
    means = {name: getattr(scores, name) for name in FIGURES}
    return {name: float(np.nanmean(v)) if np.isfinite(v).any() else None for name, v in means.items()}
