"""Commands that nobody can look at, since the numbers at hand refuse even standing still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.contracts import Array, Cone, Family, Motion, Proof, Trajectory
from etude.limits.commands import CommandLimit
from etude.limits.unseen import COMMANDS

LONGEST = 120.0
"""s, of motions for which rest at home is looked at."""


@dataclass(frozen=True, eq=False)
class OpenCommands:
    """Commands that nobody can look at, and why: a limit without rows, which says so on the certificate."""

    said: tuple[str, ...]
    looks_at: tuple[str, ...] = (COMMANDS,)
    name: str = "commands"

    @property
    def not_looked_at(self) -> tuple[str, ...]:
        """The reason."""
        return self.said

    def cones(self, family: Family) -> Sequence[Cone]:  # noqa: ARG002
        """None."""
        return ()

    def penalty(self, motion: Motion) -> tuple[float, Array] | None:  # noqa: ARG002
        """None."""
        return None

    def prove(self, piece: Trajectory) -> Sequence[Proof]:  # noqa: ARG002
        """No row."""
        return ()

    def of_motion(self, motion: Motion) -> Array:
        """(T, 0)."""
        return np.zeros((len(motion.t), 0))


def kept_at(limit: CommandLimit, home: Array) -> CommandLimit | OpenCommands:
    """The limit; or, where standing still at `home` (k,) is beyond it already, why it cannot be looked at.

    Then no motion keeps it, and what is wrong is the model's numbers or its deviation, not the motion.
    """
    still = Motion(np.zeros(1), np.zeros((limit.orders, 1, len(home))))
    still.orders[0, 0] = home
    mean, spread = limit.mean(still)[0], limit.spread(still, LONGEST)[0]
    over = np.maximum(mean + spread - limit.upper, limit.lower - mean + spread)
    if not np.any(over > 0.0):
        return limit
    j = int(np.argmax(over / (limit.upper - limit.lower)))
    most = f"{mean[j]:.3g} {limit.unit}" + (f" with a deviation of {spread[j]:.2g}" if spread.any() else "")
    return OpenCommands(
        (
            f"Whether the drives can give the forces: {limit.source} says {most} of {limit.names[j]} at "
            f"rest at home, beyond {limit.lower[j]:.3g}..{limit.upper[j]:.3g}; one of them is wrong.",
        )
    )
