"""Identified model: rigid body, transmission and friction by least squares.

    command_j = [M(q)^-T Y(q, qd, qdd)]_j phi_j
              + armature_j l''_j + viscous_j l'_j + sum_s friction_js tanh(l'_j / (s v0)) + offset_j

with l the drive's coordinate (that of the joint without a known transmission). The unit of the command and
the gain of the motor are unknown, so each output has separate parameters, in command units.

Periodic torques of a hinge's position, such as cogging, are a sum of waves if `ripple` is identified.

The steepest friction term depends on speed, or on presliding distance (Dahl 1968), whichever fits the samples
better. In the second case the friction memory of the log replaces tanh(l'_j / v0).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
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
"""Places of the terms of the drive's speed, and of its steepest friction term."""


class RigidBody(NamedTuple):
    """A robot's geometry, and (dof,) v0 of the friction columns, rad/s."""

    tree: KinematicTree
    drives: tuple[Drive, ...]
    friction_velocity: Array


class Regressors(NamedTuple):
    """Regressors of the commands: rigid (n, dof, P), extra (n, dof, E), friction memory (n, W, dof) for each
    of `PRESLIDING_DISTANCES` (None if the log has none), and `waves` (n, dof, 2 R) or None.
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
        extra_deviation: (dof, E) posterior deviation of the extra terms; inf if the data had no information.
        way: (dof,) presliding distance of the steepest friction term, of `PRESLIDING_DISTANCES`; 0: friction
            by speed. The name is that of its array in a stored model.
        ripple: (dof, 2 R) weights of `waves`, command units; None: not identified.
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
        """Command (n, dof) at q, qd, qdd (n, dof); turning: friction memory as in `Regressors`, None:
        friction by speed.
        """
        blocks = command_regressors(self.tree, self.drives, self.friction_velocity, q, qd, qdd)
        return self.given(blocks, q, turning)

    def given(self, blocks: tuple[Array, Array], q: Array, turning: Array | None) -> Array:
        """The same, with `command_regressors` of the motion."""
        return self.of(Regressors(*blocks, turning, None if self.ripple is None else waves(q)))

    @cached_property
    def geometry(self) -> bytes:
        """The tree and the drives in bytes, to tell whether models have the same."""
        parts: list[KinematicTree | Drive] = [self.tree, *self.drives]
        values = [getattr(part, field.name) for part in parts for field in fields(part)]
        return b"".join(np.asarray(value).tobytes() for value in values)

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
        """`extra` with the friction memory in place of the steepest friction term, where friction depends on
        distance.
        """
        terms = extra.copy()
        for j in np.flatnonzero(self.way).tolist():
            number = int(np.argmin(np.abs(np.array(PRESLIDING_DISTANCES) - self.way[j])))
            speed, v0 = extra[:, j, SPEED], float(self.friction_velocity[j])
            terms[:, j, NARROW] = turned(turning[..., j], speed, self.drives[j], j, v0)[:, number]
        return terms


def turned(turning: Array, speed: Array, drive: Drive, joint: int, v0: float) -> Array:
    """(n, W) friction of a drive of that joint alone, for each presliding distance; 0 at rest.

    At rest, friction balances the remaining force up to its level. A command that stays at that level is at
    the limit of slipping: a joint with less friction than learned creeps while it is held.

    Args:
        turning: (n, W) friction memory of the joint. speed: (n,) of the drive.
    """
    slides = 1.0 - np.exp(-np.abs(speed) / drive.resting(joint, v0))
    return np.asarray(drive.side(joint) * turning * slides[:, None])


def waves(q: Array) -> Array:
    """(n, dof, 2 R) sine and cosine of each wave at positions q (n, dof)."""
    counts = range(FIRST_WAVE, FIRST_WAVE + RIPPLES)
    return np.stack([wave(k * q) for k in counts for wave in (np.sin, np.cos)], axis=2)


def nominal_model(tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array) -> RigidBodyModel:
    """The model of the file alone, for commands in N m or N: its inertial parameters, no friction."""
    inertial = np.tile(nominal_parameters(tree), (tree.joints, 1))
    extra = np.zeros((tree.joints, 3 + len(FRICTION_SCALES)))
    rank, unknown = np.zeros(tree.joints, dtype=np.int64), np.full_like(extra, np.inf)
    nothing = np.zeros(tree.joints)
    return RigidBodyModel(tree, drives, friction_velocity, inertial, extra, rank, nothing, unknown, nothing)


def command_regressors(
    tree: KinematicTree, drives: tuple[Drive, ...], friction_velocity: Array, q: Array, qd: Array, qdd: Array
) -> tuple[Array, Array]:
    """Regressors of the commands: rigid (n, dof, P) and extra (n, dof, E), in the drives' coordinates."""
    rigid, drive = rigid_regressors(tree, drives, q, qd, qdd)
    return rigid, extra_regressors(drive, friction_velocity)


def rigid_regressors(
    tree: KinematicTree, drives: tuple[Drive, ...], q: Array, qd: Array, qdd: Array
) -> tuple[Array, DriveMotion]:
    """The rigid ones (n, dof, P), and the motion of the drives."""
    motion = body_motion(tree, q, qd, qdd)
    drive = drive_motion(tree, drives, motion, qd, qdd)
    return drive.to_drive(regressor_of_motion(tree, motion)), drive


def extra_regressors(drive: DriveMotion, friction_velocity: Array) -> Array:
    """The others (n, dof, E) of `EXTRA_TERMS`."""
    return np.stack([*drive_terms(drive, friction_velocity), np.ones_like(drive.speed)], axis=2)


def drive_terms(drive: DriveMotion, friction_velocity: Array) -> list[Operand]:
    """(n, dof) of each of `EXTRA_TERMS` but the offset."""
    threshold = abs(drive.moment) @ friction_velocity
    friction = [tanh(drive.speed / (scale * threshold)) for scale in FRICTION_SCALES]
    return [drive.acceleration, drive.speed, *friction]
