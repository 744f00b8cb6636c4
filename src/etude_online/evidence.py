"""How far an updated model is to be believed: both models' errors on samples that neither has learned."""

from __future__ import annotations

import math

NEEDED = 10.0
"""Squared noise deviations by which both models must have differed in sum before evidence outweighs doubt."""
MOST = 1e50
"""An error beyond it is no number to reckon with: its square is none."""


class Evidence:
    """The weight of an updated model beside the frozen one it started from.

    With errors e_f and e_u of both on a sample before it is learned, the combination f + w (u - f) has the
    error e_f - w (e_f - e_u). The w in [0, 1] of least squared error over the remembered samples, drawn
    towards 0 until the models have differed by more than noise, is

        w* = Σ e_f (e_f - e_u) / (Σ (e_f - e_u)² + NEEDED sn²).

    It is above 1/2 where the updated model by itself errs less than the frozen one. The weight is the smooth
    step w*² (3 - 2 w*), nearer to 0 where that is the worse model and to 1 where it is the better: without
    it, a model that is wrong by far would serve, with a tiny weight, as an estimate of the other's bias.
    On the remembered samples either of the two errs no more than the frozen model.

    An updated model that gets no weight goes on learning and may come back.

    Args:
        memory: samples after which a comparison counts 1/e.
        noise_variance: sn² of the output.

    Attributes:
        weight: in [0, 1], after the last comparison. noise: sn of the output.
    """

    MOVES = ("_along", "_apart", "weight")

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
        if not abs(frozen_error) < MOST:
            return
        if abs(updated_error) < MOST:
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
