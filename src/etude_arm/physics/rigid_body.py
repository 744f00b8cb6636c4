"""Identified model: rigid body, transmission and friction by least squares.

    command_j = [M(q)^-T Y(q, qd, qdd)]_j phi_j
              + armature_j l''_j + viscous_j l'_j + sum_s friction_js tanh(l'_j / (s v0)) + offset_j

with l the drive's own coordinate (the joint itself where no transmission is known). The unit of the command
and the gain of the motor are unknown, so each output has parameters of its own, in command units.

What returns with a hinge's position, as cogging does, is a sum of waves where it was looked for.

The narrowest friction turns over with speed, or round over a way (Dahl 1968), whichever samples say: then
what a joint's friction remembers stands in the place of tanh(l'_j / v0), where a log carries it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from etude._runtime.operators import Operand, tanh
from etude.types import Mask
from etude_arm.inputs import FRICTION_SCALES
from etude_arm.physics.kinematics import KinematicTree, body_motion
from etude_arm.physics.regressor import nominal_parameters, regressor_of_motion
from etude_arm.physics.transmission import Drive, DriveMotion, drive_motion
from etude_arm.spec import FIRST_WAVE, PRESLIDING_DISTANCES, RIPPLES

Array = NDArray[np.float64]
EXTRA_TERMS = ("armature", "viscous", *(f"friction {scale:g} v0" for scale in FRICTION_SCALES), "offset")
SPEED, NARROW = 1, 2
"""The terms of the drive's speed, and of its narrowest friction."""


class RigidBody(NamedTuple):
    """A robot's geometry, and (dof,) v0 of the friction columns, rad/s."""

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array


class Regressors(NamedTuple):
    """Of the commands: rigid (n, dof, P), extra (n, dof, E), what friction remembers (n, W, dof) by each of
    `PRESLIDING_DISTANCES`, or None where a log carries none, and `waves` (n, dof, 2 R), or None.
    """

    rigid: Array
    extra: Array
    turning: Array | None = None
    waves: Array | None = None

    def take(self, rows: Mask) -> Regressors:
        """Of those rows."""
        return Regressors(*(None if part is None else part[rows] for part in self))  # type: ignore[arg-type]


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
        way: (dof,) that of `PRESLIDING_DISTANCES` over which the narrowest friction turns round; 0 where it
            does with speed. The name is that of its array in a stored model.
        ripple: (dof, 2 R) weights of `waves`, command units; None: it was not looked for.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array
    inertial: Array
    extra: Array
    rank: NDArray[np.int64]
    deviation: Array
    extra_deviation: Array
    way: Array
    ripple: Array | None = None

    def predict(self, q: Array, qd: Array, qdd: Array, turning: Array | None = None) -> Array:
        """Command (n, dof) at q, qd, qdd (n, dof); turning as in `Regressors`, None: by speed."""
        found = command_regressors(self.tree, self.drives, self.friction_velocity, q, qd, qdd)
        return self.of(Regressors(*found, turning, None if self.ripple is None else waves(q)))

    def of(self, regressors: Regressors) -> Array:
        """Command (n, dof) at those regressors."""
        rigid, extra, turning, wave = regressors
        if turning is not None and self.way.any():
            extra = self.turned(extra, turning)
        command = np.einsum("njp,jp->nj", rigid, self.inertial) + np.einsum("njp,jp->nj", extra, self.extra)
        if self.ripple is not None and wave is not None:
            command += np.einsum("njp,jp->nj", wave, self.ripple)
        return np.asarray(command)

    def turned(self, extra: Array, turning: Array) -> Array:
        """`extra` with what is remembered in the place of the narrowest friction, where it turns in a way."""
        found = extra.copy()
        for j in np.flatnonzero(self.way).tolist():
            number = int(np.argmin(np.abs(np.array(PRESLIDING_DISTANCES) - self.way[j])))
            speed, v0 = extra[:, j, SPEED], float(self.friction_velocity[j])
            found[:, j, NARROW] = turned(turning[..., j], speed, self.drives[j], j, v0)[:, number]
        return found


def turned(turning: Array, speed: Array, drive: Drive, joint: int, v0: float) -> Array:
    """(n, W) friction of a drive that is that joint's alone, by each way; none at rest.

    The friction of a joint at rest answers what force is left, up to its level. A command that stays at that
    level is at the edge of slipping: a joint whose friction is less than was learned creeps for as long as it
    is held.

    Args:
        turning: (n, W) what friction remembers of the joint. speed: (n,) of the drive.
    """
    slides = 1.0 - np.exp(-np.abs(speed) / drive.resting(joint, v0))
    return np.asarray(drive.side(joint) * turning * slides[:, None])


def waves(q: Array) -> Array:
    """(n, dof, 2 R) sine and cosine of each wave of what returns with positions q (n, dof)."""
    counts = range(FIRST_WAVE, FIRST_WAVE + RIPPLES)
    return np.stack([wave(k * q) for k in counts for wave in (np.sin, np.cos)], axis=2)


def nominal_model(tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array) -> RigidBodyModel:
    """What the model file alone says, for commands in N m or N: its inertial parameters, no friction."""
    inertial = np.tile(nominal_parameters(tree), (tree.joints, 1))
    extra = np.zeros((tree.joints, 3 + len(FRICTION_SCALES)))
    rank, unknown = np.zeros(tree.joints, dtype=np.int64), np.full_like(extra, np.inf)
    nothing = np.zeros(tree.joints)
    return RigidBodyModel(tree, drives, friction_velocity, inertial, extra, rank, nothing, unknown, nothing)


def command_regressors(
    tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array, q: Array, qd: Array, qdd: Array
) -> tuple[Array, Array]:
    """Regressors of the commands: rigid (n, dof, P) and extra (n, dof, E), in the drives' coordinates."""
    motion = body_motion(tree, q, qd, qdd)
    drive = drive_motion(tree, drives, motion, qd, qdd)
    rigid = drive.to_drive(regressor_of_motion(tree, motion))
    constant = np.ones_like(drive.speed)
    return rigid, np.stack([*drive_terms(drive, friction_velocity), constant], axis=2)


def drive_terms(drive: DriveMotion, friction_velocity: Array) -> list[Operand]:
    """(n, dof) of each of `EXTRA_TERMS` but the offset."""
    threshold = abs(drive.moment) @ friction_velocity
    friction = [tanh(drive.speed / (scale * threshold)) for scale in FRICTION_SCALES]
    return [drive.acceleration, drive.speed, *friction]
