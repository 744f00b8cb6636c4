"""Iterative learning control: the command for one trajectory, from run to run of that trajectory.

The next feedforward is the last run's total command without its fast part: what feedback had to add is
learned, its noise is not. The low-pass looks both ways in time and has no lag. No model is assumed and none
is found: the command is a function of time, so it says nothing of another motion (thesis 2.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.errors import DataError, UsageError
from etude.logs import smooth
from etude.types import Array, Log, Motion, Row

COMMAND = "command"
CUTOFF_HZ = 2.0


@dataclass(frozen=True, eq=False)
class LearnedCommand:
    """Plays a command over time, of whatever robot (implements `protocols.Controller`).

    Attributes:
        t: (T,) s, the control ticks of the motion that it was learned on.
        values: (T, J) feedforward, command units.
    """

    t: Array
    values: Array

    def planned(self, motion: Motion) -> Array | None:
        """The command (T, J). UsageError: a motion with other ticks."""
        same = len(motion.t) == len(self.t) and np.allclose(motion.t, self.t, rtol=0.0, atol=1e-6)
        if not same:
            raise UsageError(
                f"the command was learned on a motion of {len(self.t)} ticks over {_span(self.t):g} s, "
                f"this one has {len(motion.t)} over {_span(motion.t):g} s",
                next_step="Iterative learning knows one motion only: repeat that, or learn this one.",
            )
        return self.values.copy()

    def command(self, t: float, row: Row) -> tuple[Array, Array]:  # noqa: ARG002
        """The command (J,) of the tick nearest to t; it knows no deviation of it: zeros."""
        value = self.values[int(np.argmin(np.abs(self.t - t)))]
        return value.copy(), np.zeros_like(value)

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way, only between two runs."""


def learned_command(log: Log, cutoff_hz: float = CUTOFF_HZ) -> LearnedCommand:
    """What the next repetition of this run's motion should be fed.

    Args:
        log: of one run on a uniform grid, with the total command; rest before t = 0 steadies the filter only.
        cutoff_hz: of the squared gain of a second-order Butterworth low-pass; inf keeps the command as it is.

    Raises:
        UsageError: a cutoff that is not positive.
        DataError: no command, or fewer than two rows at t >= 0.
    """
    if not cutoff_hz > 0.0:
        raise UsageError(f"a cutoff of {cutoff_hz} Hz passes nothing", next_step="Give a positive one.")
    moving = log.t >= 0.0
    if COMMAND not in log or np.count_nonzero(moving) < 2:
        raise DataError(
            "iterative learning needs the command of a run at t >= 0",
            where=log.source,
            next_step=f"Log {COMMAND} beside the motion.",
        )
    return LearnedCommand(log.t[moving], smooth(log.t, log[COMMAND], cutoff_hz).value[moving])


def _span(t: Array) -> float:
    return float(t[-1] - t[0]) if len(t) else 0.0
