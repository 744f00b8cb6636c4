"""An inverse dynamics model that goes on learning while the robot runs."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import EtudeError, UsageError
from etude.models.gp.exact import ExactPosterior
from etude.models.gp.single_point import PointMean
from etude.models.inverse_dynamics import InverseDynamicsModel
from etude.models.model_config import PHYSICS
from etude.models.online.guard import Guard
from etude.models.online.learner import OnlineConfig, OnlineOutput
from etude.models.online.methods import begin
from etude.models.online.window import CentredWindow, MotionSample

Array = NDArray[np.float64]


@dataclass
class Counts:
    """What became of the measurements: per output (dof,), but for `ignored`.

    Attributes:
        learned: samples. stuck: samples of a joint that stood still. refused: samples that the learner
            raised an error on. ignored: measurements not finite, or not later than the last.
    """

    learned: NDArray[np.int64]
    stuck: NDArray[np.int64]
    refused: NDArray[np.int64]
    ignored: int = 0


class OnlineModel:
    """One learner and one guard for each output of a trained model. Mutable; for one thread.

    Measurements come in by `observe`, tick by tick; `command` mixes the updated model into the frozen one.
    A sample is taken every 1/rate_hz from the middle of the window, skipped for joints slower than the
    training data's stick velocity, judged, and learned `hold_s` later; the outputs learn in turn, in
    different ticks, so that no tick pays for all of them.

    Args:
        model: of kind "gp" or "identified+gp", its processes exact or dictionaries.
        config: how to go on.
        rate: of the control ticks, Hz.
        rng: of what the learners draw.

    Raises:
        UsageError: a model that does not predict by such processes.
    """

    def __init__(
        self, model: InverseDynamicsModel, config: OnlineConfig, rate: float, rng: np.random.Generator
    ) -> None:
        posteriors = [p for p in model.posteriors if isinstance(p, ExactPosterior)]
        if model.kind in PHYSICS or len(posteriors) < model.dof:
            raise UsageError(
                f"a model of kind '{model.kind}' with such processes cannot go on learning",
                next_step="Train kind = 'gp' or 'identified+gp' with process = 'exact' or a dictionary.",
            )
        self.model, self.config = model, config
        self.learners: list[OnlineOutput] = [begin(posterior, config, rng) for posterior in posteriors]
        memory = config.memory_s * config.rate_hz
        self.guards = [Guard(memory, posterior.noise_variance) for posterior in posteriors]
        learned, stuck, refused = np.zeros((3, model.dof), dtype=np.int64)
        self.counts = Counts(learned, stuck, refused)
        self._window = CentredWindow(model.dof, rate, config.window_s)
        self._frozen = PointMean(posteriors)
        self._stride = max(1, round(rate / config.rate_hz))
        self._waiting: list[deque[tuple[float, Array, float]]] = [deque() for _ in posteriors]
        self._turn = [j * self._stride // model.dof for j in range(model.dof)]
        self._ticks = 0

    def observe(self, t: float, q: Array, tau: Array) -> int:
        """One control tick's measurement: time in s, measured position and applied command (dof,).

        Returns the number of samples that were learned.
        """
        self._window.push(t, q, tau)
        self.counts.ignored = self._window.ignored
        place = self._ticks % self._stride
        self._ticks += 1
        if place == 0:
            sample = self._window.middle()
            if sample is not None:
                self._judge(sample)
        return sum(self._teach(j, t) for j, turn in enumerate(self._turn) if turn == place)

    def command(self, x: Array, base: Array, frozen: Array) -> Array:
        """The command (dof,) at one planned instant, before clipping.

        Args:
            x: (D,) features. base: (dof,) the model's mean function there.
            frozen: (dof,) the feedforward of the model as it was trained.
        """
        out = frozen.copy()
        for j, (learner, weight) in enumerate(zip(self.learners, self.weights(), strict=True)):
            if weight > 0.0:
                updated = base[j] + learner.mean(x)
                if np.isfinite(updated):  # a learner that has lost its numbers never drives
                    out[j] += weight * (updated - frozen[j])
        return out

    def weights(self) -> list[float]:
        """What part of each output's command comes from its learner."""
        return [guard.weight if self.config.guarded else 1.0 for guard in self.guards]

    def _judge(self, sample: MotionSample) -> None:
        q, qd, qdd = sample.q[None], sample.qd[None], sample.qdd[None]
        x = self.model.features.transform(q, qd, qdd)[0]
        y = sample.tau - self.model.mean_function(q, qd, qdd)[0]
        stuck = np.abs(sample.qd) < self.model.stick_velocity
        self.counts.stuck += stuck
        frozen = self._frozen(x)
        for j in np.flatnonzero(~stuck):
            self.guards[j].judge(y[j] - frozen[j], y[j] - self.learners[j].mean(x))
            self._waiting[j].append((sample.t, x, float(y[j])))

    def _teach(self, j: int, now: float) -> bool:
        """Output j learns its oldest waiting sample, if that has waited long enough."""
        waiting, due = self._waiting[j], now - self.config.hold_s - 0.5 * self.config.window_s
        if not waiting or waiting[0][0] > due:
            return False
        t, x, y = waiting.popleft()
        try:
            self.learners[j].observe(x, y, t)
        except EtudeError:  # the learner is as it was
            self.counts.refused[j] += 1
            return False
        self.counts.learned[j] += 1
        return True
