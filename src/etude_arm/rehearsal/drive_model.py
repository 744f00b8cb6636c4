"""Bodies and drives of the robot, stepped by MuJoCo, with two forms of feedback loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from mujoco import rollout

from etude.types import Array
from etude_arm.loading.parsing import free_name
from etude_arm.plant.trace import LoopInputs, Trace
from etude_arm.rehearsal.body import bare_body, rows, with_payload
from etude_arm.rehearsal.motors import Motors
from etude_arm.rehearsal.overlay import Simulate
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    import mujoco

    from etude_arm.loading.loaded_model import Loaded

FRICTION_ALONE = 1e-9
"""Motor constant of a drive that models friction alone, without back-EMF."""


@dataclass(frozen=True, eq=False)
class RunParameters:
    """The parameters of a simulated run.

    Attributes:
        spec: the robot; loaded: its model file.
        loop: its control loop, complete. motors: its drives. payload: kg at its tip.
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
        """The compiled model of a run; see `_drive`."""
        body = self._bodies()
        _drive(body, self)
        return self._compiled(body)

    def _compiled(self, body: Any) -> mujoco.MjModel:
        """Raises an UnsafeModelError if it differs from the file's robot; skipped with a simulated
        payload.
        """
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


def _drive(body: Any, parameters: RunParameters) -> None:
    """Adds the drives and their friction.

    Each joint has one control, a torque; with the servo inside, it has position, speed and torque of a `pid`.
    LuGre friction is a `dcmotor` of its own without voltage, so that a torque limit holds for the command
    alone; it needs no solver, which makes it faster than MuJoCo's `frictionloss`.
    """
    import mujoco

    spec, loop, motors = parameters.spec, parameters.loop, parameters.motors
    body.option.timestep = loop.timestep
    for j, name in enumerate(spec.names):
        joint = body.joint(name)
        joint.damping = [motors.viscous[j] + motors.braking[j], 0.0, 0.0]
        if loop.friction == "coulomb":
            joint.frictionloss = motors.coulomb[j]
        drive = _actuator(body, name, name)
        if loop.loop == "inside":
            inputs = mujoco.mjtCtrlInput
            signals = int(inputs.mjINPUT_POS) | int(inputs.mjINPUT_VEL) | int(inputs.mjINPUT_FF)
            drive.set_to_pid(kp=motors.kp[j], kv=motors.kd[j], ctrlspec=signals)
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
        motorconst=[FRICTION_ALONE, FRICTION_ALONE],
        resistance=1.0,
        lugre=[motors.stiffness[j], motors.micro_damping[j], *levels],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE),
    )


STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class RehearsedRun:
    """A run step by step (implements `plant.trace.Running`), from rest at q (J,)."""

    def __init__(self, parameters: RunParameters, q: Array) -> None:
        self._parameters, self._model = parameters, parameters.driven
        self._data = mujoco.MjData(self._model)
        self._dofs = rows(self._model, parameters.spec)
        self._data.qpos[self._dofs] = q
        self._waiting: Array | None = None  # controls sent and not yet felt, one physics step a row
        self._before: Array | None = None
        self._rate = np.zeros(parameters.spec.dof)

    def change(self, parameters: RunParameters) -> None:
        """From the next tick on the physics are those of the other robot; positions, speeds and bristles
        stay.
        """
        before = self._data
        self._parameters, self._model = parameters, parameters.driven
        self._data = mujoco.MjData(self._model)
        for name in ("time", "qpos", "qvel", "act"):
            setattr(self._data, name, getattr(before, name))

    def advance(self, inputs: LoopInputs) -> Trace:
        """Continues over the ticks of `inputs`."""
        if self._parameters.loop.loop == "inside":
            return self._inside(inputs)
        return Trace.joined([self._outside(inputs, k) for k in range(len(inputs.q_des))])

    def _inside(self, inputs: LoopInputs) -> Trace:
        """Set-points to the drives, which follow them from tick to tick; one rollout."""
        ticks, dof = inputs.q_des.shape
        set_points = _between(inputs, self._parameters.loop.timestep)
        controls = self._delayed(np.concatenate(set_points, axis=1))
        start = self._state()
        orders = np.arange(3 * dof).reshape(3, dof).T.ravel()  # MuJoCo's: joint by joint
        padded = np.zeros((len(controls), mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_CTRL)))
        padded[:, : 3 * dof] = controls[:, orders]
        states = rollout.rollout(self._model, self._data, start[None], padded[None])[0][0]
        mujoco.mj_setState(self._model, self._data, states[-1], STATE)
        path = np.concatenate([start[None], states])
        q = path[:, 1 + self._dofs]
        qd = path[:, 1 + self._model.nq + self._dofs]
        torque = _servo(self._parameters.motors, controls, q, qd)
        command = torque.reshape(ticks, inputs.substeps, dof).mean(axis=1) / self._parameters.motors.gain
        true = q[:: inputs.substeps][:ticks]
        return Trace(self._measured(true + inputs.noise), true, command, command - inputs.tau_ff)

    def _outside(self, inputs: LoopInputs, k: int) -> Trace:
        """One tick: encoders, feedback, a command that is held."""
        motors, loop = self._parameters.motors, self._parameters.loop
        true = self._data.qpos[self._dofs].copy()
        q = self._measured(true + inputs.noise[k])
        if self._before is not None:
            share = loop.velocity_filter
            self._rate = self._rate + share * ((q - self._before) * self._parameters.spec.rate - self._rate)
        self._before = q
        demand = motors.kp * (inputs.q_des[k] - q) + motors.kd * (inputs.qd_des[k] - self._rate)
        feedback = demand / motors.gain
        limit = self._parameters.spec.command
        command = np.clip(_whole(feedback + inputs.tau_ff[k], self._parameters.spec), -limit, limit)
        torques = self._delayed(np.tile(command * motors.gain, (inputs.substeps, 1)))
        for torque, steps in _runs(torques):
            self._data.ctrl[: len(torque)] = torque
            mujoco.mj_step(self._model, self._data, nstep=steps)
        return Trace(*(row[None] for row in (q, true, command, feedback)))

    def _measured(self, q: Array) -> Array:
        tick = self._parameters.motors.tick
        return np.asarray(np.rint(q / tick) * tick)

    def _delayed(self, sent: Array) -> Array:
        """Delayed controls while `sent` (steps, n) is sent; before the first row, its value was constant."""
        late = round(self._parameters.loop.delay / self._parameters.loop.timestep)
        if self._waiting is None:
            self._waiting = np.repeat(sent[:1], late, axis=0)
        both = np.concatenate([self._waiting, sent])
        self._waiting = both[len(sent) :]
        return both[: len(sent)]

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self._model, STATE))
        mujoco.mj_getState(self._model, self._data, state, STATE)
        return state


def _servo(motors: Motors, controls: Array, q: Array, qd: Array) -> Array:
    """(N, J) torque of the drives in each of N steps; q, qd (N + 1, J).

    The integrator is implicit: damping acts with the speed at a step's end, but for a torque at its limit.
    """
    position, speed, ahead = np.split(controls, 3, axis=1)
    undamped = motors.kp * (position - q[:-1]) + ahead
    explicit = undamped + motors.kd * (speed - qd[:-1])
    limited = np.clip(explicit, -motors.torque, motors.torque)
    return np.where(limited == explicit, undamped + motors.kd * (speed - qd[1:]), limited)


def _between(inputs: LoopInputs, timestep: float) -> tuple[Array, Array, Array]:
    """Position, speed and torque (T substeps, J) at every physics step; torques are held."""
    after = (np.arange(inputs.substeps) * timestep)[None, :, None]
    bend = np.zeros_like(inputs.q_des) if inputs.qdd_des is None else inputs.qdd_des
    q, qd, qdd, ff = (rows[:, None] for rows in (inputs.q_des, inputs.qd_des, bend, inputs.tau_ff))
    position, speed = q + after * (qd + 0.5 * after * qdd), qd + after * qdd
    flat = (-1, inputs.q_des.shape[1])
    torque = np.broadcast_to(ff, position.shape)
    return position.reshape(flat), speed.reshape(flat), torque.reshape(flat)


def _runs(held: Array) -> Iterator[tuple[Array, int]]:
    """Runs of equal rows, and their lengths."""
    edges = [0, *(np.flatnonzero(np.any(held[1:] != held[:-1], axis=1)) + 1).tolist(), len(held)]
    for first, last in pairwise(edges):
        yield held[first], last - first


def _whole(command: Array, spec: ArmSpec) -> Any:
    """Commands rounded to integers if their unit is pwm."""
    return np.rint(command) if spec.command_unit == "pwm" else command
