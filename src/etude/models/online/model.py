"""A learned model that goes on learning while the robot runs: a controller over rows of channels."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from etude.contracts import Array, Candidate, Channel, Controller, Log, Motion, Row
from etude.errors import EtudeError, UsageError
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.single_point import PointMean
from etude.models.model import LearnedModel
from etude.models.online.guard import Guard
from etude.models.online.learner import OnlineConfig, OnlineOutput
from etude.models.online.methods import begin
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


@dataclass(eq=False)
class Command:
    """One command that goes on learning, in the units of its process.

    Attributes:
        place: of the command. candidate: the rung that it comes from. offset, factor: from its process's
            units to the command's. frozen: its process as it was trained.
    """

    place: int
    candidate: Candidate
    offset: float
    factor: float
    frozen: PointMean
    learner: OnlineOutput
    guard: Guard
    waiting: deque[tuple[float, Array, float]] = field(default_factory=deque)


@dataclass(frozen=True, eq=False)
class Ahead:
    """A plan asked for ahead of the run: times (T,), inputs (T, D), mean and frozen command (T, J)."""

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
        frozen: the controller of the model as it was trained, which drives where the learners have no weight.
        limit: (J,) how far each command reaches.
        config: how to go on.
        rate: of the control ticks, Hz.
        rng: of what the learners draw.

    Raises:
        UsageError: a command has no such process.
    """

    def __init__(
        self,
        model: LearnedModel,
        channels: Sequence[Channel],
        frozen: Controller,
        limit: Array,
        config: OnlineConfig,
        rate: float,
        rng: np.random.Generator,
    ) -> None:
        self.model, self.config, self._frozen, self._limit = model, config, frozen, limit
        self._channels = {channel.name: channel for channel in channels}
        memory, count = config.memory_s * config.rate_hz, len(model.commands)
        self.commands = [_command(model, j, config, memory, rng) for j in range(count)]
        learned, still, refused = np.zeros((3, count), dtype=np.int64)
        self.counts = Counts(learned, still, refused)
        self._rate = rate
        self._window: CentredWindow | None = None
        self._stride = max(1, round(rate / config.rate_hz))
        self._turn = [j * self._stride // count for j in range(count)]
        self._ticks = 0
        self._ahead: Ahead | None = None
        self._memory: Array | None = None

    def planned(self, motion: Motion) -> Array | None:
        """None: what is measured counts. What the frozen model says of the plan is asked once, here."""
        states, frozen = self.model.inputs.states(motion), self._frozen.planned(motion)
        self._ahead = None
        if frozen is not None:
            base = np.column_stack([self._base(command, states) for command in self.commands])
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
        return np.clip(out, -self._limit, self._limit), noise

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
        base = np.array([self._base(own, states)[0] for own in self.commands])
        return x, base, self._frozen.command(t, row)[0]

    def _begin(self, row: Row) -> CentredWindow:
        wanted = dict.fromkeys([*(channel for channel, *_ in self.model.inputs.columns), COMMAND])
        measured = [name for name in row if name in self._channels]
        found = sources(list(wanted), measured, self._channels)
        sizes = {name: len(np.atleast_1d(row[name])) for name in measured}
        return CentredWindow(found, sizes, self._rate, self.config.window_s)

    def _judge(self, t: float, row: Mapping[str, Array]) -> None:
        x, _ = self.model.inputs.step(row, None)
        states = self._states(t, row)
        moving = self._moving(t, row)
        for own in self.commands:
            if not moving[own.place]:
                self.counts.still[own.place] += 1
                continue
            y = float((row[COMMAND][own.place] - self._base(own, states)[0]) / own.factor)
            own.guard.judge(y - float(own.frozen(x)[0]), y - own.learner.mean(x))
            own.waiting.append((t, x, y))

    def _moving(self, t: float, row: Mapping[str, Array]) -> NDArray[np.bool_]:
        """(J,) whether a sample says something of each command; half the weight of a planned one tells."""
        inputs = self.model.inputs
        names = list(dict.fromkeys(channel for channel, *_ in inputs.columns))[: inputs.orders]
        shapes = {row[name].shape for name in names}
        if len(names) < inputs.orders or len(shapes) > 1:
            return np.ones(len(self.commands), dtype=np.bool_)
        motion = Motion(np.array([t]), np.stack([row[name][None] for name in names]))
        return np.asarray(inputs.plan(motion).gains[0] ** 2 >= 0.5)

    def _states(self, t: float, row: Mapping[str, Array]) -> Log:
        known = {name: np.atleast_2d(values) for name, values in row.items() if name in self._channels}
        return Log(np.array([t]), {name: self._channels[name] for name in known}, known)

    def _base(self, own: Command, states: Log) -> Array:
        """(n,) mean function of one command, offset included, in its unit."""
        mean = own.candidate.mean
        part = np.zeros(len(states)) if mean is None else mean.predict(states)[:, own.place]
        return np.asarray(part + own.offset)

    def _teach(self, own: Command, now: float) -> None:
        """The command learns its oldest waiting sample, if that has waited long enough."""
        due = now - self.config.hold_s - 0.5 * self.config.window_s
        if not own.waiting or own.waiting[0][0] > due:
            return
        t, x, y = own.waiting.popleft()
        try:
            own.learner.observe(x, y, t)
        except EtudeError:  # the learner is as it was
            self.counts.refused[own.place] += 1
            return
        self.counts.learned[own.place] += 1


def _command(
    model: LearnedModel, j: int, config: OnlineConfig, memory: float, rng: np.random.Generator
) -> Command:
    chosen = model.chosen[j]
    for rung in (chosen, f"{chosen}+gp"):
        for candidate in model.candidates:
            if candidate.rung != rung or j not in candidate.commands:
                continue
            place = candidate.commands.index(j)
            own = getattr(candidate.process, "own", None)
            posterior = own[place] if isinstance(own, tuple) else None
            if isinstance(posterior, ExactPosterior):
                learner = begin(posterior, config, rng)
                offset, factor = candidate.units[:, place]
                noise = posterior.noise_variance
                return Command(
                    j,
                    candidate,
                    float(offset),
                    float(factor),
                    PointMean([posterior]),
                    learner,
                    Guard(memory, noise),
                )
    raise UsageError(
        f"command {model.commands[j]} comes from the rung {chosen!r}, which cannot go on learning",
        next_step="Train rung = 'gp' or 'identified+gp' with process = 'exact' or a dictionary.",
    )


def going_on(model: object) -> LearnedModel:
    """The model, if it is one that ladders train. UsageError otherwise."""
    if not isinstance(model, LearnedModel):
        raise UsageError(
            f"a {type(model).__name__} cannot go on learning", next_step="Train one by a ladder."
        )
    return model
