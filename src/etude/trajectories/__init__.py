"""Trajectories as pure functions of time, and the families that motions are proposed from."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.trajectories.family import FourierConfig as FourierConfig
    from etude.trajectories.family import FourierFamily as FourierFamily

PUBLIC = ("chain", "family", "fourier", "json_text", "moves")
"""Modules that may be used from outside."""
__getattr__, __dir__ = face(
    __name__,
    {
        "FourierConfig": "family",
        "FourierFamily": "family",
    },
)
