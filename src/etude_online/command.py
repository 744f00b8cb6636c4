"""Online learner of one command: structure, evaluation, checkpoints, and samples that still wait."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from etude.errors import DataError, NumericalError, UsageError
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.single_point import PointMean
from etude.models.learned_model import LearnedModel
from etude.models.process import Posteriors
from etude.models.process_abilities import SupportsPoint, SupportsSeparate
from etude.protocols import Candidate
from etude.types import Array, Log
from etude_online.learner import OnlineConfig, OnlineOutput
from etude_online.learner_state import put_back, taken
from etude_online.methods import begin

FAILURES = (ArithmeticError, NumericalError, np.linalg.LinAlgError, ValueError, IndexError)
"""What arithmetic on numbers that make no sense may end in."""
FIRST_S, STAGGER_S = 5.0, 0.2
"""When a learner's first checkpoint is kept, and how much later that of the next command."""


EVERY_S = 10.0
"""Between two checkpoints. One goes back to the older of two: the newest may hold the first bad samples."""
AGAIN_S = 30.0
"""A learner that has to go back again within this time begins anew."""


class Checkpoints:
    """States of one learner: its first, and two on the way.

    Args:
        learner: at its beginning.
        first: s after which the first one is kept, so that not all learners are copied in one tick.
    """

    STATE_FIELDS = ("_states", "_due", "_back")

    def __init__(self, learner: OnlineOutput, first: float) -> None:
        self._learner = learner
        self._begin: Any = taken(learner)
        self._states: list[Any] = []
        self._due: float | None = None
        self._first, self._back = first, -float("inf")

    def keep(self, now: float) -> None:
        """Keeps the learner as it is, if it is time."""
        if self._due is None:
            self._due = now + self._first
        if now >= self._due:
            self._states, self._due = [*self._states[-1:], taken(self._learner)], now + EVERY_S

    def back(self, now: float) -> bool:
        """Sets the learner back; returns whether it begins anew."""
        anew = now - self._back < AGAIN_S or not self._states
        put_back(self._learner, self._begin if anew else self._states[0])
        self._states, self._due, self._back = [], now + EVERY_S, now
        return anew


NEEDED = 10.0
"""Squared noise deviations by which both models must have differed in sum before evidence outweighs doubt."""
LARGEST_ERROR = 1e50
"""An error beyond it is no number to reckon with: its square is none."""


class UpdateWeight:
    """The weight of an updated model beside the frozen one it started from.

    With errors e_f and e_u of both on a sample before it is learned, the combination f + w (u - f) has the
    error e_f - w (e_f - e_u). The w in [0, 1] of least squared error over the remembered samples, drawn
    towards 0 until the models have differed by more than noise, is

        w* = Σ e_f (e_f - e_u) / (Σ (e_f - e_u)² + NEEDED sn²).

    It is above 1/2 where the updated model by itself errs less than the frozen one. The weight is the smooth
    step w*² (3 - 2 w*), nearer to 0 for the worse model and nearer to 1 for the better one. Without it, a
    model that is far off would serve, with a tiny weight, as an estimate of the other's bias. On the
    remembered samples either of the two errs no more than the frozen model.

    An updated model that gets no weight goes on learning and may come back.

    Args:
        memory: samples after which a comparison counts 1/e.
        noise_variance: sn² of the output.

    Attributes:
        weight: in [0, 1], after the last comparison. noise: sn of the output.
    """

    STATE_FIELDS = ("_along", "_apart", "weight")

    def __init__(self, memory: float, noise_variance: float) -> None:
        self._keep = math.exp(-1.0 / memory)
        self.noise = math.sqrt(noise_variance)
        self._doubt = NEEDED * noise_variance
        self._along, self._apart = 0.0, 0.0
        self.weight = 0.0

    def forget(self) -> None:
        """As at the beginning: the updated model is another one now."""
        self._along = self._apart = self.weight = 0.0

    def judge(self, frozen_error: float, updated_error: float) -> None:
        """Take in one sample; one with an error that is not finite counts fully against the updated model."""
        if not abs(frozen_error) < LARGEST_ERROR:
            return
        if abs(updated_error) < LARGEST_ERROR:
            gap = frozen_error - updated_error
            self._along = self._keep * self._along + frozen_error * gap
            self._apart = self._keep * self._apart + gap * gap
        else:
            self._along = min(self._along, 0.0)
        self.weight = self._step()

    def _step(self) -> float:
        below = self._apart + self._doubt
        best = min(max(self._along / below, 0.0), 1.0) if below > 0.0 else 0.0
        return best * best * (3.0 - 2.0 * best)


@dataclass(eq=False)
class Command:
    """One command of a model, its learner in the units of a process.

    Attributes:
        place: of the command in the model. candidate: the structure whose process goes on learning.
        offset, factor: from the process's units to the command's.
        frozen: (D,) -> what the model as it was trained says, in the process's units and beside `base`.
        learner, evidence: of the command. checkpoints: of the learner.
        waiting: samples that were judged and not learned yet: time, input, output.
    """

    STATE_FIELDS: ClassVar[tuple[str, ...]] = ("learner", "evidence", "checkpoints", "waiting")

    place: int
    candidate: Candidate
    offset: float
    factor: float
    frozen: Callable[[Array], float]
    learner: OnlineOutput
    evidence: UpdateWeight
    checkpoints: Checkpoints
    waiting: deque[tuple[float, Array, float]] = field(default_factory=deque)

    def base(self, states: Log) -> Array:
        """(n,) the mean function, offset included, in the command's unit."""
        mean = self.candidate.mean
        part = np.zeros(len(states)) if mean is None else mean.predict(states)[:, self.place]
        return np.asarray(part + self.offset)

    def judge(self, t: float, x: Array, command: float, base: float) -> None:
        """Compares both models on a sample that neither has learned, and keeps it for later."""
        y = (command - base) / self.factor
        self.evidence.judge(y - self.frozen(x), y - self.mean(x))
        self.waiting.append((t, x, y))

    def mean(self, x: Array) -> float:
        """What the learner says in the process's units; NaN where it has lost its numbers."""
        try:
            return self.learner.mean(x)
        except FAILURES:
            return math.nan

    def drop(self, since: float) -> None:
        """Forgets what waits from that time on."""
        while self.waiting and self.waiting[-1][0] > since:
            self.waiting.pop()

    def set_back(self, now: float) -> bool:
        """The learner as it was some seconds ago, without evidence for it; whether it begins anew."""
        self.waiting.clear()
        self.evidence.forget()
        return self.checkpoints.back(now)

    def learned(self, due: float) -> bool | None:
        """Learns the oldest sample that waits, if its time is not after `due`.

        Returns:
            whether the learner took it; None if there was none.

        Raises:
            one of FAILURES: the learner may be anything now.
        """
        if not self.waiting or self.waiting[0][0] > due:
            return None
        t, x, y = self.waiting.popleft()
        try:
            self.learner.observe(x, y, t)
        except (DataError, UsageError):  # the learner is as it was
            return False
        return True


def learning_command(model: LearnedModel, j: int, config: OnlineConfig, rng: np.random.Generator) -> Command:
    """Command j of the model, ready to go on from its process, or from that beside its physics.

    Raises:
        UsageError: neither is exact or a dictionary.
    """
    chosen = model.chosen[j]
    for structure in (chosen, f"{chosen}+gp"):
        candidate = next((c for c in model.candidates if c.structure == structure and j in c.commands), None)
        posterior = None if candidate is None else _exact(candidate, j)
        if candidate is None or posterior is None:
            continue
        offset, factor = (float(unit) for unit in candidate.units[:, candidate.commands.index(j)])
        frozen = _point(candidate, posterior, j) if structure == chosen else _constant(-offset / factor)
        evidence = UpdateWeight(config.memory_s * config.rate_hz, posterior.noise_variance)
        learner = begin(posterior, config, rng)
        checkpoints = Checkpoints(learner, FIRST_S + STAGGER_S * j)
        return Command(j, candidate, offset, factor, frozen, learner, evidence, checkpoints)
    raise UsageError(
        f"{model.commands[j]} comes from the structure {chosen!r} by a process that cannot learn online",
        next_step="Train rung = 'gp' or 'identified+gp' with process = 'exact' or a dictionary.",
    )


def _exact(candidate: Candidate, j: int) -> ExactPosterior | None:
    process, place = candidate.process, candidate.commands.index(j)
    assert process is not None
    posteriors = process.own if isinstance(process, SupportsSeparate) else None
    posterior = posteriors[place] if isinstance(posteriors, tuple) else None
    if isinstance(process, Posteriors) and isinstance(posterior, BasisPosterior) and process.guides:
        posterior = process.guides[place]  # all samples taught it, through a few
    return posterior if isinstance(posterior, ExactPosterior) else None


def _point(candidate: Candidate, posterior: ExactPosterior, j: int) -> Callable[[Array], float]:
    """What the candidate says: by the posterior that goes on learning, or of all commands together."""
    process = candidate.process
    assert process is not None
    if isinstance(process, SupportsPoint):
        every, place = process.point(), candidate.commands.index(j)
        return lambda x: float(every(x)[place])
    mean = PointMean([posterior])
    return lambda x: float(mean(x)[0])


def _constant(value: float) -> Callable[[Array], float]:
    """A mean function drives alone: its process has nothing to say yet."""
    return lambda _: value
