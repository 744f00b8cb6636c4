"""Predictions of the trained model at planned instants, and the choice of informative measured ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from etude.models.data.as_log import carried
from etude.models.learned_model import LearnedModel
from etude.protocols import Controller
from etude.types import Array, Channel, Log, Motion, Row
from etude_online.command import Command


@dataclass(frozen=True, eq=False)
class Ahead:
    """A plan asked for ahead of the run: times (T,), inputs (T, D), mean function, frozen command (T, J)."""

    t: Array
    X: Array
    base: Array
    frozen: Array


class Planned:
    """A model as it was trained, asked instant by instant, or for a plan at once.

    Args:
        frozen: the controller of the model; None: its own mean.
        rate: of the control ticks, Hz.
    """

    STATE_FIELDS = ("_memory", "_carried")

    def __init__(
        self,
        model: LearnedModel,
        channels: Mapping[str, Channel],
        frozen: Controller | None,
        commands: Sequence[Command],
        rate: float,
    ) -> None:
        self.model, self._channels, self._frozen = model, channels, frozen
        self._commands, self._rate = commands, rate
        self.path = path_of(model, channels)
        self._ahead: Ahead | None = None
        self._memory: Array | None = None
        self._carried: Array | None = None

    @property
    def ahead(self) -> bool:
        """Whether a whole plan was asked for, so that rows are not verified."""
        return self._ahead is not None

    def take(self, motion: Motion) -> None:
        """Asks for a whole plan, once, where the trained model's controller can."""
        states = self.model.inputs.states(motion)
        frozen = self.model.mean(states) if self._frozen is None else self._frozen.planned(motion)
        self._ahead = None
        if frozen is not None:
            base = np.column_stack([command.base(states) for command in self._commands])
            self._ahead = Ahead(motion.t, self.model.inputs.of_log(states), base, frozen)

    def instant(self, t: float, row: Row) -> tuple[Array, Array, Array]:
        """Inputs (D,), mean function and frozen command (J,) of a planned instant."""
        ahead = self._ahead
        if ahead is not None:
            # before the plan begins its first row holds, as in every run
            k = int(np.clip(np.searchsorted(ahead.t, t - 0.5 / self._rate), 0, len(ahead.t) - 1))
            return ahead.X[k], ahead.base[k], ahead.frozen[k]
        x, memory = self.model.inputs.step(row, self._memory)
        states, left = carried(self.model.inputs, self.states(t, row), self._carried)
        base = np.array([command.base(states)[0] for command in self._commands])
        channels = {**row, **{name: values[0] for name, values in states.values.items()}}
        frozen = self.model.mean(states)[0] if self._frozen is None else self._frozen.command(t, channels)[0]
        if np.isfinite(x).all():
            self._memory, self._carried = memory, left
        return x, base, frozen

    def states(self, t: float, row: Row) -> Log:
        """One instant as a log."""
        arrays = {name: np.atleast_2d(values) for name, values in row.items() if name in self._channels}
        return Log(np.array([t]), {name: self._channels[name] for name in arrays}, arrays)

    def moving(self, t: float, row: Row) -> NDArray[np.bool_]:
        """(J,) whether a sample is informative on each command; half the weight of a planned one decides."""
        if not self.path:
            return np.ones(len(self._commands), dtype=np.bool_)
        motion = Motion(np.array([t]), np.stack([row[name][None] for name in self.path]))
        return np.asarray(self.model.inputs.plan(motion).gains[0] ** 2 >= 0.5)


def path_of(model: LearnedModel, channels: Mapping[str, Channel]) -> list[str]:
    """The inputs that are the path and its rates, as many as plans have; none if it looks elsewhere."""
    names = list(dict.fromkeys(channel for channel, *_ in model.inputs.columns))[: model.inputs.orders]
    follows = [channels[rate].derivative_of == name for name, rate in pairwise(names)]
    return names if len(names) == model.inputs.orders and all(follows) else []
