"""The lines beside the models of chapter 6: what the same logs teach linear regression and a rigid body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from etude.campaign import preset_config
from etude.models import linear_inputs
from etude.protocols import Controller, Inputs
from etude.types import Array, Log, Motion, Row
from etude_studies.world import World

RIDGE = 0.1
"""Added to the correlation matrix of the columns: one series with N = 2 and one omega0 has rank 5."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Commands by ridge regression in the inputs, standardised (a `protocols.Mean` as far as a run needs it).

    Attributes:
        inputs: gives the regressors. centre, scale: (D,) of them. weights: (D, J). offset: (J,).
    """

    inputs: Inputs
    centre: Array
    scale: Array
    weights: Array
    offset: Array

    @classmethod
    def of(cls, inputs: Inputs, log: Log, command: Array) -> Linear:
        """Fitted to commands (n, J)."""
        X = linear_inputs(inputs, inputs.of_log(log))[:, :-1]
        centre, deviation = X.mean(axis=0), X.std(axis=0)
        scale = np.where(deviation > 0.0, deviation, 1.0)
        Z, offset = (X - centre) / scale, command.mean(axis=0)
        gram = Z.T @ Z / len(Z) + RIDGE * np.eye(Z.shape[1])
        return cls(inputs, centre, scale, np.linalg.solve(gram, Z.T @ (command - offset) / len(Z)), offset)

    def predict(self, log: Log) -> Array:
        """Commands (n, J)."""
        X = linear_inputs(self.inputs, self.inputs.of_log(log))[:, :-1]
        return np.asarray(self.offset + ((X - self.centre) / self.scale) @ self.weights)


@dataclass(frozen=True, eq=False)
class Applied:
    """A mean's command of the planned motion, clipped (implements `protocols.Controller`)."""

    mean: Any
    inputs: Inputs
    limit: Array

    def planned(self, motion: Motion) -> Array | None:
        """(T, J)."""
        command = self.mean.predict(self.inputs.states(motion))
        return np.asarray(np.clip(command, -self.limit, self.limit))

    def command(self, t: float, row: Row) -> tuple[Array, Array]:  # noqa: ARG002
        """Of one instant of the plan."""
        orders = np.stack([row[name][None] for name in ("q_des", "qd_des", "qdd_des")])
        output = self.planned(Motion(np.zeros(1), orders))
        assert output is not None
        return output[0], np.zeros_like(self.limit)

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way."""


@dataclass(frozen=True, eq=False)
class Given:
    """A command that is known ahead, clipped (implements `protocols.Controller`).

    Attributes:
        commands: (T, J) at the control ticks. rate: of these, Hz. limit: (J,).
    """

    commands: Array
    rate: float
    limit: Array

    def planned(self, motion: Motion) -> Array | None:  # noqa: ARG002
        """(T, J)."""
        return np.clip(self.commands, -self.limit, self.limit)

    def command(self, t: float, row: Row) -> tuple[Array, Array]:  # noqa: ARG002
        """Of the nearest tick."""
        place = min(max(round(t * self.rate), 0), len(self.commands) - 1)
        return np.clip(self.commands[place], -self.limit, self.limit), np.zeros_like(self.limit)

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way."""


def lines(world: World, logs: Sequence[Log]) -> Mapping[str, Controller]:
    """Controllers that these logs teach, by name.

    "linear" and "identified" look at what `world` looks at (in the thesis's protocol the desired motion),
    "identified_measured" at measured positions, filtered as a campaign does by default.
    """
    kind, spec = world.kind, world.spec
    samples, inputs = world.samples(*logs), kind.inputs(spec, world.config)
    default = preset_config(kind, "default")
    data = replace(default.data, presliding=0.0)  # as when the runs began: without what friction remembers
    filtered = replace(world, config=replace(default, data=data))
    means = {
        "linear": Linear.of(inputs, samples.log, samples.command),
        "identified": kind.physics(spec, world.config)["identified"](samples),
        "identified_measured": kind.physics(spec, filtered.config)["identified"](filtered.samples(*logs)),
    }
    limit = kind.limit(spec)
    return {name: Applied(mean, inputs, limit) for name, mean in means.items()}
