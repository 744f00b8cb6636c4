"""Structures of physics: the rigid body of the model file, nominal or identified, as mean functions."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import ref

import numpy as np

from etude._runtime.operators import Piece
from etude.errors import DataError, UsageError
from etude.logs.cleaning.filters import slower
from etude.types import Array, Code, Index, Log, Samples
from etude_arm.inputs import FRICTION_SCALES, friction_speeds
from etude_arm.physics.base_regressor import BaseRegressor, base_regressors
from etude_arm.physics.geometry import has_masses, read_geometry
from etude_arm.physics.identification import (
    IdentificationPrior,
    deviation_before_logs,
    fitted,
    output_priors,
    require_axes,
    shared_directions,
    steady,
)
from etude_arm.physics.kinematics import KinematicTree, body_motion
from etude_arm.physics.newton_euler import joint_forces
from etude_arm.physics.regressor import regressor_of_motion
from etude_arm.physics.rigid_body import (
    EXTRA_TERMS,
    Regressors,
    RigidBody,
    RigidBodyModel,
    command_regressors,
    extra_regressors,
    nominal_model,
    rigid_regressors,
    waves,
)
from etude_arm.physics.transmission import Drive, DriveMotion, Geometry, drive_motion
from etude_arm.spec import FORCES, FRICTION, PATH, PLAN, PRESLIDING_DISTANCES, TURNING, ArmSpec

FRICTION_FRACTION = 0.02
"""v0 of the friction terms as a part of the velocity limit, if the inputs state none."""
FINER = 0.1
"""Parts of v0 and of the speed below which a joint is at rest, used if slow samples are kept."""
LEAST_SLOW = 20
"""Least number of slow samples that are informative."""
TREE = tuple(KinematicTree.__dataclass_fields__)
DRIVE = tuple(Drive.__dataclass_fields__)
MOST_CACHED = 2**23
"""Largest number of entries of cached regressors, 64 MB."""
_cached_regressors: list[tuple[ref[Log], tuple[bool, bytes], tuple[Array, DriveMotion]]] = []
OWN = tuple(name for name in RigidBodyModel.__dataclass_fields__ if name not in ("tree", "drives"))


@dataclass(frozen=True, eq=False)
class RigidBodyMean:
    """Implements `protocols.Mean`: commands by a rigid-body model, of measured or desired states."""

    model: RigidBodyModel
    spec: ArmSpec
    desired: bool = False

    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """Terms of each drive in command units: armature, viscous, friction by its scale, offset."""
        rows = zip(self.spec.names, self.model.extra, self.model.extra_deviation, strict=True)
        return {
            f"{joint} {term}": (float(value), float(deviation))
            for joint, values, deviations in rows
            for term, value, deviation in zip(EXTRA_TERMS, values, deviations, strict=True)
        }

    def predict(self, log: Log) -> Array:
        """Commands (T, J); friction depends on speed if the log has no friction memory.

        Raises a KeyError if the log lacks a state.
        """
        return self.model.given(self._blocks(log), self._motion(log)[0], remembered_of(log))

    def _motion(self, log: Log) -> tuple[Array, Array, Array]:
        q, qd, qdd = (log[name] for name in (PLAN if self.desired else PATH))
        return q, qd, qdd

    def _blocks(self, log: Log) -> tuple[Array, Array]:
        """`command_regressors` of a log. Rigid ones of the last log are kept, for the robot's other means."""
        model, geometry = self.model, (self.desired, self.model.geometry)
        cached = [made for kept, its, made in _cached_regressors if kept() is log and its == geometry]
        rigid, drive = cached[0] if cached else rigid_regressors(model.tree, model.drives, *self._motion(log))
        if not cached and rigid.size <= MOST_CACHED:
            _cached_regressors[:] = [(ref(log), geometry, (rigid, drive))]
        return rigid, extra_regressors(drive, model.friction_velocity)

    def static(self, log: Log) -> Array:
        """Commands (T, J) at rest in the same positions: gravity and offset."""
        q = self._motion(log)[0]
        return self.model.predict(q, np.zeros_like(q), np.zeros_like(q))

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2 in the model file's world."""
        return self.model.tree.gravity

    def pulls(self, log: Log) -> Array:
        """Commands (T, J, 3) for each m/s^2 of gravity along an axis of the world; see `abilities`."""
        q = self._motion(log)[0]
        zeros = np.zeros_like(q)

        def standing(gravity: Array) -> Array:
            return replace(self.model, tree=replace(self.model.tree, gravity=gravity)).predict(
                q, zeros, zeros
            )

        none = standing(np.zeros(3))
        return np.stack([standing(axis) - none for axis in np.eye(3)], axis=2)

    def links(self, log: Log) -> Array:
        """Commands (T, J, L, 10) for each inertial parameter of the link that each axis moves."""
        rigid, _ = self._blocks(log)
        return rigid.reshape(*rigid.shape[:2], -1, 10)[:, :, self.model.tree.joint_body - 1]

    @property
    def link_parameters(self) -> Array:
        """(J, L, 10) inertial parameters of the same links, by command."""
        inertial = self.model.inertial
        return inertial.reshape(len(inertial), -1, 10)[:, self.model.tree.joint_body - 1]

    def arrays(self) -> dict[str, Array]:
        """Arrays from which `restore` makes the same mean, bit for bit."""
        model = self.model
        attributes = {name: getattr(model, name) for name in OWN}
        arrays = {
            f"rigid.{name}": np.asarray(values) for name, values in attributes.items() if values is not None
        }
        arrays |= {f"tree.{name}": np.asarray(getattr(model.tree, name)) for name in TREE}
        for j, drive in enumerate(model.drives):
            arrays |= {f"drive{j}.{name}": np.asarray(getattr(drive, name)) for name in DRIVE}
        return {**arrays, "desired": np.array(self.desired)}

    def c(self, name: str) -> Code:
        """C99 code of the mean: Newton-Euler in the drives' coordinates."""
        from etude_arm.c99 import rigid_body_code

        return rigid_body_code(name, self, FRICTION_SCALES)

    def onnx(self) -> Piece:
        """The mean in ONNX operators."""
        from etude_arm.physics.rigid_body_graph import rigid_body_piece

        return rigid_body_piece(self)


@dataclass(frozen=True, eq=False)
class ArmPhysics:
    """Implements `protocols.Physics`: computes a mean from samples. The model file is read at the first call.

    Attributes:
        spec: the robot; it has a model file.
        friction_fraction: v0 of the friction terms as a part of the velocity limits, above 0.
        desired: whether states are the planned ones.
        nominal: the model file alone, for commands that are forces.
        stick_fraction: part of the top speed below which joints count as standing in samples; 0: of none.
        ripple: whether periodic terms of hinge positions (cogging) are identified.
    """

    spec: ArmSpec
    friction_fraction: float = FRICTION_FRACTION
    desired: bool = False
    nominal: bool = False
    stick_fraction: float = 0.0
    ripple: bool = False

    @cached_property
    def geometry(self) -> Geometry:
        """Tree and drives of the model file. UsageError if the robot has none."""
        geometry = read_geometry(self.spec)
        if geometry is None:
            raise UsageError(
                f"robot '{self.spec.name}' has no model_file, so it has no physics",
                next_step="Add a URDF or MJCF to the robot file, or choose the structure gp.",
            )
        return geometry

    @property
    def friction_velocity(self) -> Array:
        return friction_speeds(self.spec, self.friction_fraction)

    def __call__(self, samples: Samples | None) -> RigidBodyMean:
        """The mean. DataError: an axis never moved. UsageError: there are no samples to identify from."""
        if self.nominal:
            return self._mean(nominal_model(*self._body))
        if samples is None:
            raise UsageError("an identified model needs samples", next_step="Ingest a log first.")
        physics = self._with_friction_speeds(samples)
        return physics._mean(physics._fitted(samples, physics._regressors(samples)))

    def without(self, samples: Samples, fold: Index) -> Mapping[int, Array]:
        """Capability `abilities.SupportsWithout`: regressors are computed once, not once for each fold."""
        if self.nominal:
            return dict.fromkeys(np.unique(fold).tolist(), self(None).predict(samples.log))
        physics = self._with_friction_speeds(samples)
        regressors = physics._regressors(samples)
        predictions = {}
        for number in np.unique(fold).tolist():
            training = fold != number
            with contextlib.suppress(DataError):
                predictions[number] = physics._fitted(samples.take(training), regressors.take(training)).of(
                    regressors
                )
        return predictions

    def slow(self, samples: Samples) -> Samples | None:
        """The physics with slow samples counted as moving, and a ten times steeper friction transition.

        With stick-slip, a slow sample has no information on friction at its speed, so slow joints are masked.
        If friction depends on speed alone, slow samples are the most informative. Cross-validation over logs
        decides. Capability `abilities.SupportsSlow`.
        """
        speed = samples.log[(PLAN if self.desired else PATH)[1]]
        moving = np.asarray(samples.moving | ~slower(speed, self.spec.velocity, FINER * self.stick_fraction))
        more = moving & ~samples.moving & samples.usable & np.isfinite(samples.target)
        if self.nominal or not self.stick_fraction or more.sum() < LEAST_SLOW:
            return None
        v0 = np.broadcast_to(FINER * self.friction_velocity, speed.shape)
        return replace(samples, log=samples.log.put(self.spec.friction(), v0.copy()), moving=moving)

    def rippled(self, samples: Samples) -> tuple[Samples, ArmPhysics] | None:
        """The physics with waves of each hinge's position, if commands are forces, and the informative
        samples.

        These include slow samples, but none near a reversal, where filters smear the step of friction.
        Capability `abilities.SupportsRipple`.
        """
        tree = self.geometry.tree
        if self.nominal or self.spec.command_unit not in FORCES or tree.joint_slides.all():
            return None
        informative = self.slow(samples) or samples
        moving = steady(informative, samples.log[(PLAN if self.desired else PATH)[1]])
        return replace(informative, moving=moving), replace(self, ripple=True)

    def restore(self, arrays: Mapping[str, Any]) -> RigidBodyMean:
        """The mean with these `arrays`; no model file is read."""
        tree = KinematicTree(**{name: arrays[f"tree.{name}"] for name in TREE})
        drives = tuple(
            Drive(float(arrays[f"drive{j}.gear"]), *(arrays[f"drive{j}.{name}"] for name in DRIVE[1:]))
            for j in range(tree.joints)
        )
        # older models have no presliding distance
        stored = {"rigid.way": np.zeros(tree.joints), "rigid.ripple": None, **arrays}
        model = RigidBodyModel(tree, drives, **{name: stored[f"rigid.{name}"] for name in OWN})
        return RigidBodyMean(model, self.spec, bool(arrays["desired"]))

    def regressors(self) -> tuple[BaseRegressor, ...]:
        """One map per command: features in which the command is linear, with prior weights N(0, 1)."""
        return base_regressors(self.spec, *self._body)

    def before_logs(self, q: Array, qd: Array, qdd: Array, friction: Array) -> tuple[Array, Array]:
        """(n, J) forces by the file's masses and that friction (n, J) of the joints, N m (N), and their prior
        deviations: of masses and friction. One motion of the bodies serves both.
        """
        assert self._shared is not None
        tree, drives, _ = self._body
        motion = body_motion(tree, q, qd, qdd)
        drive = drive_motion(tree, drives, motion, qd, qdd)
        rigid = drive.to_drive(regressor_of_motion(tree, motion))
        mean = drive.to_drive(joint_forces(tree, motion) + friction)
        return mean, deviation_before_logs(rigid, self._shared, self.spec.command)

    def _with_friction_speeds(self, samples: Samples) -> ArmPhysics:
        """This physics, or a copy with the friction velocities of the samples."""
        v0 = samples.log.get(FRICTION)
        if v0 is None:
            return self
        part = float(v0[0, 0] / self.friction_velocity[0])
        return replace(self, friction_fraction=part * self.friction_fraction)

    @cached_property
    def _body(self) -> RigidBody:
        return RigidBody(self.geometry.tree, self.geometry.drives, self.friction_velocity)

    @cached_property
    def _priors(self) -> tuple[IdentificationPrior, ...]:
        return output_priors(self.spec, *self._body)

    @cached_property
    def _shared(self) -> Array | None:
        """Directions of one rigid body for all commands, if commands are forces."""
        return shared_directions(self.spec, *self._body) if self.spec.command_unit in FORCES else None

    def _regressors(self, samples: Samples) -> Regressors:
        """Regressors at the states of the samples, as models use them."""
        require_axes(samples, self.spec, self._body.tree, self._body.drives)
        motion = (samples.log[name] for name in (PLAN if self.desired else PATH))
        hinges = ~self._body.tree.joint_slides[:, None]
        wave = hinges * waves(samples.log[(PLAN if self.desired else PATH)[0]])
        blocks = command_regressors(*self._body, *motion)
        return Regressors(*blocks, remembered_of(samples.log), wave)

    def _fitted(self, samples: Samples, regressors: Regressors) -> RigidBodyModel:
        priors, names = self._priors, self.spec.names
        return fitted(samples, regressors, priors, names, self._body, self._shared, self.ripple)

    def _mean(self, model: RigidBodyModel) -> RigidBodyMean:
        return RigidBodyMean(model, self.spec, self.desired)


def remembered_of(log: Log) -> Array | None:
    """(T, W, J) friction memory for each presliding distance, if the log carries it."""
    memory = log.get(TURNING)
    return None if memory is None else memory.reshape(len(log), len(PRESLIDING_DISTANCES), -1)


def physics_of(
    spec: ArmSpec, friction_fraction: float, desired: bool, stick_fraction: float = 0.0
) -> dict[str, ArmPhysics]:
    """The possible structures of a robot: none without a file with masses, "nominal" only for forces."""
    if not has_masses(spec):
        return {}
    fraction = friction_fraction or FRICTION_FRACTION
    stick_fraction = stick_fraction if friction_fraction else 0.0
    structures = {"identified": ArmPhysics(spec, fraction, desired, stick_fraction=stick_fraction)}
    if spec.command_unit in FORCES:
        structures["nominal"] = ArmPhysics(spec, fraction, desired, nominal=True)
    return structures
