"""Online model: a controller over rows of channels that learns while the robot runs.

A channel of another length is a mistake of the calling program, not a fault of a wire. It is refused with a
message: arithmetic would raise, spread one number over all joints, or hold the last command for ever.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError, UsageError
from etude.models.learned_model import LearnedModel
from etude.protocols import Controller
from etude.types import Array, Channel, Motion, Row
from etude_online.command import FAILURES, Command, learning_command
from etude_online.guard import Guard
from etude_online.guard_effort import FED_BACK, Feedback, FeedbackLaw
from etude_online.guard_gate import Ranges
from etude_online.learner import OnlineConfig
from etude_online.learner_state import put_back, taken
from etude_online.memoized_mean import with_memoized_means
from etude_online.planned_samples import Planned
from etude_online.row_samples import COMMAND, Measured

REPORTS = 200
"""Sentences that are kept."""
JUDGED = "The guard of online learning uses it."
PLANNED = "The model uses it; `planned_row` of a deployed folder makes complete rows."
CLEAN_S, YOUNG_S = 0.1, 0.2
"""After a suspicion: what the window has to hold beyond its length, and how much older a sample must be."""


@dataclass
class Counts:
    """What became of the measurements: per command (J,), but for the last three.

    Attributes:
        learned: samples. still: samples of a joint that stood still. refused: samples that the learner
            raised an error on. set_back: times that a learner went back.
        ignored: measurements that cannot be true. rebased: times that the clock jumped or stood still.
        suspected: decisions that contradicted, after which nothing is learned for a window's length.
    """

    STATE_FIELDS: ClassVar[tuple[str, ...]] = (
        *("learned", "still", "refused", "set_back"),
        *("ignored", "rebased", "suspected"),
    )

    learned: NDArray[np.int64]
    still: NDArray[np.int64]
    refused: NDArray[np.int64]
    set_back: NDArray[np.int64]
    ignored: int = 0
    rebased: int = 0
    suspected: int = 0


class Rows:
    """What rows hold.

    Args:
        channels: of the kind, by name. commands: names of the model's, of which `command_fb` has one each.
    """

    def __init__(self, channels: Mapping[str, Channel], commands: Sequence[str]) -> None:
        units = next((c.units for c in channels.values() if c.role == "command"), ())
        fed_back = {FED_BACK: (tuple(commands), units)}
        self._layouts = fed_back | {name: (c.parts, c.units) for name, c in channels.items()}

    def taken(self, row: Row, what: str) -> dict[str, Array]:
        """The row as arrays (parts,); unknown channels stay as they are.

        Args:
            what: names the row in words, "planned" or "measured".

        Raises:
            UsageError: a channel has another number of parts than the robot's, or is no numbers.
        """
        arrays = dict(row)
        for name in arrays.keys() & self._layouts.keys():
            arrays[name] = self._numbers(name, arrays[name], what)
        return arrays

    def require(self, row: Row, names: Sequence[str], what: str, why: str) -> None:
        """UsageError: the row lacks one of those names; why: a sentence on its purpose."""
        missing = [name for name in dict.fromkeys(names) if name not in row]
        if missing:
            each = "; ".join(f"{name}: {self._expected(name)}" for name in missing)
            raise UsageError(
                f"the {what} row lacks {', '.join(missing)}", next_step=f"Put in every row {each}. {why}"
            )

    def _numbers(self, name: str, values: Array, what: str) -> Array:
        try:
            numbers = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise UsageError(
                f"{name} of the {what} row holds no numbers", next_step=f"Give {self._expected(name)}."
            ) from None
        count = len(self._layouts[name][0])
        if numbers.shape == (count,):
            return numbers
        if numbers.shape == () and count == 1:
            return numbers[None]
        size = {0: "is a single number", 1: f"has length {numbers.size}"}.get(
            numbers.ndim, f"is {numbers.shape}"
        )
        raise UsageError(
            f"{name} of the {what} row {size}, not {count}",
            next_step=f"Give {self._expected(name)}.",
        )

    def _expected(self, name: str) -> str:
        """As "4 numbers in rad (waist, shoulder, elbow, wrist)"."""
        if name not in self._layouts:
            return "an array of its parts"
        parts, units = self._layouts[name]
        of = " and ".join(dict.fromkeys(units))
        number = "1 number" if len(parts) == 1 else f"{len(parts)} numbers"
        return f"{number}{f' in {of}' if of else ''} ({', '.join(parts)})"


class OnlineModel:
    """One learner for each command of a model, behind a guard (implements `protocols.Controller`).

    Mutable; for one thread. `observe` takes rows of measured channels, tick by tick; `command` mixes the
    updated model into the frozen one. A sample is taken every 1/rate_hz from the middle of the window,
    skipped where a joint stands still, scored, and learned `hold_s` later. The commands learn in different
    ticks, so that no tick pays for all of them. Whatever is measured, nothing but UsageError leaves either.

    Args:
        model: its commands come from exact processes or dictionaries, or have such ones beside physics.
        channels: of the kind; a wanted one that is not measured is had as the rate of one that is.
        frozen: the controller of the model as it was trained, which drives where the learners have no weight;
            None: the model's own mean.
        limits: lower and upper (J,) of the commands.
        config: how to go on.
        rate: of the control ticks, Hz.
        rng: of what the learners draw.
        feedback: what the robot's feedback adds, for the guard (`guard_effort.feedback_of`); None where
            nothing is driven: then past samples alone set the learners' weights.

    Attributes:
        counts: of measurements. reports: (s of its own clock, sentence) of each reaction, the newest last.

    Raises:
        UsageError: a command has no such process, or limits of another robot.
    """

    STATE_FIELDS = ("commands", "counts", "guard", "_plan", "_measured", "_held", "_ticks", "_suspected")

    def __init__(
        self,
        model: LearnedModel,
        channels: Sequence[Channel],
        frozen: Controller | None,
        limits: tuple[Array, Array],
        config: OnlineConfig,
        rate: float,
        rng: np.random.Generator,
        feedback: Feedback | None = None,
    ) -> None:
        count = len(model.commands)
        if any(np.shape(limit) != (count,) for limit in limits):
            raise UsageError(f"the model has {count} commands, the limits are {limits}")
        model = with_memoized_means(model)
        self.model, self.config, self._limits = model, config, limits
        self.commands = [learning_command(model, j, config, rng) for j in range(count)]
        self.counts = Counts(*np.zeros((4, count), dtype=np.int64))
        self.reports: deque[tuple[float, str]] = deque(maxlen=REPORTS)
        by_name = {channel.name: channel for channel in channels}
        self._rows = Rows(by_name, model.commands)
        self._plan = Planned(model, by_name, frozen, self.commands, rate)
        self._noise = np.array([abs(command.factor) * command.evidence.noise for command in self.commands])
        self.guard = self._guarded(feedback, rate)
        self._measured = self._measuring(by_name, feedback, rate)
        self._held = np.zeros(count)
        self._stride = max(1, round(rate / config.rate_hz))
        self._turn = [j * self._stride // count for j in range(count)]
        self._ticks, self._suspected = 0, -math.inf

    def planned(self, motion: Motion) -> Array | None:
        """None: what is measured counts. The frozen model is evaluated on the plan once, here."""
        self._plan.take(motion)
        self._measured.reopened()  # a run begins, whose times may be anything
        return None

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        """The command (J,) for the planned row of time t in s, within its limits, and its deviation (J,).

        For a plan that is not finite the last command is held; its deviation is infinite. UsageError: the row
        lacks a channel that the model looks at, or one has another number of parts.
        """
        with np.errstate(all="ignore"):
            instant = self._finite_instant(t, row)
            if instant is None:
                return self._held.copy(), np.full(len(self._held), np.inf)
            x, base, frozen = instant
            share = self._learner_weights()
            raw = self._raw(x, base, frozen, share)
            if self.guard is None:
                out = np.clip(frozen + np.where(np.isfinite(raw), share * raw, 0.0), *self._limits)
            else:
                out = self.guard.play(frozen, raw, share)
        self._held = out
        return out.copy(), self._noise.copy()

    def observe(self, t: float, row: Row) -> None:
        """One control tick's measurement: time in s, and the measured channels with the applied command.

        UsageError: the first row lacks a channel that the guard needs, or one has another number of parts.
        """
        row = self._rows.taken(row, "measured")
        if self.guard is not None and self._ticks == 0:
            self._rows.require(row, self.guard.judges_by, "measured", JUDGED)
        with np.errstate(all="ignore"):
            accepted = self._measured.take(t, row)
            self.counts.ignored, self.counts.rebased = self._measured.counts
            if self.guard is not None:
                self._guard_tick(self.guard, row if accepted else None)
            place = self._ticks % self._stride
            self._ticks += 1
            now = self._measured.now
            if place == 0 and now >= self._suspected:
                self._score_middle()
            for command, turn in zip(self.commands, self._turn, strict=True):
                if turn == place:
                    self._teach(command, now)

    def weights(self) -> list[float]:
        """What part of each command comes from its learner."""
        weight = 1.0 if self.guard is None else self.guard.weight
        return list((weight * self._learner_weights()).tolist())

    def state(self) -> Any:
        """All that it has learned and remembers, as numbers; `restore` makes an equal model this one."""
        return [[list(item) for item in self._measured.sizes.items()], taken(self)]

    def restore(self, state: Any) -> None:
        """Goes on from `state`, as if it had never stopped. DataError: one of another model."""
        try:
            sizes, numbers = state
            if sizes:
                self._measured.begin(dict(sizes))
            put_back(self, numbers)
            self._measured.reopened()
        except (ValueError, TypeError, AttributeError, KeyError, UsageError) as error:
            raise DataError(
                f"the saved state is of another model ({error})", next_step="Open without it."
            ) from error

    def _guarded(self, feedback: Feedback | None, rate: float) -> Guard | None:
        if feedback is None or not self.config.guarded:
            return None
        return Guard(feedback, self._limits, self._noise, self.model.commands, rate, self._say)

    def _measuring(self, by_name: Mapping[str, Channel], feedback: Feedback | None, rate: float) -> Measured:
        first = self._plan.path[0] if self._plan.path else ""
        sigma = None if feedback is None else feedback.sigma
        path = feedback.path if isinstance(feedback, FeedbackLaw) else first
        ranges = Ranges(by_name, self._limits, sigma, path, 1.0 / rate)
        inputs = [channel for channel, *_ in self.model.inputs.columns]
        also = () if self.guard is None or feedback is None else feedback.channels
        return Measured(inputs, by_name, ranges, also, rate, self.config.window_s, self._say)

    def _learner_weights(self) -> Array:
        """(J,) how much of each learner its past samples support."""
        if not self.config.guarded:
            return np.ones(len(self.commands))
        return np.array([command.evidence.weight for command in self.commands])

    def _raw(self, x: Array, base: Array, frozen: Array, share: Array) -> Array:
        """(J,) what the learners would add to the frozen command; zero where nobody needs to know."""
        raw = np.zeros(len(frozen))
        if self.guard is not None and not self.guard.asks:
            return raw
        for command in self.commands:
            if share[command.place] > 0.0 or self.guard is not None:
                raw[command.place] = (
                    base[command.place] + command.factor * command.mean(x) - frozen[command.place]
                )
        return raw

    def _finite_instant(self, t: float, row: Row) -> tuple[Array, Array, Array] | None:
        if not self._plan.ahead:
            row = self._rows.taken(row, "planned")
        try:
            instant = self._plan.instant(t, row)
            if np.isfinite(instant[2]).all():
                return instant
        except KeyError:
            inputs = [channel for channel, *_ in self.model.inputs.columns]
            self._rows.require(row, inputs, "planned", PLANNED)
            raise
        except (DataError, *FAILURES):
            pass
        self._measured.odd("The planned row or its command is not finite: the last command is held")
        return None

    def _say(self, sentence: str) -> None:
        self.reports.append((self._measured.now, sentence))

    def _guard_tick(self, guard: Guard, row: Row | None) -> None:
        if self._measured.paused:
            guard.skip()
        guard.collect(row)
        if not guard.due:
            return
        accepted, back = guard.decide()
        now = self._measured.now
        if not accepted:
            self.counts.suspected += 1
            self._suspected = now + self.config.window_s + CLEAN_S
        for command in self.commands:
            if not accepted:
                command.drop(now - 0.5 * self.config.window_s - YOUNG_S)
            elif now >= self._suspected:
                command.checkpoints.keep(now)
            if back[command.place]:
                self._set_back(command, now, "is wrong by far")

    def _set_back(self, command: Command, now: float, why: str) -> None:
        if not command.learner.samples:  # it is at its beginning, the trained model
            return
        self.counts.set_back[command.place] += 1
        anew = command.set_back(now)
        name = self.model.commands[command.place]
        self._say(
            f"The learned part of {name} {why}: it {'starts again' if anew else 'goes back some seconds'}."
        )

    def _score_middle(self) -> None:
        sample = self._measured.middle()
        if sample is None:
            return
        t, row = sample
        try:
            x, _ = self.model.inputs.step(row, None)
            states, moving = self._plan.states(t, row), self._plan.moving(t, row)
            base = [command.base(states)[0] for command in self.commands]
        except (DataError, *FAILURES):  # numbers in their ranges that make no sense together
            self.counts.refused += 1
            return
        self.counts.still += ~moving
        for j in np.flatnonzero(moving).tolist():
            self.commands[j].judge(t, x, float(row[COMMAND][j]), float(base[j]))

    def _teach(self, command: Command, now: float) -> None:
        """The command learns its oldest waiting sample, if that has waited long enough."""
        try:
            taken_in = command.learned(now - self.config.hold_s - 0.5 * self.config.window_s)
        except FAILURES:
            self._set_back(command, now, "is not finite")
            return
        if taken_in is not None:
            counts = self.counts.learned if taken_in else self.counts.refused
            counts[command.place] += 1
