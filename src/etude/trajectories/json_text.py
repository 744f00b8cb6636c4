"""The JSON form of trajectories: a strict reading in."""

from __future__ import annotations

import json

from etude.errors import UsageError
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint
from etude.trajectories.splined import Splined

FORMS: dict[str, type[FourierTrajectory] | type[PointToPoint] | type[Splined]] = {
    "fourier": FourierTrajectory,
    "moves": PointToPoint,
    "splined": Splined,
}


def from_json(text: str | bytes) -> FourierTrajectory | PointToPoint | Splined:
    """The trajectory that `to_json` wrote, of any form, bit for bit. Files of 0.1 say `kind` for `form`.

    Raises:
        UsageError: not JSON, an unknown form, missing or unknown keys, or values that make no trajectory.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the trajectory file is not JSON: {error}") from None
    key = "form" if isinstance(content, dict) and "form" in content else "kind"
    if not isinstance(content, dict) or content.get(key) not in FORMS:
        raise UsageError(f"the trajectory file's 'form' is not one of: {', '.join(FORMS)}")
    made_by = FORMS[content.pop(key)]
    try:
        return made_by(**content)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the trajectory file does not describe a trajectory: {error}") from None
