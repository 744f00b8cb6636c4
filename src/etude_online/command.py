"""One command that goes on learning: from which rung it comes, what judges it, and what still waits."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from etude.errors import DataError, NumericalError, UsageError
from etude.models.gp.basis_posterior import BasisPosterior
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.single_point import PointMean
from etude.models.model import LearnedModel
from etude.protocols import Candidate
from etude.types import Array, Log
from etude_online.checkpoints import Checkpoints
from etude_online.evidence import Evidence
from etude_online.learner import OnlineConfig, OnlineOutput
from etude_online.methods import begin

FAILURES = (ArithmeticError, NumericalError, np.linalg.LinAlgError, ValueError, IndexError)
"""What arithmetic on numbers that make no sense may end in."""
FIRST_S, STAGGER_S = 5.0, 0.2
"""When a learner's first checkpoint is kept, and how much later that of the next command."""


@dataclass(eq=False)
class Command:
    """One command of a model, its learner in the units of a process.

    Attributes:
        place: of the command in the model. candidate: the rung whose process goes on learning.
        offset, factor: from the process's units to the command's.
        frozen: (D,) -> what the model as it was trained says, in the process's units and beside `base`.
        learner, evidence: of the command. checkpoints: of the learner.
        waiting: samples that were judged and not learned yet: time, input, output.
    """

    MOVES: ClassVar[tuple[str, ...]] = ("learner", "evidence", "checkpoints", "waiting")

    place: int
    candidate: Candidate
    offset: float
    factor: float
    frozen: Callable[[Array], float]
    learner: OnlineOutput
    evidence: Evidence
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
    for rung in (chosen, f"{chosen}+gp"):
        candidate = next((c for c in model.candidates if c.rung == rung and j in c.commands), None)
        posterior = None if candidate is None else _exact(candidate, j)
        if candidate is None or posterior is None:
            continue
        offset, factor = (float(unit) for unit in candidate.units[:, candidate.commands.index(j)])
        frozen = _point(candidate, posterior, j) if rung == chosen else _constant(-offset / factor)
        evidence = Evidence(config.memory_s * config.rate_hz, posterior.noise_variance)
        learner = begin(posterior, config, rng)
        kept = Checkpoints(learner, FIRST_S + STAGGER_S * j)
        return Command(j, candidate, offset, factor, frozen, learner, evidence, kept)
    raise UsageError(
        f"{model.commands[j]} comes from the rung {chosen!r} by a process that cannot go on learning",
        next_step="Train rung = 'gp' or 'identified+gp' with process = 'exact' or a dictionary.",
    )


def _exact(candidate: Candidate, j: int) -> ExactPosterior | None:
    place, own = candidate.commands.index(j), getattr(candidate.process, "own", None)
    found = own[place] if isinstance(own, tuple) else None
    guides = getattr(candidate.process, "guides", None)
    if isinstance(found, BasisPosterior) and guides:  # all samples taught it, through a few
        found = guides[place]
    return found if isinstance(found, ExactPosterior) else None


def _point(candidate: Candidate, posterior: ExactPosterior, j: int) -> Callable[[Array], float]:
    """What the candidate says: by the posterior that goes on learning, or of all commands together."""
    together = getattr(candidate.process, "point", None)
    if together is not None:
        every, place = together(), candidate.commands.index(j)
        return lambda x: float(every(x)[place])
    mean = PointMean([posterior])
    return lambda x: float(mean(x)[0])


def _constant(value: float) -> Callable[[Array], float]:
    """A mean function drives alone: its process has nothing to say yet."""
    return lambda _: value
