"""The arm in MuJoCo: the robot's own rigid-body model, with models of motors and friction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from etude.types import Array
from etude_arm.plant.parameters import ArmParameters, Motor
from etude_arm.plant.trace import LoopInputs, Trace

MODELS = Path(__file__).parents[1] / "data"
COULOMB, STATIC = 3, 4  # where a dcmotor keeps its friction levels in actuator_biasprm


def build_model(arm: ArmParameters) -> mujoco.MjModel:
    """The links' MJCF with one `dcmotor` per joint (back-EMF, LuGre friction, cogging, armature, viscous).

    A linear actuator is a spatial tendon between two sites: the slider-crank transmission would do, but
    takes neither armature nor damping.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS / arm.rigid_body))
    spec.option.timestep = arm.timestep
    spec.option.gravity = [0.0, 0.0, -arm.gravity]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for motor in arm.motors:
        joint = spec.joint(motor.joint)
        joint.limited = 0  # limits are those of the robot file; mechanical stops lie outside them
        _add_motor(spec, joint, motor, arm.controller.supply)
    return spec.compile()


def _add_motor(spec: Any, joint: Any, motor: Motor, supply: float) -> None:
    actuator = spec.add_actuator(name=motor.joint, gear=[motor.gear, 0, 0, 0, 0, 0])
    if motor.fixed is None:
        actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, motor.joint
    else:
        actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_TENDON, _add_tendon(spec, joint, motor)
    actuator.armature = motor.armature
    actuator.damping = [motor.viscous, 0.0, 0.0]
    cogging, (constant, resistance) = motor.cogging, motor.electrical(supply)
    actuator.set_to_dcmotor(  # from K and R: its `nominal` counts viscous friction into the no-load speed
        motorconst=[constant, constant],
        resistance=resistance,
        cogging=[cogging.amplitude, cogging.wavenumber, cogging.phase],
        lugre=[motor.stiffness, motor.micro_damping, motor.coulomb, motor.static, motor.stribeck],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE),
    )


def _add_tendon(spec: Any, joint: Any, motor: Motor) -> str:
    """A tendon between the two pivots of a linear actuator; its name."""
    assert motor.fixed is not None
    assert motor.moving is not None
    body = joint.parent
    tendon = spec.add_tendon(name=f"{motor.joint}_actuator")
    for parent, label, (x, z) in ((body.parent, "fixed", motor.fixed), (body, "moving", motor.moving)):
        site = parent.add_site(name=f"{motor.joint}_{label}", pos=[x, 0.0, z])
        tendon.wrap_site(site.name)
    return str(tendon.name)


class PositionFriction:
    """Position-dependent friction, which MuJoCo has no field for: rewrites the levels before each step."""

    def __init__(self, arm: ArmParameters, model: mujoco.MjModel) -> None:
        ripples = [motor.friction_ripple for motor in arm.motors]
        self.amplitude = np.array([r.amplitude for r in ripples])[:, None]
        self.wavenumber = np.array([r.wavenumber for r in ripples])
        self.phase = np.array([r.phase for r in ripples])
        self.levels = model.actuator_biasprm[:, COULOMB : STATIC + 1]  # a view
        self.nominal = self.levels.copy()
        self.varies = bool(self.amplitude.any())

    def apply(self, length: Array) -> None:
        wave = np.sin(self.wavenumber * length + self.phase)[:, None]
        self.levels[:] = self.nominal * (1.0 + self.amplitude * wave)


def advance(model: mujoco.MjModel, data: mujoco.MjData, friction: PositionFriction, steps: int) -> None:
    """`steps` physics steps under data.ctrl (V)."""
    if not friction.varies:
        mujoco.mj_step(model, data, steps)
        return
    for _ in range(steps):
        mujoco.mj_step1(model, data)
        friction.apply(data.actuator_length)
        mujoco.mj_step2(model, data)


def simulate(arm: ArmParameters, inputs: LoopInputs) -> Trace:
    """The closed loop over all control ticks, from rest at the first desired position."""
    model = build_model(arm)
    data, friction, c = mujoco.MjData(model), PositionFriction(arm, model), arm.controller
    kp, kd, tick = np.array(c.kp), np.array(c.kd), c.encoder_tick
    period = inputs.substeps * arm.timestep
    data.qpos[:] = inputs.q_des[0]
    q, q_true, tau, tau_fb = (np.empty_like(inputs.q_des) for _ in range(4))
    rate = np.zeros(model.nv)
    for k in range(len(q)):
        q_true[k] = data.qpos
        q[k] = np.rint((q_true[k] + inputs.noise[k]) / tick) * tick
        if k > 0:
            rate += c.velocity_filter * ((q[k] - q[k - 1]) / period - rate)
        tau_fb[k] = kp * (inputs.q_des[k] - q[k]) + kd * (inputs.qd_des[k] - rate)
        tau[k] = np.clip(np.rint(tau_fb[k] + inputs.tau_ff[k]), -c.resolution, c.resolution)
        data.ctrl[:] = tau[k] / c.resolution * c.supply
        advance(model, data, friction, inputs.substeps)
    return Trace(q=q, q_true=q_true, tau=tau, tau_fb=tau_fb)
