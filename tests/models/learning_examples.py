"""A small two-joint robot that is not there: its samples, inputs and physics, for tests of learned models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude.errors import DataError
from etude.models import (
    Folds,
    LearnedModel,
    ModelConfig,
    ModelSelection,
    fit_data,
    fold_numbers,
    in_order,
    rows_of,
    select_structures,
    units_of,
)
from etude.protocols import FitData
from etude.types import Array, Channel, Column, Log, Samples, joined_samples

NAMES = ("a", "b")
LIMIT = np.full(2, 40.0)
SMALL = ModelConfig(
    rung="gp",
    points=90,
    fit_points=60,
    steps=12,
    candidates=("default",),
    inducing=0,
    warm_from=1,
    warm_steps=0,
)
# a shared kernel, standardised outputs, floors of the deviation: what a quadrotor learns with
TOGETHER = replace(
    SMALL, kernel="ard_se", sharing="shared", floor_of="deviation", noise_floor=0.15, choose_by="absolute"
)
NOISE = 0.2
CHANNELS = {
    "q": Channel("q", NAMES, ("rad", "rad")),
    "qd": Channel("qd", NAMES, ("rad/s", "rad/s"), derivative_of="q"),
    "qdd": Channel("qdd", NAMES, ("rad/s^2", "rad/s^2"), derivative_of="qd"),
    "command": Channel("command", NAMES, ("A", "A"), role="command"),
}


@dataclass(frozen=True)
class Inputs:
    """x = [q, qd, qdd, tanh(qd / v0)], without the last if v0 is 0."""

    v0: float = 0.05

    @property
    def columns(self) -> tuple[Column, ...]:
        plain = [(n, part, unit, "") for n in ("q", "qd", "qdd") for part, unit in self._parts(n)]
        return (*plain, *[("qd", part, "1", "tanh") for part in NAMES if self.v0])

    orders, rate = 3, 0.0

    @staticmethod
    def _parts(name: str) -> list[tuple[str, str]]:
        return list(zip(NAMES, CHANNELS[name].units, strict=True))

    def of_log(self, log: Log) -> Array:
        steps = [np.tanh(log["qd"] / self.v0)] if self.v0 else []
        return np.concatenate([log["q"], log["qd"], log["qdd"], *steps], axis=1)

    def fitted(self, samples: Samples) -> Inputs:
        return self

    def arrays(self) -> dict[str, Array]:
        return {"v0": np.array(self.v0)}

    def restore(self, arrays: Mapping[str, Array]) -> Inputs:
        return Inputs(float(arrays["v0"]))

    # what designs and deployment ask for
    def states(self, motion: Any) -> Log:
        raise NotImplementedError

    def plan(self, motion: Any, keep: Any = None) -> Any:
        raise NotImplementedError

    def step(self, row: Any, memory: Any) -> Any:
        raise NotImplementedError

    def rates(self, motion: Any) -> None:
        return None

    def c(self, name: str) -> None:
        return None


@dataclass(frozen=True, eq=False)
class Pendulum:
    """Gravity, viscous and dry friction of each joint by weights (5, 2)."""

    weights: Array

    def predict(self, log: Log) -> Array:
        return np.asarray(np.einsum("npj,pj->nj", regressors(log), self.weights))

    def static(self, log: Log) -> Array:
        return np.asarray(np.einsum("npj,pj->nj", regressors(log)[:, :3], self.weights[:3]))

    def parameters(self) -> dict[str, tuple[float, float]]:
        return {}

    def arrays(self) -> dict[str, Array]:
        return {"weights": self.weights}

    def c(self, name: str) -> None:
        return None


def regressors(log: Log) -> Array:
    """(n, 5, 2): cos q_0, cos(q_0 + q_1), 1, qd_j, tanh(qd_j / 0.05)."""
    q, qd = log["q"], log["qd"]
    both = [np.cos(q[:, :1]), np.cos(q.sum(axis=1, keepdims=True)), np.ones((len(q), 1))]
    return np.stack([*(np.repeat(column, 2, axis=1) for column in both), qd, np.tanh(qd / 0.05)], axis=1)


class Identified:
    """The pendulum by least squares on the samples at which each joint moves."""

    def __call__(self, samples: Samples | None) -> Pendulum:
        assert samples is not None
        Phi, weights = regressors(samples.log), []
        for j, use in enumerate((samples.usable & samples.moving).T):
            if not use.any():
                raise DataError("An axis never moves", where=NAMES[j])
            weights.append(np.linalg.lstsq(Phi[use, :, j], samples.command[use, j], rcond=None)[0])
        return Pendulum(np.stack(weights, axis=1))

    def restore(self, arrays: Mapping[str, Array]) -> Pendulum:
        return Pendulum(np.asarray(arrays["weights"]))


class Nominal(Identified):
    """Gravity alone."""

    def __call__(self, samples: Samples | None) -> Pendulum:
        return Pendulum(np.array([[8.0, 0.0], [1.2, 1.2], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]))


PHYSICS = {"identified": Identified(), "nominal": Nominal()}


def samples_of(t: Array, q: Array, qd: Array, qdd: Array, command: Array, group: int) -> Samples:
    log = Log(t, CHANNELS, {"q": q, "qd": qd, "qdd": qdd, "command": command})
    every = np.ones(command.shape, dtype=np.bool_)
    return Samples(log, np.full(len(t), group, dtype=np.int64), every, np.abs(qd) >= 0.03)


def trajectory(group: int, seconds: float = 25.0) -> Samples:
    """Noisy commands along a smooth motion: gravity, friction, and a ripple that no physics has."""
    rng = np.random.default_rng(100 + group)
    t = np.arange(0.0, seconds, 0.125)
    speed, phase = rng.uniform(0.3, 0.9, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    angle = t[:, None, None] * speed + phase
    q = 0.5 * np.sin(angle).sum(axis=1)
    qd = 0.5 * (speed * np.cos(angle)).sum(axis=1)
    qdd = -0.5 * (speed**2 * np.sin(angle)).sum(axis=1)
    far = 1.2 * np.cos(q.sum(axis=1))
    command = np.column_stack([8.0 * np.cos(q[:, 0]) + far, far]) + 0.5 * np.sin(8.0 * q)
    command += 1.5 * np.tanh(qd / 0.05) + 0.8 * qd + NOISE * rng.normal(size=q.shape)
    return samples_of(t, q, qd, qdd, command, group)


def trajectories(count: int, seconds: float = 25.0) -> Samples:
    return joined_samples([trajectory(group, seconds) for group in range(count)])


def commanded(samples: Samples, command: Array) -> Samples:
    """The same samples with other commands."""
    return replace(samples, log=samples.log.put(CHANNELS["command"], command))


def selection(
    samples: Samples, config: ModelConfig = SMALL, previous: LearnedModel | None = None, **changes: Any
) -> ModelSelection:
    """The ladder of the robot; `changes` of inputs, physics, limit, seed."""
    inputs = changes.get("inputs", Inputs())
    physics, limit = changes.get("physics", PHYSICS), changes.get("limit", LIMIT)
    rng = np.random.default_rng(changes.get("seed", 0))
    return select_structures(samples, inputs, physics, limit, config, rng, previous)


def train(
    samples: Samples, config: ModelConfig = SMALL, previous: LearnedModel | None = None
) -> LearnedModel:
    return selection(samples, config, previous).model


def fit_of(
    config: ModelConfig, samples: Samples, group: tuple[int, ...] = (0,), start: Any = None
) -> FitData:
    """What a member is given for some commands, the process alone."""
    samples, rng = in_order(samples), np.random.default_rng(0)
    inputs = Inputs()
    fold = fold_numbers(samples, config.stretch_s)
    folds = Folds(samples, inputs, inputs.of_log(samples.log), fold, LIMIT, config, NAMES)
    rows = rows_of(folds, group, rng)
    target = samples.command[:, list(group)]
    units = units_of(target, rows, config)
    floor = np.full(len(group), 0.05)
    return fit_data(folds, group, rows, (target - units[0]) / units[1], floor, start, config, rng)


def posteriors(model: LearnedModel) -> list[Any]:
    """Of the candidates in use, one for each command."""
    return [p for c in model.candidates if c.weights.any() for p in c.process.own]
