"""Online learning: a learner for each command, a guard, a controller of all."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_online.guard_effort import Feedback, feedback_of
    from etude_online.learner import OnlineConfig
    from etude_online.online_model import OnlineModel
    from etude_online.planned_samples import Planned
    from etude_online.runtime import open_online

__all__ = [
    "Feedback",
    "OnlineConfig",
    "OnlineModel",
    "Planned",
    "feedback_of",
    "open_online",
]
__getattr__, __dir__ = face(__name__)
