"""Trajectories as pure functions of time, and the families that motions are proposed from."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.trajectories.chain import segment_starts
    from etude.trajectories.config import FourierConfig
    from etude.trajectories.family import FourierFamily
    from etude.trajectories.fourier import FourierTrajectory
    from etude.trajectories.json_text import from_json
    from etude.trajectories.moves import PointToPoint, random_moves
    from etude.trajectories.splined import Splined

__all__ = [
    "FourierConfig",
    "FourierFamily",
    "FourierTrajectory",
    "PointToPoint",
    "Splined",
    "from_json",
    "random_moves",
    "segment_starts",
]
__getattr__, __dir__ = face(__name__)
