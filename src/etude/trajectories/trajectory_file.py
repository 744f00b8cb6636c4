"""Which kinds of trajectory a file may hold."""

from __future__ import annotations

from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.json_text import from_text
from etude.trajectories.moves import PointToPoint

KINDS: dict[str, type[FourierTrajectory] | type[PointToPoint]] = {
    "fourier": FourierTrajectory,
    "moves": PointToPoint,
}


def from_json(text: str | bytes) -> FourierTrajectory | PointToPoint:
    """The trajectory that `to_json` wrote, of any kind, bit for bit. UsageError for any other text."""
    return from_text(text, KINDS)
