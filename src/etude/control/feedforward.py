"""Feedforward: a function from a sampled trajectory to commands, computed before the robot moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from etude.errors import NumericalError, UsageError
from etude.plants.robot import SimulatedRobot
from etude.robots.spec import RobotSpec
from etude.trajectories.samples import TrajectorySamples

Array = NDArray[np.float64]
Feedforward = Callable[[TrajectorySamples], Array]

# Predicted over prior variance between which trust in a model goes from 1 to 0. Below half the model has
# learnt more than it has left to learn; from 0.9 on it knows no more than before its first trajectory.
TRUSTED, UNKNOWN = 0.5, 0.9


class CommandModel(Protocol):
    """What a feedforward asks of an inverse dynamics model."""

    @property
    def prior_deviation(self) -> Array:
        """(dof,) standard deviation of each command before any data."""
        ...

    def predict(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Mean and variance (T, dof) of the command."""
        ...


def no_feedforward(spec: RobotSpec) -> Feedforward:
    """Feedback alone: zeros (T, dof)."""
    return lambda samples: np.zeros((len(samples.t), spec.dof))


def perfect_feedforward(robot: SimulatedRobot) -> Feedforward:
    """The simulated robot's exact inverse model, clipped to its commands: what no model can do better."""

    def feedforward(samples: TrajectorySamples) -> Array:
        return _clip(robot.inverse(samples.q, samples.qd, samples.qdd), robot.spec)

    return feedforward


def model_feedforward(model: CommandModel, spec: RobotSpec, fade: bool = True) -> Feedforward:
    """The model's mean command, clipped, and faded out where the model does not know better than its prior.

    Args:
        model: predicts the command's mean and variance. If it has a `fallback` with
            `predict(q, qd, qdd) -> (T, dof)`, the command fades to that instead of to zero.
        spec: the robot; its command limits clip.
        fade: False applies the mean everywhere.

    Raises:
        UsageError: the model is of another robot.
        NumericalError: on call, a prediction that is not finite.
    """
    prior = np.asarray(model.prior_deviation, dtype=np.float64)
    if prior.shape != (spec.dof,):
        raise UsageError(
            f"the model has {prior.size} outputs, the robot {spec.name} has {spec.dof} joints",
            next_step="Use the model that was trained for this robot.",
        )
    fallback = getattr(model, "fallback", None)

    def feedforward(samples: TrajectorySamples) -> Array:
        mean, variance = model.predict(samples.q, samples.qd, samples.qdd)
        _require_finite(mean, variance, spec)
        if fade:
            rest = _fallback_command(fallback, samples)
            mean = rest + trust(variance, prior) * (mean - rest)
        return _clip(mean, spec)

    return feedforward


def trust(variance: Array, prior_deviation: Array) -> Array:
    """Weight (T, dof) of a model's mean: 1 where its variance is small against the prior's, else 0.

    A quintic step, so a feedforward along a smooth trajectory has no jumps in its first two derivatives.
    """
    ratio = variance / prior_deviation**2
    return 1.0 - smoothstep(np.clip((ratio - TRUSTED) / (UNKNOWN - TRUSTED), 0.0, 1.0))


def smoothstep(s: Array) -> Array:
    """From 0 at s = 0 to 1 at s = 1, flat to the second derivative at both ends."""
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _fallback_command(fallback: Any, samples: TrajectorySamples) -> Array:
    if fallback is None:
        return np.zeros_like(samples.q)
    return np.asarray(fallback.predict(samples.q, samples.qd, samples.qdd), dtype=np.float64)


def _require_finite(mean: Array, variance: Array, spec: RobotSpec) -> None:
    bad = ~np.logical_and.reduce(np.isfinite(mean) & np.isfinite(variance), axis=0)
    if bad.any():
        joints = ", ".join(name for name, is_bad in zip(spec.names, bad.tolist(), strict=True) if is_bad)
        raise NumericalError(
            "the model's prediction is not finite",
            where=joints,
            next_step="Train it again; do not run this feedforward.",
        )


def _clip(command: Array, spec: RobotSpec) -> Array:
    clipped: Array = np.clip(command, -spec.command, spec.command)
    return clipped
