"""The arm of seven joints in a closed loop: MuJoCo, friction, gravity, and PD control that nobody tuned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from etude.protocols import Controller, Trajectory
from etude.types import Array, Log
from etude_studies.seven_joints import ENCODER, PANDA_LIKE, RATE, SevenJoints, mjcf
from etude_studies.world import World

STEPS = 10
"""Of the physics, and of the feedback, for each row of the log."""
ARMATURE = 0.05
"""kg m^2 of each motor at its joint."""
LEAD_IN = 1.0
"""s in which the arm settles in the first pose, as one that is switched on has."""
STIFF, DAMPED = 10.0, 0.05
"""Gains: torque limits a rad, and s of them."""


@dataclass(frozen=True, eq=False)
class SevenLoop:
    """Stands in for a simulated robot: `run`, `inverse`, `inverse_along`, `spec`, `world`."""

    arm: SevenJoints

    @property
    def world(self) -> World:
        """As its owner knows it."""
        return self.arm.world

    @property
    def spec(self) -> object:
        """Its description."""
        return self.world.spec

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, 7) exact torques, N m."""
        return self.arm.inverse(q, qd, qdd) + ARMATURE * qdd

    def inverse_along(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, 7) the same: its friction remembers nothing."""
        return self.inverse(q, qd, qdd)

    def run(self, motion: Trajectory, controller: Controller | None, rng: np.random.Generator) -> Log:
        """Follows the motion by PD control and what the controller plans, for as long as the motion lasts."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(mjcf(self.arm.payload, self.arm.built))
        model.opt.timestep, model.dof_armature[:] = 1.0 / (RATE * STEPS), ARMATURE
        data, limit = mujoco.MjData(model), self.arm.built.limit
        t = np.arange(-round(LEAD_IN * RATE), round(motion.duration * RATE)) / RATE
        plan = motion.motion(np.maximum(t, 0.0), 3)
        ahead = np.zeros_like(plan.orders[0]) if controller is None else controller.planned(plan)
        assert ahead is not None
        data.qpos[:], data.qvel[:] = plan.orders[0, 0], plan.orders[1, 0]
        q, command = np.zeros_like(ahead), np.zeros_like(ahead)
        for k in range(len(t)):
            q[k] = data.qpos
            for _ in range(STEPS):
                error, rate = plan.orders[0, k] - data.qpos, plan.orders[1, k] - data.qvel
                command[k] = np.clip(ahead[k] + STIFF * limit * (error + DAMPED * rate), -limit, limit)
                data.qfrc_applied[:] = command[k] - self._friction(data.qpos, data.qvel)
                mujoco.mj_step(model, data)
        channels = {c.name: c for c in self.world.kind.channels(self.world.spec)}
        values = {"q": q + ENCODER * rng.standard_normal(q.shape), "command": command, "q_true": q}
        return Log(t, {n: channels[n] for n in values}, values, "seven joints")

    def _friction(self, q: Array, qd: Array) -> Array:
        return np.asarray(self.arm.friction_at(q[None], qd[None])[0])


@cache
def seven_loop() -> SevenLoop:
    """With a cobot's limits."""
    return SevenLoop(SevenJoints(built=PANDA_LIKE))
