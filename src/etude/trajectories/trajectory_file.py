"""Trajectories as JSON text with exact coefficients: what is written, certified and read back."""

from __future__ import annotations

import json
from typing import Any

from etude.errors import UsageError
from etude.trajectories.fourier import FourierTrajectory
from etude.trajectories.moves import PointToPoint


def to_json(trajectory: FourierTrajectory | PointToPoint) -> str:
    """JSON text; floats are printed so that they read back to the same bits."""
    if isinstance(trajectory, FourierTrajectory):
        content: dict[str, Any] = {
            "kind": "fourier",
            "coefficients": trajectory.coefficients.tolist(),
            "omega0": float(trajectory.omega0),
            "duration": float(trajectory.duration),
            "ramp": float(trajectory.ramp),
        }
    else:
        content = {
            "kind": "moves",
            "waypoints": trajectory.waypoints.tolist(),
            "peak_velocity": _table(trajectory.peak_velocity),
            "dwell": float(trajectory.dwell),
            "peak_acceleration": _table(trajectory.peak_acceleration),
        }
    return json.dumps(content, indent=1) + "\n"


def _table(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def from_json(text: str | bytes) -> FourierTrajectory | PointToPoint:
    """Inverse of `to_json`.

    Raises:
        UsageError: not JSON, an unknown kind, missing or unknown keys, or values that make no trajectory.
    """
    try:
        content = json.loads(text)
    except (ValueError, UnicodeDecodeError) as error:
        raise UsageError(f"the trajectory file is not JSON: {error}") from None
    if not isinstance(content, dict) or content.get("kind") not in ("fourier", "moves"):
        raise UsageError("the trajectory file has no known 'kind' (fourier or moves)")
    kind = FourierTrajectory if content.pop("kind") == "fourier" else PointToPoint
    try:
        return kind(**content)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the trajectory file does not describe a trajectory: {error}") from None
