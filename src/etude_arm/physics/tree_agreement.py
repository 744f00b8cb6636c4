"""Check of the arrays that learning and exports use against the robot's description."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from etude_arm.loading.compiled_model_check import alike, apart, refuse, weight_differences
from etude_arm.loading.expected import Expected
from etude_arm.physics.kinematics import BodyMotion, KinematicTree, body_motion
from etude_arm.physics.newton_euler import joint_forces


def check_tree(tree: KinematicTree, expected: Expected, where: str) -> None:
    """Compares frames of joints and torques of gravity with the description, at the pose of `expected`.

    Args:
        tree: joints in the order of `expected`. where: the file, for messages.

    Raises:
        UnsafeModelError: they differ; the message has the joint and the difference.
    """
    q, still = expected.q[None], np.zeros((1, len(expected.q)))
    motion = body_motion(tree, q, still, still)
    differences = list(_frames(tree, motion, expected))
    refuse(differences or list(weight_differences(joint_forces(tree, motion)[0], expected)), where)


def _frames(tree: KinematicTree, motion: BodyMotion, expected: Expected) -> Iterator[str]:
    for j, (name, body) in enumerate(zip(expected.joints, tree.joint_body.tolist(), strict=True)):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = motion.rotation[body, 0], motion.position[body, 0]
        if not alike(frame, expected.frame[j]):
            yield f"what joint '{name}' moves is {apart(frame, expected.frame[j])} where it should be"
