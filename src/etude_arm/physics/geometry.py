"""The robot's geometry for identification: its tree and its drives, read from the model file once."""

from __future__ import annotations

import numpy as np

from etude.types import Array
from etude_arm.loading.load import of_file
from etude_arm.physics.transmission import Geometry
from etude_arm.spec import ArmSpec

_cached_has_masses: dict[str, bool] = {}
"""Whether a file has masses."""
_geometries: dict[str, Geometry] = {}
_friction: dict[str, Array] = {}


def read_geometry(spec: ArmSpec) -> Geometry | None:
    """Geometry from the robot's URDF or MJCF; None for a robot without a model file.

    Raises:
        UsageError: the file cannot be read, or lacks a joint of the robot.
        UnsafeModelError: the compiled model differs from the file (`loading.compiled_model_check`).
    """
    if spec.model_file is None:
        return None
    if not spec.model_file.is_file():
        return _read(spec)  # raises the error
    return of_file(_geometries, spec, lambda: _read(spec))


def _read(spec: ArmSpec) -> Geometry:
    from etude_arm.loading.load import load_arm
    from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco

    loaded = load_arm(spec, shapes=False, drives=True)
    model = loaded.model()
    tree = tree_from_mujoco(model, spec.names)
    if loaded.expected is not None:
        from etude_arm.physics.tree_agreement import check_tree

        check_tree(tree, loaded.expected, loaded.source)
    return Geometry(tree, drives_from_mujoco(model, spec.names))


def has_masses(spec: ArmSpec) -> bool:
    """Whether the robot has a model file with masses; without masses, no torque can be computed.

    This does not use MuJoCo: a saved model predicts without MuJoCo and without the file, which then had
    masses.
    """
    if spec.model_file is None or not spec.model_file.is_file():
        return spec.model_file is not None
    file = spec.model_file

    def made() -> bool:
        from etude_arm.loading.inertia import masses_of
        from etude_arm.loading.parsing import parsed
        from etude_arm.loading.urdf_tree import read_tree

        root = parsed(file)  # bodies of an MJCF have a stated mass, or shapes with the density of water
        return root.tag != "robot" or bool(masses_of(read_tree(root, str(file)), spec.names).elements)

    return of_file(_cached_has_masses, spec, made)


def file_friction(spec: ArmSpec) -> Array:
    """(2, J) friction of the joints by the model file: Coulomb (frictionloss), N m or N, and viscous
    (damping), N m s/rad or N s/m.

    Coulomb friction is 0 where it is no less than the command's limit: no drive moves against such a number.
    """

    def made() -> Array:
        from etude_arm.loading.load import load_arm

        model = load_arm(spec, shapes=False, drives=True).model()
        joints = [model.joint(name) for name in spec.names]
        dry = np.array([float(joint.frictionloss[0]) for joint in joints])
        viscous = np.array([float(joint.damping.flat[0]) for joint in joints])
        return np.stack([np.where(dry < spec.command, dry, 0.0), viscous])

    return of_file(_friction, spec, made)
