"""How much of the updated model drives: a weight that provably loses little, and a bounded authority."""

from __future__ import annotations

import numpy as np

from etude.types import Array, Mask

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

    MOVES = ("L", "slow2", "fast2", "far", "_seen", "authority")

    def __init__(self, noise: Array, period: float) -> None:
        self._least = np.maximum(noise, 1e-12) ** 2
        self._slow, self._fast = period / SLOW_S, period / FAST_S
        self.L = np.full(len(noise), LEAST)
        self.slow2, self.fast2 = self._least.copy(), self._least.copy()
        self.far = np.zeros(len(noise))
        self._seen = 0
        self.authority = self._authority()

    @property
    def weight(self) -> Array:
        """(J,) in (0, 1)."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.L)))

    def decide(self, error: Array, offered: Array, raw: Array, *, clean: bool = True) -> Array:
        """Takes in one decision; returns delta (J,).

        Args:
            error: (J,) what the frozen model alone would have left to the feedback.
            offered: (J,) correction within the authority; raw: (J,) as the learner said it.
            clean: whether the measurements are believed. If not, weights can only fall.
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
        self._seen += 1
        square = np.minimum(error**2, SPIKE * self.slow2)
        self.slow2 += max(self._slow, 1.0 / self._seen) * (square - self.slow2)
        self.fast2 += max(self._fast, 1.0 / self._seen) * (square - self.fast2)
        self.slow2, self.fast2 = (np.maximum(s, self._least) for s in (self.slow2, self.fast2))
        wrong = np.abs(error - raw) / np.maximum(np.sqrt(self.slow2), np.abs(error))
        step = np.nan_to_num(np.minimum(wrong - FAR, FURTHEST), nan=FURTHEST)
        self.far = np.maximum(0.0, self.far + step)
        self.authority = self._authority()

    def _authority(self) -> Array:
        return np.asarray(AUTHORITY * np.sqrt(np.minimum(self.slow2, FASTER**2 * self.fast2)))
