"""The robot's geometry for identification: its tree and its drives, read from the model file once."""

from __future__ import annotations

from dataclasses import dataclass

from etude.robots.arm.physics.kinematics import KinematicTree
from etude.robots.arm.physics.transmission import Drive
from etude.robots.arm.spec import ArmSpec


@dataclass(frozen=True)
class Geometry:
    """What a model file says of a robot without any data.

    Attributes:
        tree: bodies and joints, with the file's inertial parameters as the nominal ones.
        drives: one per axis; the joint itself where the file has no actuator.
    """

    tree: KinematicTree
    drives: tuple[Drive, ...]


def read_geometry(spec: ArmSpec) -> Geometry | None:
    """Geometry from the robot's URDF or MJCF; None for a robot without a model file.

    Raises:
        UsageError: the file cannot be read, or lacks a joint of the robot.
    """
    if spec.model_file is None:
        return None
    from etude.robots.arm.loading.load import load_arm
    from etude.robots.arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco

    model = load_arm(spec, shapes=False, drives=True).model()
    return Geometry(tree_from_mujoco(model, spec.names), drives_from_mujoco(model, spec.names))
