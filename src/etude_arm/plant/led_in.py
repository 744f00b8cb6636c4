"""A run's plan at the control ticks: at rest in the first position for a while, then the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etude.errors import UsageError
from etude.types import Array, Motion
from etude_arm.plant.trace import LoopInputs
from etude_arm.spec import ORDERS, PATH, PLAN


@dataclass(frozen=True, eq=False)
class LedIn:
    """The whole run.

    Attributes:
        t: (T,) s, below 0 during the lead-in.
        orders: (3, T, J) desired motion; feedforward, noise: (T, J), of commands and of the encoder.
        fixed: whether the feedforward is known ahead.
    """

    t: Array
    orders: Array
    feedforward: Array
    noise: Array
    fixed: bool

    def inputs(self, substeps: int) -> LoopInputs:
        """As an engine takes it."""
        q, qd, qdd = self.orders
        return LoopInputs(q, qd, self.feedforward, self.noise, substeps, qdd)

    def row(self, k: int) -> dict[str, Array]:
        """What a perfect run would measure at tick k, and the plan."""
        return {name: self.orders[i % ORDERS, k] for i, name in enumerate((*PATH, *PLAN))}


def led_in(
    motion: Motion,
    feedforward: Array | None,
    held: int,
    rate: float,
    deviation: float | Array,
    rng: np.random.Generator | None,
) -> LedIn:
    """The motion after `held` ticks in its first position, with the first row of its feedforward.

    Args:
        motion: three orders at the control ticks.
        feedforward: (T, J), None if it is not known ahead.
        rate: Hz.
        deviation, rng: of the encoder's noise, rad (J,) or for all; None for no noise.
    """
    still = np.stack([motion.orders[0, 0], *np.zeros((2, motion.orders.shape[2]))])
    rows = np.concatenate([np.repeat(still[:, None], held, axis=1), motion.orders[:ORDERS]], axis=1)
    ff = np.zeros_like(motion.orders[0]) if feedforward is None else feedforward
    ff = np.concatenate([np.repeat(ff[:1], held, axis=0), ff]).astype(np.float64)
    return LedIn(
        t=np.concatenate([motion.t[0] - np.arange(held, 0, -1) / rate, motion.t]),
        orders=np.ascontiguousarray(rows),
        feedforward=ff,
        noise=np.zeros_like(ff) if rng is None else rng.normal(0.0, deviation, ff.shape),
        fixed=feedforward is not None,
    )


def control_times(duration: float, rate: float) -> Array:
    """Control ticks (T,) in [0, duration), s: 6000 of them in 60 s at 100 Hz."""
    if not 0.0 < duration < math.inf:
        raise UsageError(f"the trajectory lasts {duration} s", next_step="Give it a positive duration.")
    ticks: Array = np.arange(math.ceil(duration * rate - 1e-6)) / rate
    return ticks
