"""A learned model that goes on learning while the robot runs: a controller over rows of channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from etude.contracts import Array, Channel, Controller, Log, Motion, Row
from etude.errors import UsageError
from etude.models.model import LearnedModel
from etude.models.online.command import Command, learning_command
from etude.models.online.learner import OnlineConfig
from etude.models.online.window import CentredWindow, sources

COMMAND = "command"


@dataclass
class Counts:
    """What became of the measurements: per command (J,), but for `ignored`.

    Attributes:
        learned: samples. still: samples of a joint that stood still. refused: samples that the learner
            raised an error on. ignored: measurements not finite, or not later than the last.
    """

    learned: NDArray[np.int64]
    still: NDArray[np.int64]
    refused: NDArray[np.int64]
    ignored: int = 0


@dataclass(frozen=True, eq=False)
class Ahead:
    """A plan asked for ahead of the run: times (T,), inputs (T, D), mean function, frozen command (T, J)."""

    t: Array
    X: Array
    base: Array
    frozen: Array


class OnlineModel:
    """One learner and one guard for each command of a model (implements `contracts.Controller`).

    Mutable; for one thread. `observe` takes rows of measured channels, tick by tick; `command` mixes the
    updated model into the frozen one. A sample is taken every 1/rate_hz from the middle of the window,
    skipped where a joint stands still, judged, and learned `hold_s` later; the commands learn in turn, in
    different ticks, so that no tick pays for all of them.

    Args:
        model: its commands come from exact processes or dictionaries, or have such a rung beside physics.
        channels: of the kind; a wanted one that is not measured is had as the rate of one that is.
        frozen: the controller of the model as it was trained, which drives where the learners have no weight;
            None: the model's own mean.
        limits: lower and upper (J,) of the commands.
        config: how to go on.
        rate: of the control ticks, Hz.
        rng: of what the learners draw.

    Raises:
        UsageError: a command has no such process, or limits of another robot.
    """

    def __init__(
        self,
        model: LearnedModel,
        channels: Sequence[Channel],
        frozen: Controller | None,
        limits: tuple[Array, Array],
        config: OnlineConfig,
        rate: float,
        rng: np.random.Generator,
    ) -> None:
        count = len(model.commands)
        if any(np.shape(limit) != (count,) for limit in limits):
            raise UsageError(f"the model has {count} commands, the limits are {limits}")
        self.model, self.config, self._frozen, self._limits = model, config, frozen, limits
        self._channels = {channel.name: channel for channel in channels}
        self.commands = [learning_command(model, j, config, rng) for j in range(count)]
        learned, still, refused = np.zeros((3, count), dtype=np.int64)
        self.counts = Counts(learned, still, refused)
        self._rate = rate
        self._window: CentredWindow | None = None
        self._stride = max(1, round(rate / config.rate_hz))
        self._turn = [j * self._stride // count for j in range(count)]
        self._ticks = 0
        self._path = _path(model, self._channels)
        self._ahead: Ahead | None = None
        self._memory: Array | None = None

    def planned(self, motion: Motion) -> Array | None:
        """None: what is measured counts. What the frozen model says of the plan is asked once, here."""
        states = self.model.inputs.states(motion)
        frozen = self.model.mean(states) if self._frozen is None else self._frozen.planned(motion)
        self._ahead = None
        if frozen is not None:
            base = np.column_stack([command.base(states) for command in self.commands])
            self._ahead = Ahead(motion.t, self.model.inputs.of_log(states), base, frozen)
        return None

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The command (J,) for the planned row of time t in s, within its limits, and its deviation (J,)."""
        x, base, frozen = self._instant(t, row)
        out = frozen.copy()
        for own, weight in zip(self.commands, self.weights(), strict=True):
            if weight > 0.0:
                updated = base[own.place] + own.factor * own.learner.mean(x)
                if np.isfinite(updated):  # a learner that has lost its numbers never drives
                    out[own.place] += weight * (updated - frozen[own.place])
        noise = np.array([own.factor * own.guard.noise for own in self.commands])
        return np.clip(out, *self._limits), noise

    def observe(self, t: float, row: Row) -> None:
        """One control tick's measurement: time in s, and the measured channels with the applied command."""
        if self._window is None:
            self._window = self._begin(row)
        self._window.push(t, row)
        self.counts.ignored = self._window.ignored
        place = self._ticks % self._stride
        self._ticks += 1
        if place == 0:
            sample = self._window.middle()
            if sample is not None:
                self._judge(*sample)
        for own, turn in zip(self.commands, self._turn, strict=True):
            if turn == place:
                self._teach(own, t)

    def weights(self) -> list[float]:
        """What part of each command comes from its learner."""
        return [own.guard.weight if self.config.guarded else 1.0 for own in self.commands]

    def _instant(self, t: float, row: Row) -> tuple[Array, Array, Array]:
        """Inputs (D,), mean function and frozen command (J,) of a planned instant."""
        ahead = self._ahead
        if ahead is not None:
            # before the plan begins its first row holds, as in every run
            k = int(np.clip(np.searchsorted(ahead.t, t - 0.5 / self._rate), 0, len(ahead.t) - 1))
            return ahead.X[k], ahead.base[k], ahead.frozen[k]
        x, self._memory = self.model.inputs.step(row, self._memory)
        states = self._states(t, row)
        base = np.array([own.base(states)[0] for own in self.commands])
        frozen = self.model.mean(states)[0] if self._frozen is None else self._frozen.command(t, row)[0]
        return x, base, frozen

    def _begin(self, row: Row) -> CentredWindow:
        measured = [name for name in row if name in self._channels]
        inputs = [channel for channel, *_ in self.model.inputs.columns]
        more = [name for name in measured if self._channels[name].role == "state"]  # physics may look at them
        found = sources(list(dict.fromkeys([*inputs, COMMAND, *more])), measured, self._channels)
        sizes = {name: len(np.atleast_1d(row[name])) for name in measured}
        return CentredWindow(found, sizes, self._rate, self.config.window_s)

    def _judge(self, t: float, row: Mapping[str, Array]) -> None:
        x, _ = self.model.inputs.step(row, None)
        states, moving = self._states(t, row), self._moving(t, row)
        self.counts.still += ~moving
        for j in np.flatnonzero(moving).tolist():
            own = self.commands[j]
            own.judge(t, x, float(row[COMMAND][j]), float(own.base(states)[0]))

    def _moving(self, t: float, row: Mapping[str, Array]) -> NDArray[np.bool_]:
        """(J,) whether a sample says something of each command; half the weight of a planned one tells."""
        if not self._path:
            return np.ones(len(self.commands), dtype=np.bool_)
        motion = Motion(np.array([t]), np.stack([row[name][None] for name in self._path]))
        return np.asarray(self.model.inputs.plan(motion).gains[0] ** 2 >= 0.5)

    def _states(self, t: float, row: Mapping[str, Array]) -> Log:
        known = {name: np.atleast_2d(values) for name, values in row.items() if name in self._channels}
        return Log(np.array([t]), {name: self._channels[name] for name in known}, known)

    def _teach(self, own: Command, now: float) -> None:
        """The command learns its oldest waiting sample, if that has waited long enough."""
        taken = own.learned(now - self.config.hold_s - 0.5 * self.config.window_s)
        if taken is not None:
            counts = self.counts.learned if taken else self.counts.refused
            counts[own.place] += 1


def _path(model: LearnedModel, channels: Mapping[str, Channel]) -> list[str]:
    """The inputs that are the path and its rates, as many as plans have; none if it looks elsewhere."""
    names = list(dict.fromkeys(channel for channel, *_ in model.inputs.columns))[: model.inputs.orders]
    follows = [channels[rate].derivative_of == name for name, rate in pairwise(names)]
    return names if len(names) == model.inputs.orders and all(follows) else []
