"""The identified model: rigid body, transmission and friction by least squares, any GP's competitor.

    command_j = [M(q)^-T Y(q, qd, qdd)]_j phi_j
              + armature_j l''_j + viscous_j l'_j + sum_s friction_js tanh(l'_j / (s v0)) + offset_j

with l the drive's own coordinate (the joint itself where no transmission is known). The unit of the command
and the gain of the motor are unknown, so each output has parameters of its own, in command units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from etude.contracts import Samples
from etude.errors import DataError, UsageError
from etude.robots.arm.inputs import FRICTION_SCALES
from etude.robots.arm.physics.base_parameters import base_directions, parameter_scale, spread_states
from etude.robots.arm.physics.kinematics import KinematicTree, body_motion
from etude.robots.arm.physics.regressor import nominal_parameters, regressor_of_motion
from etude.robots.arm.physics.transmission import Drive, drive_motion

if TYPE_CHECKING:
    from etude.robots.arm.spec import ArmSpec

Array = NDArray[np.float64]
EXTRA_TERMS = ("armature", "viscous", *(f"friction {scale:g} v0" for scale in FRICTION_SCALES), "offset")


class RigidBody(NamedTuple):
    """A robot's geometry, and (dof,) v0 of the friction columns, rad/s."""

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array


@dataclass(frozen=True)
class RigidBodyModel:
    """An identified inverse dynamics model.

    Attributes:
        tree, drives: the robot's geometry.
        friction_velocity: (dof,) v0 of the friction columns, rad/s.
        inertial: (dof, P) parameters phi_j of each output, command units per N m (or N).
        extra: (dof, E) armature, viscous, friction (one for each scale) and offset terms of each output.
        rank: (dof,) number of base parameters of each output.
        deviation: (dof,) standard deviation of the residual on the samples used, command units.
        extra_deviation: (dof, E) posterior deviation of the extra terms; inf where data said nothing.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array
    inertial: Array
    extra: Array
    rank: NDArray[np.int64]
    deviation: Array
    extra_deviation: Array

    def predict(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Command (n, dof) at q, qd, qdd (n, dof)."""
        return self.of(*command_regressors(self.tree, self.drives, self.friction_velocity, q, qd, qdd))

    def of(self, rigid: Array, extra: Array) -> Array:
        """Command (n, dof) at regressors as `command_regressors` has them."""
        command = np.einsum("njp,jp->nj", rigid, self.inertial) + np.einsum("njp,jp->nj", extra, self.extra)
        return np.asarray(command)


def nominal_model(tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array) -> RigidBodyModel:
    """What the model file alone says, for commands in N m or N: its inertial parameters, no friction."""
    inertial = np.tile(nominal_parameters(tree), (tree.joints, 1))
    extra = np.zeros((tree.joints, 3 + len(FRICTION_SCALES)))
    rank, unknown = np.zeros(tree.joints, dtype=np.int64), np.full_like(extra, np.inf)
    return RigidBodyModel(
        tree, drives, friction_velocity, inertial, extra, rank, np.zeros(tree.joints), unknown
    )


def command_regressors(
    tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array, q: Array, qd: Array, qdd: Array
) -> tuple[Array, Array]:
    """Regressors of the commands: rigid (n, dof, P) and extra (n, dof, E), in the drives' coordinates."""
    motion = body_motion(tree, q, qd, qdd)
    drive = drive_motion(tree, drives, motion, qd, qdd)
    rigid = drive.to_drive(regressor_of_motion(tree, motion))
    threshold = np.abs(drive.moment) @ friction_velocity
    friction = [np.tanh(drive.speed / (scale * threshold)) for scale in FRICTION_SCALES]
    constant = np.ones_like(drive.speed)
    return rigid, np.stack([drive.acceleration, drive.speed, *friction, constant], axis=2)


def require_axes(samples: Samples, spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...]) -> None:
    """UsageError unless robot, model file and samples have the same axes."""
    axes = samples.command.shape[1]
    if tree.joints != spec.dof or len(drives) != spec.dof or axes != spec.dof:
        raise UsageError(
            "Robot, model file and samples must have the same axes",
            where=f"robot {spec.dof}, model file {tree.joints}, samples {axes}",
        )


def fitted(
    samples: Samples,
    regressors: tuple[Array, Array],
    priors: Sequence[IdentificationPrior],
    names: Sequence[str],
    body: RigidBody,
) -> RigidBodyModel:
    """Masked maximum a posteriori least squares of every output's parameters.

    Args:
        samples: commands and masks.
        regressors: of the samples, as `command_regressors` has them.
        priors: of the outputs, as `output_priors`. names: of their axes.
        body: which all that is of.

    Raises:
        DataError: an axis never moved.
    """
    rigid, extra = regressors
    weight = information_per_sample(samples)
    fits = []
    for j, (name, prior) in enumerate(zip(names, priors, strict=True)):
        moving = samples.moving[:, j] & samples.usable[:, j]
        if not np.any(moving):
            raise DataError(
                "An axis never moves, so nothing of it can be identified",
                where=name,
                next_step="Tell a log that moves it, with which this one is learned, or leave the axis out.",
            )
        fits.append(
            _fit_output(rigid[moving, j], extra[moving, j], samples.command[moving, j], prior, weight)
        )
    inertial, extras, deviation, rank, spreads = (np.array(part) for part in zip(*fits, strict=True))
    return RigidBodyModel(*body, inertial, extras, rank, deviation, spreads)


CORRELATION_TIME = 0.5  # s; smoothed commands closer than this repeat each other


def information_per_sample(samples: Samples) -> float:
    """Weight of one sample against the prior: neighbours nearer than the correlation time share one vote."""
    steps = np.diff(samples.t)[np.diff(samples.group) == 0]
    step = float(np.median(steps)) if len(steps) else CORRELATION_TIME
    return float(np.clip(step / CORRELATION_TIME, 1e-3, 1.0))


@dataclass(frozen=True)
class IdentificationPrior:
    """What is known of one output before any data, from its physical scales.

    Attributes:
        nominal: (P,) the model file's parameters; directions: (P, r) base directions, z ~ N(0, 1) per unit
        of gain.
        gain: prior deviation of the command per N m; extra: (E,) of the extra terms.
        command: the command limit.
    """

    nominal: Array
    directions: Array
    gain: float
    extra: Array
    command: float

    @staticmethod
    def of_output(tree: KinematicTree, rigid: Array, extra: Array, command: float) -> IdentificationPrior:
        """Deviations such that no single term exceeds the command limit over the robot's limits."""
        nominal = nominal_parameters(tree)
        torque = float(np.sqrt(np.mean((rigid @ nominal) ** 2)))
        largest = np.sqrt(np.mean(extra**2, axis=0))
        return IdentificationPrior(
            nominal,
            base_directions(rigid, parameter_scale(tree)),
            command / max(torque, np.finfo(float).tiny),
            command / largest,
            command,
        )


def output_priors(
    spec: ArmSpec, tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array
) -> tuple[IdentificationPrior, ...]:
    """What is known of each output before any data, over states spread within the robot's limits."""
    spread = spread_states(spec, 64 + 24 * tree.bodies)
    rigid, extra = command_regressors(tree, drives, friction_velocity, *spread)
    return tuple(
        IdentificationPrior.of_output(tree, rigid[:, j], extra[:, j], float(spec.command[j]))
        for j in range(spec.dof)
    )


def _fit_output(
    rigid: Array, extra: Array, y: Array, prior: IdentificationPrior, weight: float
) -> tuple[Array, Array, float, int, Array]:
    """phi (P,), extra (E,), residual deviation, rank and deviations (E,) of extra of one output.

    First the nominal model with a free gain; then every base parameter, as far from the nominal one as
    `prior` allows.
    """
    nominal = rigid @ prior.nominal
    columns = np.column_stack([nominal, extra])
    deviations = np.concatenate([[prior.gain], prior.extra])
    coarse, spread, _ = _map_estimate(columns, y, deviations, prior.command, weight)
    gain = float(np.hypot(coarse[0], spread[0]))
    columns = np.column_stack([columns, rigid @ prior.directions])
    rank = prior.directions.shape[1]
    deviations = np.concatenate([deviations, np.full(rank, gain)])
    fine, spread, deviation = _map_estimate(columns, y, deviations, prior.command, weight)
    last = 1 + extra.shape[1]
    phi = fine[0] * prior.nominal + prior.directions @ fine[last:]
    return phi, fine[1:last], deviation, rank, spread[1:last]


def _map_estimate(
    columns: Array, y: Array, deviations: Array, command: float, weight: float
) -> tuple[Array, Array, float]:
    """Coefficients with independent priors N(0, deviations^2), their posterior deviations, and the noise
    deviation.

    The noise is found by fixed-point iteration on the residual (MacKay 1992), between 0.01 % and 10 % of the
    command.
    """
    whitened = columns * deviations
    moment, target = weight * whitened.T @ whitened, weight * whitened.T @ y
    eigenvalues, vectors = np.linalg.eigh(moment)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    rotated = vectors.T @ target
    noise = (0.01 * command) ** 2
    for _ in range(12):
        z = vectors @ (rotated / (eigenvalues + noise))
        determined = float(np.sum(eigenvalues / (eigenvalues + noise)))
        freedom = max(weight * len(y) - determined, 1.0)
        residual = weight * float(np.sum((y - whitened @ z) ** 2)) / freedom
        noise = float(np.clip(residual, (1e-4 * command) ** 2, (0.1 * command) ** 2))
    variance = (vectors**2) @ (noise / (eigenvalues + noise))
    return deviations * z, deviations * np.sqrt(variance), float(np.sqrt(noise))
