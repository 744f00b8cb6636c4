"""What a model expects of itself where the tasks are: the facts that the stop rule rests on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.campaign.folder import Campaign
from etude.campaign.state import State
from etude.design.reference import random_motions, reference_states
from etude.models.contracts import HasKernel
from etude.models.inverse_dynamics import InverseDynamicsModel

Array = NDArray[np.float64]
REFERENCE_STREAM = 5
"""The reference motions of the stop rule are the same for all rounds, so that its numbers can be compared."""
STATES = 100


def outlook(
    model: InverseDynamicsModel, before: InverseDynamicsModel | None, campaign: Campaign, state: State
) -> dict[str, Any]:
    """Facts for the `trained` event, each list per axis, in command units.

    forecast_deviation: root mean square error expected at the reference states, calibrated;
    latent_deviation, noise_deviation: of the process, uncalibrated, and of its noise;
    moved: largest change of a logarithmic length scale since the model of the same kind before, or null.
    """
    rng = np.random.default_rng([state.seed, REFERENCE_STREAM])
    motions = random_motions(rng, campaign.spec, campaign.config.trajectory)
    references = reference_states(model.features, model.stick_velocity, STATES, motions)
    pairs = zip(model.posteriors, references, strict=True)
    latent = np.array([np.sqrt(np.mean(posterior.predict(X)[1])) for posterior, X in pairs])
    forecast = latent * np.sqrt(model.scale)
    if model.kind == "identified" and model.residual_variance is not None:
        forecast = np.sqrt(model.residual_variance)
    noise = np.sqrt([posterior.noise_variance for posterior in model.posteriors])
    return {
        "forecast_deviation": forecast.tolist(),
        "latent_deviation": latent.tolist(),
        "noise_deviation": noise.tolist(),
        "moved": None if before is None else _moved(model, before),
    }


def _moved(model: InverseDynamicsModel, before: InverseDynamicsModel) -> float | None:
    """Largest |change| of a logarithmic length scale over all outputs; None if kernels differ or lack."""
    moves = []
    for now, then in zip(model.posteriors, before.posteriors, strict=True):
        if not (isinstance(now, HasKernel) and isinstance(then, HasKernel)):
            return None
        if now.theta.shape != then.theta.shape:
            return None
        lengths = np.array([role == "length" for role in now.kernel.roles()])
        if lengths.any():
            moves.append(float(np.abs(now.theta - then.theta)[lengths].max()))
    return max(moves, default=None)
