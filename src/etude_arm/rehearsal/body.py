"""Bodies of the robot in MuJoCo, without drives and friction: masses from its file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Index
from etude_arm.loading.parsing import free_name
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco

    from etude_arm.loading.loaded_model import Loaded

TIP = "the tip"
"""Name of the body that a payload adds."""


def from_file(spec: ArmSpec) -> Loaded:
    """The robot's model from its file, without shapes, which the simulation does not use.

    Raises:
        UsageError: as `load_arm`; or an actuator drives a joint through others.
    """
    from etude_arm.loading.load import load_arm
    from etude_arm.physics.geometry import read_geometry

    loaded, geometry = load_arm(spec, shapes=False), read_geometry(spec)
    assert geometry is not None
    for j, (name, drive) in enumerate(zip(spec.names, geometry.drives, strict=True)):
        if len(drive.bodies) or np.flatnonzero(drive.coefficients).tolist() != [j]:
            raise UsageError(
                f"joint '{name}' is driven by a tendon: only drives on the joints themselves are simulated",
                where=str(spec.model_file),
                next_step="Run the real robot, or remove the tendons from a copy of the model file.",
            )
    return loaded


def bare_body(loaded: Loaded, spec: ArmSpec) -> Any:
    """A new `mujoco.MjSpec` of the joints, without actuators, contacts, friction or limits.

    Limits are those of the robot file: mechanical stops lie outside them. Damping and friction of the file
    are omitted, since the drives include them.
    """
    import mujoco

    body = loaded.spec()
    for name in spec.names:
        joint = body.joint(name)
        joint.limited, joint.actfrclimited = 0, 0
        joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
    body.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return body


def rows(model: mujoco.MjModel, spec: ArmSpec) -> Index:
    """(J,) the axes' places in qpos and in qvel, which are the same where all joints are hinges or slides."""
    return np.array([int(model.jnt_dofadr[model.joint(name).id]) for name in spec.names])


def with_payload(body: Any, loaded: Loaded, spec: ArmSpec, mass: float) -> None:
    """Adds a point mass (kg) at the tip of the last link."""
    last = spec.names[-1]
    body.joint(last).parent.add_body(
        name=free_name(TIP, {one.name for one in body.bodies}),
        pos=tips(loaded, (last,))[0],
        mass=mass,
        # a point mass has no inertia, and MuJoCo requires a positive one
        inertia=[1e-9 * mass] * 3,
        ipos=[0.0] * 3,
        explicitinertial=True,
    )


def tips(loaded: Loaded, joints: Sequence[str]) -> list[Array]:
    """For each joint the origin (3,) of the farthest frame welded to its body, in the frame of that body."""
    import mujoco

    spec = loaded.spec()
    spec.compiler.fusestatic = 0
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    place, turn = np.array(data.xpos), np.array(data.xmat).reshape(-1, 3, 3)
    points = []
    for name in joints:
        welded = [int(model.jnt_bodyid[model.joint(name).id])]
        for body in range(welded[0] + 1, model.nbody):
            if int(model.body_parentid[body]) in welded and not model.body_jntnum[body]:
                welded.append(body)
        away = place[welded] - place[welded[0]]
        points.append(turn[welded[0]].T @ away[np.argmax(np.linalg.norm(away, axis=1))])
    return points


def stated_of_drives(loaded: Loaded, spec: ArmSpec) -> dict[str, Array]:
    """Values of the file for the joints (J,): armature, damping, friction (0: not stated), effort (inf: not
    stated).
    """
    model = loaded.model()
    joints, dofs = [model.joint(name).id for name in spec.names], rows(model, spec)
    limited = np.asarray(model.jnt_actfrclimited)[joints].astype(bool)
    effort = np.abs(np.asarray(model.jnt_actfrcrange)[joints]).max(axis=1)
    return {
        "armature": np.array(model.dof_armature)[dofs],
        "damping": np.array(model.dof_damping)[dofs],
        "friction": np.array(model.dof_frictionloss)[dofs],
        "effort": np.where(limited, effort, np.inf),
    }
