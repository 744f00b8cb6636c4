"""The JSON form of trajectories, read strictly."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

from etude.errors import UsageError
from etude.protocols import Trajectory
from etude.trajectories.chain import Chain
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint
from etude.trajectories.splined import Splined


def _chain(parts: Sequence[Any]) -> Chain:
    return Chain(tuple((label, _from_content(part, SINGLE)) for label, part in parts))


SINGLE: dict[str, Callable[..., Trajectory]] = {
    "fourier": FourierTrajectory,
    "moves": PointToPoint,
    "splined": Splined,
}
FORMS: dict[str, Callable[..., Trajectory]] = {**SINGLE, "chain": _chain}


def from_json(text: str | bytes) -> Trajectory:
    """The trajectory that `to_json` wrote, of any form, bit for bit.

    Raises:
        UsageError: not JSON, an unknown form, missing or unknown keys, or values that make no trajectory.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the trajectory file is not JSON: {error}") from None
    return _from_content(content, FORMS)


def _from_content(content: Any, forms: dict[str, Callable[..., Trajectory]]) -> Trajectory:
    form = content.get("form") if isinstance(content, dict) else None
    if not isinstance(form, str) or form not in forms:
        raise UsageError(f"the trajectory file's 'form' is not one of: {', '.join(forms)}")
    values = {name: value for name, value in content.items() if name != "form"}
    try:
        return forms[form](**values)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the trajectory file does not describe a trajectory: {error}") from None
