"""Feedforward of an arm: a learned command, or the exact one of a simulated arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude.errors import NumericalError, UsageError
from etude.protocols import Inputs
from etude.types import Array, Log, Motion, Row
from etude_arm.plant.feedback_loop import Following
from etude_arm.spec import MEMORY, TURNING, ArmSpec


class Fading(Protocol):
    """A model whose command fades to its physics without information (`LearnedModel`)."""

    @property
    def inputs(self) -> Inputs: ...
    def predict(self, log: Log) -> tuple[Array, Array]: ...
    def faded(self, log: Log) -> Array: ...


@dataclass(frozen=True, eq=False)
class ModelController:
    """A model's mean command, clipped, and faded where the model has no more information than before any
    data.

    It fades to the model's physics, or to a constant (implements `protocols.Controller`).

    Attributes:
        model: predicts the command's mean and variance from states.
        spec: gives the command limits.
    """

    model: Fading
    spec: ArmSpec

    def planned(self, motion: Motion) -> Array | None:
        """Commands (T, J) of a perfect run. NumericalError: a prediction is not finite."""
        return self._checked(self.model.faded(self.model.inputs.states(motion)))

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The command at one instant, and its standard deviation."""
        states = self.model.inputs.states(Motion(np.zeros(1), np.zeros((3, 1, self.spec.dof))))
        channels = {**states.channels, TURNING: self.spec.turning(), MEMORY: self.spec.memory()}
        values = {name: row[name][None] for name in channels if name in row}
        log = Log(np.array([t]), {name: channels[name] for name in values}, values)
        mean, variance = self.model.predict(log)
        return self._checked(mean, variance)[0], np.sqrt(variance[0])

    def observe(self, t: float, row: Row) -> None:
        """Does nothing: this controller does not learn during a motion."""

    def _checked(self, mean: Array, variance: Array | float = 0.0) -> Array:
        """The commands (T, J) within the limits. NumericalError: they or their variances are not finite."""
        if mean.shape[1] != self.spec.dof:
            raise UsageError(
                f"the model has {mean.shape[1]} commands, but the robot {self.spec.name} has "
                f"{self.spec.dof} joints",
                next_step="Use the model that was trained for this robot.",
            )
        bad = ~np.logical_and.reduce(np.isfinite(mean) & np.isfinite(variance), axis=0)
        if bad.any():
            joints = ", ".join(name for name, is_bad in zip(self.spec.names, bad, strict=True) if is_bad)
            raise NumericalError(
                "the model's prediction is not finite",
                where=joints,
                next_step="Do not run this feedforward. Train the model again.",
            )
        return np.clip(mean, -self.spec.command, self.spec.command)


@dataclass(frozen=True, eq=False)
class PerfectController:
    """The simulated robot's exact inverse, clipped to its commands; no model can exceed it."""

    robot: Following

    def planned(self, motion: Motion) -> Array | None:
        limit = self.robot.spec.command
        return np.clip(self.robot.inverse_along(*motion.orders[:3]), -limit, limit)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:  # noqa: ARG002
        limit = self.robot.spec.command
        steady = self.robot.inverse(*(row[name][None] for name in ("q_des", "qd_des", "qdd_des")))[0]
        return np.clip(steady, -limit, limit), np.zeros_like(steady)

    def observe(self, t: float, row: Row) -> None:
        """Does nothing: this controller does not learn during a motion."""
