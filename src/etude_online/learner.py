"""Learner interface: one output, one sample at a time; `methods` lists the implementations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from etude.errors import DataError, UsageError
from etude.types import Array

LARGEST = 1e50
"""Beyond it an output, or an input, is no number to learn from: its square is none."""


@dataclass(frozen=True)
class OnlineConfig:
    """How a model goes on learning.

    Attributes:
        method: a name in `methods.METHODS`.
        size: members of a dictionary or basis points of the sparse online process, at most; None for the
            method's own (`methods.DICTIONARY_SIZE`, `BASIS_SIZE`).
        frequencies: of a squared exponential term of the incremental spectrum, at most.
        half_life: s in which what a dictionary's member is worth halves, or in which a sample of the
            incremental spectrum comes to count half; None forgets nothing. The sparse online process cannot.
        rate_hz: samples learned per second and output, at most: neighbours of a smoothed motion repeat
            each other.
        window_s: length of the centred window that smooths and differentiates; samples come half of it late.
        hold_s: a sample is judged by the guard on arrival and learned this much later; from `window_s` on,
            nothing learned shares a measurement with what is judged.
        memory_s: of the guard, in seconds of samples.
        guarded: False takes the updated model as it is.
    """

    method: str = "variance"
    size: int | None = None
    frequencies: int = 60
    half_life: float | None = None
    rate_hz: float = 10.0
    window_s: float = 1.0
    hold_s: float = 1.0
    memory_s: float = 20.0
    guarded: bool = True

    def __post_init__(self) -> None:
        for name in ("size", "frequencies"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise UsageError(f"{name} must be at least 1, got {value}")
        for name in ("rate_hz", "window_s", "memory_s", "half_life"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} must be a positive number, got {value}")
        if not (math.isfinite(self.hold_s) and self.hold_s >= 0.0):
            raise UsageError(f"hold_s must be a number >= 0, got {self.hold_s}")


class Learner(Protocol):
    """One output that learns on line. Outputs are centred by the caller, always by the same offset."""

    @property
    def samples(self) -> int:
        """Samples learned since the start."""
        ...

    def observe(self, x: Array, y: float, t: float) -> None:
        """Learn the sample x (D,), y of time t in s.

        Raises, and is then as it was:
            UsageError: x has another shape. DataError: a value that is not finite, or a time that is not
                later than the last sample's (a clock that stands still).
        """
        ...

    def mean(self, x: Array) -> float:
        """Mean at one input x (D,); NaN if x is not finite. UsageError for another shape."""
        ...


class Method(Protocol):
    """What the methods behind it owe; given finite values of the right shape, and later times only.

    STATE_FIELDS names what `learner_state.taken` copies.
    """

    STATE_FIELDS: tuple[str, ...]

    def learn(self, x: Array, y: float, t: float) -> None: ...
    def mean(self, x: Array) -> float: ...


class OnlineOutput:
    """A method behind the checks that all of them owe (implements `Learner`)."""

    STATE_FIELDS = ("_method", "_last", "samples")

    def __init__(self, method: Method, inputs: int) -> None:
        self._method, self._inputs = method, inputs
        self._last = -math.inf
        self.samples = 0

    def observe(self, x: Array, y: float, t: float) -> None:
        """As `Learner.observe`."""
        self._check(x)
        if not (abs(y) < LARGEST and math.isfinite(t) and (np.abs(x) < LARGEST).all()):
            raise DataError(
                "a sample contains NaN or infinite values, or some beyond arithmetic", next_step="Skip it."
            )
        if not t > self._last:
            raise DataError(
                f"time stands still or runs backwards: {t} s after {self._last} s",
                next_step="Skip the sample, and look at the clock.",
            )
        self._method.learn(x, float(y), float(t))
        self._last = float(t)
        self.samples += 1

    def mean(self, x: Array) -> float:
        """As `Learner.mean`."""
        self._check(x)
        return self._method.mean(x) if np.isfinite(x).all() else math.nan

    def _check(self, x: Array) -> None:
        if x.shape != (self._inputs,):
            raise UsageError(f"expected one input of shape ({self._inputs},), got {x.shape}")
