"""A learner that can go back to what it was some seconds ago, or to where it began."""

from __future__ import annotations

from typing import Any

from etude_online.learner import OnlineOutput
from etude_online.state import put_back, taken

EVERY_S = 10.0
"""Between two checkpoints. One goes back to the older of two: the newest may hold the first bad samples."""
AGAIN_S = 30.0
"""A learner that has to go back again within this time begins anew."""


class Checkpoints:
    """States of one learner: its first, and two on the way.

    Args:
        learner: at its beginning.
        first: s after which the first one is kept, so that not all learners are copied in one tick.
    """

    MOVES = ("_kept", "_due", "_back")

    def __init__(self, learner: OnlineOutput, first: float) -> None:
        self._learner = learner
        self._begin: Any = taken(learner)
        self._kept: list[Any] = []
        self._due: float | None = None
        self._first, self._back = first, -float("inf")

    def keep(self, now: float) -> None:
        """Keeps the learner as it is, if it is time."""
        if self._due is None:
            self._due = now + self._first
        if now >= self._due:
            self._kept, self._due = [*self._kept[-1:], taken(self._learner)], now + EVERY_S

    def back(self, now: float) -> bool:
        """Sets the learner back; returns whether it begins anew."""
        anew = now - self._back < AGAIN_S or not self._kept
        put_back(self._learner, self._begin if anew else self._kept[0])
        self._kept, self._due, self._back = [], now + EVERY_S, now
        return anew
