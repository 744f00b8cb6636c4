"""What a model expects of itself where the tasks are: the facts that the stop rule rests on."""

from __future__ import annotations

from typing import Any

import numpy as np

from etude.campaign.propose.motions import typical_motions
from etude.campaign.record.folder import Campaign
from etude.campaign.record.state import State
from etude.design.latents import latents_of
from etude.design.objective import MOTIONS, reference_states
from etude.models.contracts import HasKernel
from etude.models.model import LearnedModel
from etude.protocols import Candidate
from etude.types import Array

REFERENCE_STREAM = 5
"""The reference motions of the stop rule are the same for all rounds, so that its numbers can be compared."""
STATES = 100


def forecast(
    model: LearnedModel, before: LearnedModel | None, campaign: Campaign, state: State
) -> dict[str, Any]:
    """Facts for the `trained` event, each list per command, in its unit.

    forecast_deviation: root mean square error expected at the reference states, calibrated;
    latent_deviation, noise_deviation: of the process, uncalibrated, and of its noise;
    moved: largest change of a logarithmic length scale since the model before, in the same rungs, or null.
    """
    rng = np.random.default_rng([state.seed, REFERENCE_STREAM])
    motions = typical_motions(campaign, rng, MOTIONS)
    latents = latents_of(model)
    groups = [latent.commands for latent in latents]
    latent, noise, expected = (np.zeros(len(model.commands)) for _ in range(3))
    for view, X in zip(latents, reference_states(model.inputs, groups, STATES, motions), strict=True):
        own = list(view.commands)
        latent[own] = view.factors * np.sqrt(np.mean(view.posterior.predict(X)[1]))
        noise[own] = view.factors * np.sqrt(view.posterior.noise_variance)
        expected[own] = [expected_variance(model, j, X) for j in own]
    return {
        "forecast_deviation": np.sqrt(expected).tolist(),
        "latent_deviation": latent.tolist(),
        "noise_deviation": noise.tolist(),
        "moved": None if before is None else _moved(model, before),
    }


def expected_variance(model: LearnedModel, command: int, X: Array) -> float:
    """Mean squared error expected of a command at model inputs X (r, D), without the noise of samples."""
    found = 0.0
    for candidate in model.candidates:
        if command in candidate.commands and candidate.process is not None:
            place = candidate.commands.index(command)
            variance = candidate.process.predict(X)[1][:, place] * candidate.units[1, place] ** 2
            found += candidate.weights[place] * candidate.calibration[place] * float(variance.mean())
    return found


def _moved(model: LearnedModel, before: LearnedModel) -> float | None:
    """Largest |change| of a logarithmic length scale over all commands; None if kernels differ or lack."""
    moves = []
    for command, rung in enumerate(model.chosen):
        now, then = (_posterior(m.candidates, rung, command) for m in (model, before))
        if not (isinstance(now, HasKernel) and isinstance(then, HasKernel)):
            return None
        if now.theta.shape != then.theta.shape:
            return None
        lengths = np.array([role == "length" for role in now.kernel.roles()])
        if lengths.any():
            moves.append(float(np.abs(now.theta - then.theta)[lengths].max()))
    return max(moves, default=None)


def _posterior(candidates: tuple[Candidate, ...], rung: str, command: int) -> Any:
    """The process of a command in that rung, if there is one."""
    for candidate in candidates:
        if candidate.rung == rung and command in candidate.commands and candidate.process is not None:
            place = candidate.commands.index(command)
            for posterior, places in candidate.process.latents():
                if place in places:
                    return posterior
    return None
