"""Commands that nobody can look at, since the numbers at hand refuse even standing still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etude.errors import UnsafeTrajectoryError
from etude.limits.commands import LOOK, CommandLimit
from etude.limits.unseen import COMMANDS
from etude.protocols import Family, Limit, Trajectory
from etude.types import Array, Cone, Motion, Proof

LONGEST = 120.0
"""s, of motions for which rest at home is looked at."""


@dataclass(frozen=True, eq=False)
class OpenCommands:
    """Commands that nobody can look at, and why: a limit without rows, which says so on the certificate.

    Attributes:
        said: sentences for the list of what is not looked at.
        limit: the one that even rest does not keep.
        refused: why no motion may be asked for, and what to do; "" where a person knows that a limit is not
            real, or a log has shown it.
    """

    said: tuple[str, ...]
    limit: CommandLimit | None = None
    refused: tuple[str, str] = ("", "")
    looks_at: tuple[str, ...] = (COMMANDS,)
    name: str = "commands"

    @property
    def not_looked_at(self) -> tuple[str, ...]:
        """The reason."""
        return self.said

    def warned(self, trajectory: Trajectory) -> tuple[str, ...]:
        """What the certificate says first: by how much the mean of this motion is beyond its limits."""
        if self.limit is None:
            return ()
        low, high = _extremes(self.limit, trajectory)
        beyond = np.flatnonzero((high > self.limit.upper) | (low < self.limit.lower))
        if not len(beyond):
            return ()
        parts = [
            f"{self.limit.names[j]} {max(high[j], -low[j]):.3g} {self.limit.units[j]} of "
            f"{min(self.limit.upper[j], -self.limit.lower[j]):.3g}"
            for j in beyond
        ]
        return (
            f"Beyond the stated {self.limit.quantity} limits, by {self.limit.source}: {', '.join(parts)}. "
            "Whether the drives can give that nobody looked at.",
        )

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
    still = rest_at(home, limit.orders)
    mean, spread = limit.mean(still)[0], limit.spread(still, LONGEST)[0]
    over = np.maximum(mean + spread - limit.upper, limit.lower - mean + spread)
    if not np.any(over > 0.0):
        return limit
    j = int(np.argmax(over / (limit.upper - limit.lower)))
    most = f"{mean[j]:.3g} {limit.units[j]}" + (
        f" with a deviation of {spread[j]:.2g}" if spread.any() else ""
    )
    return OpenCommands(
        (
            f"Whether the drives can give the forces: {limit.source} says {most} of {limit.names[j]} at "
            f"rest at home, beyond {limit.lower[j]:.3g}..{limit.upper[j]:.3g}; one of them is wrong.",
        ),
        limit,
    )


def require_possible(limits: Sequence[Limit]) -> None:
    """UnsafeTrajectoryError where one of them says that no motion may be asked for."""
    for limit in limits:
        fact, next_step = getattr(limit, "refused", ("", ""))
        if fact:
            raise UnsafeTrajectoryError(fact, next_step=next_step)


def rest_at(pose: Array, orders: int) -> Motion:
    """One sample at rest at a pose (k,)."""
    still = Motion(np.zeros(1), np.zeros((orders, 1, len(pose))))
    still.orders[0, 0] = pose
    return still


def _extremes(limit: CommandLimit, trajectory: Trajectory) -> tuple[Array, Array]:
    """(J,) least and largest means at samples along all pieces."""
    means = [limit.mean(limit.along(piece, LOOK)) for _, _, piece in trajectory.pieces()]
    return np.min([m.min(axis=0) for m in means], axis=0), np.max([m.max(axis=0) for m in means], axis=0)
