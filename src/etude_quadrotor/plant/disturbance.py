"""What nobody modelled: wind, and a battery that sags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import UsageError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """Changes during one flight; t is counted from its start.

    Attributes:
        wind: constant, world frame, m/s.
        gust: added to the wind at the top of one pulse (1 - cos)/2 from `gust_start` that lasts
            `gust_duration`, s (the discrete gust of the certification rules).
        sag: share of the supply lost at once.
        sag_rate: share lost per second; the motors get at least a tenth of what is commanded.
    """

    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_start: float = 0.0
    gust_duration: float = 1.0
    sag: float = 0.0
    sag_rate: float = 0.0

    def __post_init__(self) -> None:
        numbers = np.array(
            [*self.wind, *self.gust, self.gust_start, self.gust_duration, self.sag, self.sag_rate]
        )
        if not np.isfinite(numbers).all() or self.gust_duration <= 0.0 or not 0.0 <= self.sag < 1.0:
            raise UsageError(
                "the disturbance is impossible",
                where=str(self),
                next_step="Give finite numbers, a gust_duration above 0 and a sag in [0, 1).",
            )

    def over(self, t: Array) -> Array:
        """(T, 4) wind (world, m/s) and supply over its nominal value at times t (T,), s from the start."""
        phase = np.clip((t - self.gust_start) / self.gust_duration, 0.0, 1.0)
        pulse = 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
        wind = np.array(self.wind) + pulse[:, None] * np.array(self.gust)
        supply = np.clip(1.0 - self.sag - self.sag_rate * t, 0.1, None)
        return np.column_stack([wind, supply])
