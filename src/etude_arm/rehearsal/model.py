"""The robot's bodies with drives laid over them: what MuJoCo steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from etude_arm.loading.names import free_name
from etude_arm.rehearsal.body import bare_body, with_payload
from etude_arm.rehearsal.motors import Motors
from etude_arm.rehearsal.overlay import Simulate
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco

    from etude_arm.loading.loaded import Loaded

LEAST = 1e-9
"""Motor constant of a drive that stands for friction alone: it has no back-EMF."""


@dataclass(frozen=True, eq=False)
class Made:
    """All that decides what a run does.

    Attributes:
        spec: the robot; loaded: its model file.
        loop: how it is driven, settled; motors: its drives; payload: kg at its tip.
    """

    spec: ArmSpec
    loaded: Loaded
    loop: Simulate
    motors: Motors
    payload: float = 0.0

    @cached_property
    def rigid(self) -> mujoco.MjModel:
        """Bodies, rotors and payload, without friction."""
        return self._compiled(self._bodies())

    @cached_property
    def driven(self) -> mujoco.MjModel:
        """What a run steps; see `_drive`."""
        body = self._bodies()
        _drive(body, self)
        return self._compiled(body)

    def _compiled(self, body: Any) -> mujoco.MjModel:
        """UnsafeModelError if it is not the robot of the file; with a payload of its own it is another."""
        model = body.compile()
        if not self.payload:
            self.loaded.check(model)
        return model

    def _bodies(self) -> Any:
        body = bare_body(self.loaded, self.spec)
        for name, armature in zip(self.spec.names, self.motors.armature.tolist(), strict=True):
            body.joint(name).armature = armature
        if self.payload:
            with_payload(body, self.loaded, self.spec, self.payload)
        return body


def _drive(body: Any, made: Made) -> None:
    """Adds the drives and their friction.

    The controls are, joint by joint, a torque; with the servo inside, position, speed and torque of a `pid`.
    LuGre friction is a `dcmotor` of its own without voltage, so that a torque limit holds for the command
    alone; it needs no solver, which makes it faster than MuJoCo's `frictionloss`.
    """
    import mujoco

    spec, loop, motors = made.spec, made.loop, made.motors
    body.option.timestep = loop.timestep
    for j, name in enumerate(spec.names):
        joint = body.joint(name)
        joint.damping = [motors.viscous[j] + motors.braking[j], 0.0, 0.0]
        if loop.friction == "coulomb":
            joint.frictionloss = motors.coulomb[j]
        drive = _actuator(body, name, name)
        if loop.loop == "inside":
            inputs = mujoco.mjtCtrlInput
            wanted = int(inputs.mjINPUT_POS) | int(inputs.mjINPUT_VEL) | int(inputs.mjINPUT_FF)
            drive.set_to_pid(kp=motors.kp[j], kv=motors.kd[j], ctrlspec=wanted)
        else:
            drive.set_to_motor()
        drive.forcelimited, drive.forcerange = 1, [-motors.torque[j], motors.torque[j]]
    if loop.friction == "lugre":
        for j, name in enumerate(spec.names):
            _bristles(_actuator(body, f"friction of {name}", name), motors, j)


def _actuator(body: Any, name: str, joint: str) -> Any:
    import mujoco

    actuator = body.add_actuator(name=free_name(name, {one.name for one in body.actuators}), target=joint)
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    return actuator


def _bristles(actuator: Any, motors: Motors, j: int) -> None:
    import mujoco

    levels = [motors.coulomb[j], motors.static[j], motors.stribeck[j]]
    actuator.set_to_dcmotor(
        motorconst=[LEAST, LEAST],
        resistance=1.0,
        lugre=[motors.stiffness[j], motors.micro_damping[j], *levels],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE),
    )
