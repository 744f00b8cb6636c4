"""Guard of online learning: which measurements the model learns from, and its share in the command.

Two walls, each of which holds nearly alone. The gate compares the measured command with what was sent and
what the feedback added. The hedge scores the learners by the feedback's effort, which no sensor of the
command can falsify. For both the guard has to know the feedback.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from etude.types import Array, Mask, Row
from etude_online.guard_effort import COMMAND, FEWEST, Feedback, decision_ticks
from etude_online.guard_gate import Gate

SLEW = 5.0
"""1/s: how fast a weight may change, so that no command steps."""
REST_S = 3.0
"""A learner that was set back is left alone for this long."""


AUTHORITY = 2.0
"""C: the updated model moves a command by so many times the frozen model's own error at most."""
SLOW_S, FAST_S, FASTER = 20.0, 2.0, 2.0
"""Seconds over which the frozen model's error is averaged; the fast average counts twice."""
ETA, LEAST, MOST = 0.5, -4.0, 4.0
"""Step and ends of L, the logarithm of the odds for the updated model."""
SPIKE = 36.0
"""One decision counts as so many mean squares at most."""
FAR, FURTHEST, TRIP = 2.5, 4.0, 20.0
"""A learner wrong by FAR times the frozen error gathers what trips at TRIP, FURTHEST a decision at most."""


class Hedge:
    """Weights of the updated model for J commands, one decision after another.

    With the frozen model's error e, the offered correction d, |d| <= A, and w = 1/(1 + exp(-L)):

        delta = (|e| - |e - d|) / A in [-1, 1],   L <- clip(L + log(1 + delta/2), -4, 4).

    For any corrections whatever, sum over N decisions of (|e - w d| - |e|) / A <= 8 + 0.018 N: phi = log(1 +
    exp(L)) grows by log(1 + w delta/2) <= w delta/2 a decision, spans 4 between the ends of L, and the lower
    end gives it 0.009 a decision at most; |e - w d| is convex in w. (Multiplicative weights; Cesa-Bianchi
    and Lugosi 2006, chapter 2.)

    Args:
        noise: (J,) deviation of the commands' noise: the least error that the authority is made of.
        period: s between two decisions.
    """

    STATE_FIELDS = ("L", "slow2", "fast2", "far", "_decisions", "authority")

    def __init__(self, noise: Array, period: float) -> None:
        # a model without noise would make every error infinitely large
        self._least = np.maximum(noise, 1e-12) ** 2
        self._slow, self._fast = period / SLOW_S, period / FAST_S
        self.L = np.full(len(noise), LEAST)
        self.slow2, self.fast2 = self._least.copy(), self._least.copy()
        self.far = np.zeros(len(noise))
        self._decisions = 0
        self.authority = self._authority()

    @property
    def weight(self) -> Array:
        """(J,) in (0, 1)."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.L)))

    def decide(self, error: Array, offered: Array, raw: Array, *, clean: bool = True) -> Array:
        """Takes in one decision; returns delta (J,).

        Args:
            error: (J,) what the frozen model alone would have left to the feedback.
            offered: (J,) correction within the authority; raw: (J,) as the learner predicts it.
            clean: whether the measurements are accepted. If not, weights can only fall.
        """
        delta = (np.abs(error) - np.abs(error - offered)) / self.authority
        delta = np.clip(np.nan_to_num(delta, nan=-1.0), -1.0, 1.0)
        if not clean:
            delta = np.minimum(delta, 0.0)
        self.L = np.clip(self.L + np.log1p(ETA * delta), LEAST, MOST)
        if clean:
            self._gather(error, raw)
        return np.asarray(delta)

    def distrust(self, which: Mask) -> None:
        """Starts again from nothing: their learners are others now."""
        self.L[which], self.far[which] = LEAST, 0.0

    def _gather(self, error: Array, raw: Array) -> None:
        self._decisions += 1
        square = np.minimum(error**2, SPIKE * self.slow2)
        self.slow2 += max(self._slow, 1.0 / self._decisions) * (square - self.slow2)
        self.fast2 += max(self._fast, 1.0 / self._decisions) * (square - self.fast2)
        self.slow2, self.fast2 = (np.maximum(s, self._least) for s in (self.slow2, self.fast2))
        wrong = np.abs(error - raw) / np.maximum(np.sqrt(self.slow2), np.abs(error))
        step = np.nan_to_num(np.minimum(wrong - FAR, FURTHEST), nan=FURTHEST)
        self.far = np.maximum(0.0, self.far + step)
        self.authority = self._authority()

    def _authority(self) -> Array:
        return np.asarray(AUTHORITY * np.sqrt(np.minimum(self.slow2, FASTER**2 * self.fast2)))


class Guard:
    """Weights for J commands, and what was sent, decision by decision.

    Args:
        feedback: of the robot. limits: lower and upper (J,). noise: (J,) deviation of the commands.
        names: of the commands. rate: of the ticks, Hz.
        say: receives one sentence for each reaction.

    Attributes:
        weight: (J,) in [0, 1] that drives now. lost: (J,) learners without finite numbers.
    """

    STATE_FIELDS = (
        "hedge",
        "gate",
        "weight",
        "lost",
        *("_goal", "_tick", "_rows", "_pending", "_middle", "_pause_left"),
    )

    def __init__(
        self,
        feedback: Feedback,
        limits: tuple[Array, Array],
        noise: Array,
        names: Sequence[str],
        rate: float,
        say: Callable[[str], None],
    ) -> None:
        self.feedback, self._limits, self._names, self._say = feedback, limits, names, say
        self._ticks, self._period = decision_ticks(rate), 1.0 / rate
        self.hedge = Hedge(noise, self._ticks * self._period)
        self.gate = Gate(feedback.sigma, limits, self._ticks * self._period)
        self.weight, self._goal = np.zeros(len(noise)), np.zeros(len(noise))
        self.lost = np.zeros(len(noise), dtype=np.bool_)
        self._pause_left = np.zeros(len(noise))
        self._tick = 0
        self._rows: list[list[Array]] = []
        self._pending: list[Array] = []
        self._middle: list[Array] = []

    @property
    def asks(self) -> bool:
        """Whether the learners have to be asked in this tick, though they may have no weight."""
        return bool(self._tick == self._ticks // 2 or self.weight.any() or self._goal.any())

    def play(self, frozen: Array, raw: Array, share: Array) -> Array:
        """The command (J,) to send: never further from the frozen one than the authority, or the limits.

        Args:
            frozen: (J,) of the trained model. raw: (J,) correction that the learners ask for.
            share: (J,) in [0, 1], how much of it past samples support.
        """
        step = SLEW * self._period
        self.weight = self.weight + np.clip(self._goal - self.weight, -step, step)
        most = self.hedge.authority
        offered = np.clip(np.nan_to_num(share * raw, nan=0.0), -most, most)
        self.lost |= ~np.isfinite(raw)
        sent = np.clip(frozen + self.weight * offered, *self._limits)
        self._pending = [frozen, offered, raw, sent]
        if self._tick == self._ticks // 2:
            self._middle = self._pending
        return np.asarray(sent)

    @property
    def judges_by(self) -> tuple[str, ...]:
        """Channels that measured rows have to hold."""
        return (*self.feedback.channels, COMMAND)

    def collect(self, row: Row | None) -> None:
        """One tick's measurement; None where it was rejected. Call `decide` after it where `due`."""
        if row is not None and self._pending:
            self._rows.append([*(np.array(row[n], dtype=float) for n in self.judges_by), self._pending[3]])
        self._pending = []
        self._tick += 1

    @property
    def due(self) -> bool:
        """Whether a decision is complete."""
        return self._tick >= self._ticks

    def skip(self) -> None:
        """The ticks so far are no decision: there was a gap in them."""
        self._tick, self._rows, self._middle = 0, [], []

    def decide(self) -> tuple[bool, Mask]:
        """Evaluates the complete decision: whether it is accepted, and which learners (J,) are reset."""
        rows, middle = self._rows, self._middle
        self.skip()
        self._pause_left = self._pause_left - self._ticks * self._period
        none = np.zeros(len(self.weight), dtype=np.bool_)
        if not middle:  # nothing was sent, so there is nothing to evaluate
            return True, none
        if len(rows) < FEWEST:
            self._strike(True, "measurements are missing or impossible")
            return False, self._reset_learners(none)
        *feedback_values, measured, sent = (np.stack(part) for part in zip(*rows, strict=True))
        named: Mapping[str, Array] = dict(zip(self.feedback.channels, feedback_values, strict=True))
        fed_back = self.feedback.effort(named, self._period)
        off = self.gate.contradicted(measured, sent, fed_back)
        self._strike(bool(off.any()), self._contradiction(off))
        frozen, offered, raw, played = middle
        if not self.gate.faded:
            error = played + fed_back.mean(axis=0) - frozen
            self.hedge.decide(error, offered, raw, clean=not off.any())
        self._goal = np.zeros(len(none)) if self.gate.faded else self.hedge.weight
        return not off.any(), self._reset_learners(self.hedge.far > TRIP)

    def _strike(self, bad: bool, why: str) -> None:
        turned = self.gate.take(bad)
        if turned:
            self._goal = np.zeros(len(self.weight))
            self._say(f"The trained model is used alone and nothing is learned: {why}.")
        elif turned is False:
            self._say("Measurements have agreed for a second: learning continues.")

    def _contradiction(self, off: Mask) -> str:
        which = ", ".join(name for name, bad in zip(self._names, off, strict=True) if bad)
        return f"the measured command of {which} differs from the sum of feedforward and feedback"

    def _reset_learners(self, far: Mask) -> Mask:
        """Learners that are wrong by far, or lost, and were not set back just now."""
        reset = np.asarray((far | self.lost) & (self._pause_left <= 0.0))
        self.hedge.distrust(reset)
        self._pause_left = np.where(reset, REST_S, self._pause_left)
        self._goal = np.where(reset, 0.0, self._goal)
        self.lost = self.lost & ~reset
        return reset
