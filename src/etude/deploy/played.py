"""The certificate of what a receiver plays of a file: the curve that it makes of the bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from etude.contracts import Exporter, Limit, Proof, Trajectory
from etude.errors import UnsafeTrajectoryError, UsageError
from etude.limits.certificate import Certificate, certify, spare
from etude.trajectories.splined import Splined

SLACK = 1e-6
"""Part of a limit's width by which a curve through points may exceed what was proved of the motion."""


@dataclass(frozen=True)
class Looked:
    """A limit of which a curve may prove nothing: its row then says so instead of an error."""

    limit: Limit

    def __getattr__(self, name: str) -> Any:
        return getattr(self.limit, name)

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """The limit's rows, or one that was not looked at, with the reason."""
        try:
            return self.limit.prove(piece)
        except UsageError as problem:
            nan = math.nan
            row = Proof("all", self.limit.name, nan, nan, nan, nan, problem.fact, "not looked at")
            return [row]


def certify_played(
    exporter: Exporter, files: Mapping[str, bytes], limits: Sequence[Limit], form: str
) -> Certificate:
    """What the receiver of these files plays, held against the limits.

    Args:
        exporter: its attribute `back` reads the files as their receiver does.
        files: what it wrote.
        limits: of the robot.
        form: of the motion that was exported; its tracking margins hold.

    Raises:
        UnsafeTrajectoryError: the curve leaves a limit by more than SLACK of its width.
    """
    played = exporter.back(files)  # type: ignore[attr-defined]
    if isinstance(played, Splined):
        played = replace(played, like=form)
    found = certify(played, [Looked(limit) for limit in limits])
    for row in found.failed:
        if not spare(row) >= -SLACK * (row.upper - row.lower):
            raise UnsafeTrajectoryError(
                f"as its receiver plays it, {row.quantity} of '{row.axis}' may reach "
                f"{row.proved_lower:.6g}..{row.proved_upper:.6g}, outside {row.lower:.6g}..{row.upper:.6g}",
                where=f"{row.axis}, {row.quantity}",
                next_step="Ask for another format, or at a lower speed: etude ask --speed 50.",
            )
    return found
