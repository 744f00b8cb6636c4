"""How far an updated model is to be believed: both models' errors on samples that neither has learned."""

from __future__ import annotations

import math

NEEDED = 10.0
"""Squared noise deviations by which both models must have differed in sum before evidence outweighs doubt."""


class Guard:
    """The weight of an updated model beside the frozen one it started from.

    With errors e_f and e_u of both on a sample before it is learned, the combination f + w (u - f) has the
    error e_f - w (e_f - e_u). The weight is the w in [0, 1] of least squared error over the remembered
    samples, drawn towards 0 until the models have differed by more than noise:

        w = Σ e_f (e_f - e_u) / (Σ (e_f - e_u)² + NEEDED sn²).

    An updated model that predicts worse than the frozen one in every mixture gets the weight 0: the robot is
    driven by the frozen model, while the other goes on learning and may come back.

    Args:
        memory: samples after which a comparison counts 1/e.
        noise_variance: sn² of the output.
    """

    def __init__(self, memory: float, noise_variance: float) -> None:
        self._keep = math.exp(-1.0 / memory)
        self._doubt = NEEDED * noise_variance
        self._along, self._apart = 0.0, 0.0

    def judge(self, frozen_error: float, updated_error: float) -> None:
        """Take in one sample; one with an error that is not finite counts fully against the updated model."""
        if not math.isfinite(frozen_error):
            return
        if not math.isfinite(updated_error):
            self._along = min(self._along, 0.0)
            return
        gap = frozen_error - updated_error
        self._along = self._keep * self._along + frozen_error * gap
        self._apart = self._keep * self._apart + gap * gap

    @property
    def weight(self) -> float:
        """w in [0, 1]."""
        below = self._apart + self._doubt
        return min(max(self._along / below, 0.0), 1.0) if below > 0.0 else 0.0
