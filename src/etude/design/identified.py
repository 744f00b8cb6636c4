"""The identified model as a design sees it: one linear regression per output, for `d_opt`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.design.objective import DesignModel
from etude.errors import UsageError
from etude.models.contracts import Posterior
from etude.models.gp.bayesian_linear import BayesianLinear, LinearPosterior
from etude.models.guided import guide_of
from etude.models.model_config import ModelConfig
from etude.models.physics.base_regressor import base_regressors
from etude.models.physics.geometry import Geometry, read_geometry
from etude.models.physics.rigid_body import RigidBodyModel
from etude.robots.spec import RobotSpec

Array = NDArray[np.float64]


def identified_posteriors(model: DesignModel, spec: RobotSpec) -> tuple[LinearPosterior, ...]:
    """What the samples learned so far say of each output's base parameters.

    The prior is that of the identification, the samples are those that the model's processes keep, and the
    noise is theirs. The weights' information is then Lambda0 of `d_opt`.

    Raises:
        UsageError: the robot has no model file, or the processes keep no samples.
    """
    geometry, friction_velocity = _geometry(model, spec)
    regressors = base_regressors(spec, geometry.tree, geometry.drives, friction_velocity)
    made = []
    for regressor, posterior in zip(regressors, map(guide_of, model.posteriors), strict=True):
        X = _samples(posterior)
        regression = BayesianLinear(regressor, 0.0, 0.5 * float(np.log(posterior.noise_variance)))
        made.append(regression.condition(X, np.zeros(len(X))))
    return tuple(made)


def _geometry(model: DesignModel, spec: RobotSpec) -> tuple[Geometry, Array]:
    """Geometry and friction velocities: those that were identified, else those of the model file."""
    fallback = getattr(model, "fallback", None)
    if isinstance(fallback, RigidBodyModel):
        return Geometry(fallback.tree, fallback.drives), fallback.friction_velocity
    geometry = read_geometry(spec)
    if geometry is None:
        raise UsageError(
            f"d_opt needs the identified model, and robot '{spec.name}' has no model_file",
            next_step="Add a URDF or MJCF to the robot file, or choose the criterion info_gain.",
        )
    friction_velocity = model.features.friction_velocity
    if friction_velocity is None:
        friction_velocity = ModelConfig().friction_fraction * spec.velocity
    return geometry, friction_velocity


def _samples(posterior: Posterior) -> Array:
    X = getattr(posterior, "X", None)
    if X is None:
        raise UsageError(
            f"d_opt needs the samples learned so far, and a {type(posterior).__name__} keeps none",
            next_step="Choose the criterion info_gain, or a model that keeps samples.",
        )
    return np.asarray(X, dtype=float)
