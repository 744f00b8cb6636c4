"""The inverse dynamics model: a mean function and one Gaussian process for each output."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.contracts import Posterior
from etude.models.dataset import Dataset
from etude.models.features import FRICTION_SCALES, FeatureMap
from etude.models.guard import Guard
from etude.models.model_config import PHYSICS, Kind, ModelConfig
from etude.models.output_process import OutputProcess, train_output
from etude.models.physics.geometry import Geometry, read_geometry
from etude.models.physics.rigid_body import RigidBodyModel, identify, nominal_model
from etude.models.selection import in_order
from etude.robots.spec import RobotSpec

__all__ = ["InverseDynamicsModel", "ModelConfig", "train_model"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InverseDynamicsModel:
    """Commands from motion. Thesis chapter 2 and (6.1), one process per output.

    Attributes:
        kind: "nominal": the model file alone; "identified": rigid body, transmission and friction by least
            squares; "gp": process on the centred command; "identified+gp": process on what the second leaves.
        features: map from motion to the processes' inputs.
        posteriors: one process per output. The first two kinds do not predict with them, but they still say
            where the robot has not been, for the design of the next trajectory.
        offset: (dof,) constant part of the mean, command units.
        scale: (dof,) factor on the variances from held-out trajectories (1: not needed, or not yet known).
        prior_deviation: (dof,) deviation of what the processes learn, before any data, command units.
        stick_velocity: (dof,) top speed of the samples that were masked as stuck, rad/s; 0 without a mask.
        fallback: the rigid-body model, which is also the mean function; None for "gp".
        residual_variance: (dof,) mean squared error of the rigid-body model on trajectories held out.
        guard: outputs that lost to linear regression; None if none did, or nothing was compared.
    """

    kind: Kind
    features: FeatureMap
    posteriors: tuple[Posterior, ...]
    offset: Array
    scale: Array
    prior_deviation: Array
    stick_velocity: Array
    fallback: RigidBodyModel | None = None
    residual_variance: Array | None = None
    guard: Guard | None = None

    @property
    def dof(self) -> int:
        return self.features.dof

    def warnings(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """A sentence for each output that lost to linear regression; `names` are the axes'."""
        if self.guard is None or self.kind in PHYSICS:
            return ()
        return self.guard.messages(names)

    def mean_function(self, q: Array, qd: Array, qdd: Array) -> Array:
        """What the processes are added to, (n, dof): all of the mean for an output that is linear alone."""
        mean = np.tile(self.offset, (len(q), 1))
        if self.fallback is not None:
            mean += self.fallback.predict(q, qd, qdd)
        if self.guard is None:
            return mean
        linear = self.guard.linear(q, qd, qdd)
        return np.where(self.guard.alone, linear, mean + linear)

    def predict(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Mean and variance (n, dof) of the measured command at q, qd, qdd (n, dof).

        Thesis (2.5), (2.6); the variance includes the noise and the calibration.
        """
        if self.kind in PHYSICS:
            assert self.fallback is not None
            assert self.residual_variance is not None
            return self.fallback.predict(q, qd, qdd), np.tile(self.residual_variance, (len(q), 1))
        mean = self.mean_function(q, qd, qdd)
        X = self.features.transform(q, qd, qdd)
        predicted = [posterior.predict(X) for posterior in self.posteriors]
        noise = np.array([posterior.noise_variance for posterior in self.posteriors])
        rest = np.stack([m for m, _ in predicted], axis=1)
        variance = self.scale * (np.stack([v for _, v in predicted], axis=1) + noise)
        if self.guard is not None:
            alone = self.guard.alone
            rest = np.where(alone, 0.0, rest)
            variance = np.where(alone, np.maximum(variance, self.guard.linear_error), variance)
        return mean + rest, variance


def train_model(
    dataset: Dataset,
    spec: RobotSpec,
    config: ModelConfig,
    rng: np.random.Generator,
    previous: InverseDynamicsModel | None = None,
    geometry: Geometry | None = None,
) -> InverseDynamicsModel:
    """One model of the kind that `config` names.

    Args:
        dataset: samples of one or more trajectories.
        spec: the robot; its limits give scales, its model file the rigid body.
        config: kind "auto" belongs to `ladder.train_ladder`.
        rng: draws the offsets of the thinning.
        previous: an earlier model; training starts at its hyperparameters.
        geometry: the robot's tree and drives, if they have been read already.

    Raises:
        UsageError: kind "auto", or an identified kind for a robot without a model file.
        DataError: an axis never moved.
    """
    if config.kind == "auto":
        raise UsageError("One model has one kind", where="model.kind = auto", next_step="Use train_ladder.")
    if dataset.dof != spec.dof:
        raise UsageError(f"the data set has {dataset.dof} axes, the robot {spec.name} has {spec.dof}")
    dataset = in_order(dataset)
    fallback, residual_variance, target = None, None, dataset.tau
    if config.kind != "gp":
        fallback = physics_model(dataset, spec, config, geometry)
        target = dataset.tau - fallback.predict(dataset.q, dataset.qd, dataset.qdd)
        residual_variance = held_out_variance(dataset, spec, fallback, config)
    features = feature_map(spec, config)
    X = features.transform(dataset.q, dataset.qd, dataset.qdd)
    start = [None] * spec.dof if previous is None else list(previous.posteriors)
    outputs = [
        train_output(dataset, X, target[:, j], j, float(spec.command[j]), config, rng, start[j])
        for j in range(spec.dof)
    ]
    posteriors = tuple(output.posterior for output in outputs)
    guard = _guard(outputs)
    prior = np.array([p.signal_variance + p.noise_variance for p in posteriors])
    if guard is not None:  # where linear regression is all there is, what it was to explain
        prior = np.where(guard.alone, np.maximum(prior, dataset.tau.var(axis=0)), prior)
    return InverseDynamicsModel(
        kind=config.kind,
        features=features,
        posteriors=posteriors,
        offset=np.array([output.offset for output in outputs]),
        scale=np.array([output.scale for output in outputs]),
        prior_deviation=np.sqrt(prior),
        stick_velocity=stick_velocity(dataset),
        fallback=fallback,
        residual_variance=residual_variance,
        guard=guard,
    )


def _guard(outputs: list[OutputProcess]) -> Guard | None:
    """None if no output needs it."""
    guard = Guard(
        roles=tuple(output.role for output in outputs),
        weights=np.column_stack([output.weights for output in outputs]),
        process_error=np.array([output.process_error for output in outputs]),
        linear_error=np.array([output.linear_error for output in outputs]),
    )
    return guard if guard.active else None


def physics_alone(
    twin: InverseDynamicsModel, kind: Kind, dataset: Dataset, spec: RobotSpec, geometry: Geometry
) -> InverseDynamicsModel:
    """A rung that predicts by its physics; its processes, for the design, are those of `twin`."""
    if kind == "identified":
        return replace(twin, kind=kind)
    config = ModelConfig(kind=kind)
    nominal = physics_model(dataset, spec, config, geometry)
    variance = held_out_variance(dataset, spec, nominal, config)
    return replace(twin, kind=kind, fallback=nominal, residual_variance=variance)


def stick_velocity(dataset: Dataset) -> Array:
    """Top speed (dof,) of the samples masked as stuck: slower planned samples will be masked too."""
    return np.asarray(np.where(dataset.stuck, np.abs(dataset.qd), 0.0).max(axis=0))


def feature_map(spec: RobotSpec, config: ModelConfig) -> FeatureMap:
    """The inputs of the processes; v0 of the friction feature is a part of the velocity limits."""
    if config.friction_fraction == 0:
        return FeatureMap(spec.dof)
    return FeatureMap(spec.dof, config.friction_fraction * spec.velocity, FRICTION_SCALES)


def physics_model(
    dataset: Dataset, spec: RobotSpec, config: ModelConfig, geometry: Geometry | None = None
) -> RigidBodyModel:
    """The mean function of `config.kind`: the model file alone, or identified by masked least squares.

    Raises:
        UsageError: the robot has no model file.
    """
    geometry = geometry or read_geometry(spec)
    if geometry is None:
        raise UsageError(
            f"robot '{spec.name}' has no model_file, so it has no physics to learn from",
            next_step="Add a URDF or MJCF to the robot file, or use model.kind = 'gp'.",
        )
    fraction = config.friction_fraction or ModelConfig().friction_fraction
    if config.kind == "nominal":
        return nominal_model(geometry.tree, geometry.drives, fraction * spec.velocity)
    return identify(dataset, spec, geometry.tree, geometry.drives, fraction * spec.velocity)


def held_out_variance(dataset: Dataset, spec: RobotSpec, model: RigidBodyModel, config: ModelConfig) -> Array:
    """Mean squared error (dof,) of the rigid-body model on each trajectory, identified from the others.

    With one trajectory, that of its own residual: too small, which the prequential score then shows. A
    nominal model has seen no data, so all of it is held out.
    """
    squared = (dataset.tau - model.predict(dataset.q, dataset.qd, dataset.qdd)) ** 2
    numbers = np.unique(dataset.group)
    if len(numbers) < 2 or config.kind == "nominal":
        numbers = np.zeros(0, dtype=np.int64)
    for number in numbers:
        own = dataset.group == number
        try:
            other = identify(dataset.take(~own), spec, model.tree, model.drives, model.friction_velocity)
        except DataError:  # an axis that moved in this trajectory only
            other = model
        held = dataset.take(own)
        squared[own] = (held.tau - other.predict(held.q, held.qd, held.qdd)) ** 2
    moving = ~dataset.stuck
    return np.array([float(np.mean(squared[moving[:, j], j])) for j in range(dataset.dof)])
