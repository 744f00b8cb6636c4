"""Trajectories as pure functions of time, and the families that motions are proposed from."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.trajectories.chain import Chain, chained, segment_starts
    from etude.trajectories.config import FourierConfig
    from etude.trajectories.extremes import OVERSAMPLING, riesz_range
    from etude.trajectories.family import FourierFamily, suited_to
    from etude.trajectories.fourier import FourierTrajectory
    from etude.trajectories.json_text import from_json
    from etude.trajectories.moves import PointToPoint, random_moves
    from etude.trajectories.splined import Splined

__all__ = [
    "OVERSAMPLING",
    "Chain",
    "FourierConfig",
    "FourierFamily",
    "FourierTrajectory",
    "PointToPoint",
    "Splined",
    "chained",
    "from_json",
    "random_moves",
    "riesz_range",
    "segment_starts",
    "suited_to",
]
__getattr__, __dir__ = face(__name__)
