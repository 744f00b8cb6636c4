"""The arm behind the SimulatedRobot interface: parameters and robot description bound to an engine."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from etude.errors import UsageError
from etude.robots.arm.plant.parameters import ArmParameters, load_parameters
from etude.robots.arm.plant.robot import Gains, SimulatedRobot
from etude.robots.arm.plant.trace import Array, LoopInputs, Running, Trace
from etude.robots.arm.spec import ArmSpec


def arm_robot(name: str, spec: ArmSpec, engine: str) -> SimulatedRobot:
    """The arm whose parameters are `plants/data/NAME.toml`, as `spec` describes it to its owner.

    Raises:
        UsageError: an unknown engine, or a spec with other joints or a rate that the physics cannot keep.
    """
    arm = load_parameters(name)
    _check(name, spec, arm)
    return SimulatedRobot(
        name=name,
        spec=spec,
        gains=Gains(kp=np.array(arm.controller.kp), kd=np.array(arm.controller.kd)),
        timestep=arm.timestep,
        encoder_noise=arm.controller.encoder_noise,
        closed_loop=_engine(engine, arm),
        inverse_model=partial(_inverse, arm),
        begin=partial(_begin, arm) if engine == "compiled" else None,
    )


def _engine(engine: str, arm: ArmParameters) -> Callable[[LoopInputs], Trace]:
    """One engine's closed loop; its heavy package is imported only when chosen."""
    if engine == "mujoco":
        from etude.robots.arm.plant.mujoco_engine import simulate as simulate_in_mujoco

        return partial(simulate_in_mujoco, arm)
    if engine == "compiled":
        from etude.robots.arm.plant.compiled import simulate

        return partial(simulate, arm)
    raise UsageError(f"there is no engine {engine!r}", next_step="Choose one of: mujoco, compiled.")


def _begin(arm: ArmParameters, q: Array) -> Running:
    from etude.robots.arm.plant.running import RunningArm

    return RunningArm(arm, q)


def _inverse(arm: ArmParameters, q: Array, qd: Array, qdd: Array) -> Array:
    from etude.robots.arm.plant.compiled import inverse

    return inverse(arm, q, qd, qdd)


def _check(name: str, spec: ArmSpec, arm: ArmParameters) -> None:
    joints = tuple(motor.joint for motor in arm.motors)
    if spec.names != joints:
        raise UsageError(
            f"the robot's joints {', '.join(spec.names)} are not those of the plant {name}",
            where=spec.name,
            next_step=f"Name them {', '.join(joints)}, in this order.",
        )
    steps = 1.0 / (spec.rate * arm.timestep)
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise UsageError(
            f"a control rate of {spec.rate:g} Hz is no multiple of the plant's time step {arm.timestep:g} s",
            where=spec.name,
            next_step="Choose a rate such as 100 Hz.",
        )
