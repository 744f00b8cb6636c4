"""What is added to an arm's feedback: a learned command, or the exact one of a simulated arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Log, Model, Motion, Row
from etude.errors import NumericalError, UsageError
from etude.robots.arm.plant.robot import ArmRobot
from etude.robots.arm.spec import ArmSpec

PHYSICS = ("nominal", "identified")
"""Rungs whose mean is sound where nothing was seen; a linear trend is not."""


@dataclass(frozen=True, eq=False)
class ModelController:
    """The model's mean command, clipped, and faded out where the model knows no better than before any data.

    It fades to the physics that the model stands on, or to zero (implements `contracts.Controller`).

    Attributes:
        model: predicts the command's mean and variance from states.
        spec: its command limits clip.
        fade: False applies the mean everywhere.
    """

    model: Model
    spec: ArmSpec
    fade: bool = True

    def planned(self, motion: Motion) -> Array | None:
        """Commands (T, J) of a perfect run. NumericalError if the model predicts what is not finite."""
        return self._commands(self.model.inputs.states(motion))[0]

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The command at one instant, and its standard deviation."""
        channels = self.model.inputs.states(Motion(np.zeros(1), np.zeros((3, 1, self.spec.dof)))).channels
        values = {name: row[name][None] for name in channels if name in row}
        log = Log(np.array([t]), {name: channels[name] for name in values}, values)
        command, deviation = self._commands(log)
        return command[0], deviation[0]

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way."""

    def _commands(self, log: Log) -> tuple[Array, Array]:
        from etude.models.trust import trusted

        mean, variance = self.model.predict(log)
        self._require_finite(mean, variance)
        if self.fade:
            mean = trusted(mean, variance, prior_deviation(self.model, self.spec), _safe(self.model, log))
        return np.clip(mean, -self.spec.command, self.spec.command), np.sqrt(variance)

    def _require_finite(self, mean: Array, variance: Array) -> None:
        bad = ~np.logical_and.reduce(np.isfinite(mean) & np.isfinite(variance), axis=0)
        if bad.any():
            joints = ", ".join(name for name, is_bad in zip(self.spec.names, bad, strict=True) if is_bad)
            raise NumericalError(
                "the model's prediction is not finite",
                where=joints,
                next_step="Train it again; do not run this feedforward.",
            )


@dataclass(frozen=True, eq=False)
class PerfectController:
    """The simulated robot's exact inverse, clipped to its commands: what no model can do better."""

    robot: ArmRobot

    def planned(self, motion: Motion) -> Array | None:
        limit = self.robot.spec.command
        return np.clip(self.robot.inverse(*motion.orders[:3]), -limit, limit)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:  # noqa: ARG002
        planned = Motion(np.zeros(1), np.stack([row[name][None] for name in ("q_des", "qd_des", "qdd_des")]))
        command = self.planned(planned)
        assert command is not None
        return command[0], np.zeros_like(command[0])

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way."""


def prior_deviation(model: Model, spec: ArmSpec) -> Array:
    """(J,) deviation of what each command's process learns, before any data, command units.

    Of a command that is predicted without a process, that of the best candidate which has one: it still says
    where the robot has been. UsageError if the model is of another robot.
    """
    found, weight = np.full(spec.dof, np.nan), np.full(spec.dof, -1.0)
    for candidate in model.candidates:
        if max(candidate.commands) >= spec.dof:
            raise UsageError(
                f"the model has a command {max(candidate.commands)}, the robot {spec.name} {spec.dof} joints",
                next_step="Use the model that was trained for this robot.",
            )
        if candidate.process is None:
            continue
        prior = candidate.process.signal_variance + candidate.process.noise_variance
        for place, command in enumerate(candidate.commands):
            if candidate.weights[place] > weight[command]:
                weight[command] = candidate.weights[place]
                found[command] = abs(candidate.units[1, place]) * np.sqrt(prior[place])
    return np.where(np.isfinite(found), found, np.inf)  # without a process nothing fades


def _safe(model: Model, log: Log) -> Array:
    """Commands (T, J) of the physics that take part in the answer; zero where there are none."""
    commands = {command for candidate in model.candidates for command in candidate.commands}
    safe = np.zeros((len(log), len(commands)))
    for candidate in model.candidates:
        if candidate.mean is None or candidate.rung.split("+")[0] not in PHYSICS:
            continue
        own = list(candidate.commands)
        safe[:, own] += candidate.weights * candidate.mean.predict(log)[:, own]
    return safe
