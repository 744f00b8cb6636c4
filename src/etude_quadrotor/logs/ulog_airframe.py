"""Which airframe a PX4 log is of: what its actuators are is only known of a quadrotor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from etude.errors import DataError

STATUS = "vehicle_status"
"""The topic that repeats MAV_TYPE as `system_type`, and says `vehicle_type` and `is_vtol`."""
QUADROTOR, ROTORS = 2, 4
# MAV_TYPE of MAVLink's common.xml; the same numbers stand in vehicle_status.system_type
TYPES: Mapping[int, str] = {
    1: "a fixed-wing aircraft",
    3: "a coaxial helicopter",
    4: "a helicopter",
    7: "an airship",
    10: "a ground rover",
    11: "a boat",
    12: "a submarine",
    13: "a hexarotor",
    14: "an octorotor",
    15: "a tricopter",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
    29: "a dodecarotor",
    35: "a decarotor",
}
AIRFRAMES: Mapping[int, str] = {
    1: "a fixed-wing aircraft",
    **dict.fromkeys((2, 3, 4), "a VTOL aircraft"),
    5: "a rover",
    6: "a rover",
    7: "an underwater vehicle",
    10: "a helicopter",
    11: "a helicopter",
}
"""Of PX4's parameter CA_AIRFRAME; 0 is a multirotor, the others may be anything."""
VEHICLES: Mapping[int, str] = {2: "a fixed-wing aircraft", 3: "a rover", 4: "an airship"}
"""vehicle_status.vehicle_type; 1 is a rotary wing."""


def require_quadrotor(parameters: Mapping[str, Any], status: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Refuses the log of another airframe, whose actuators would be taken for four motors.

    Args:
        parameters: PX4's, at the beginning of the log. status: instances of STATUS.

    Raises:
        DataError: it says which airframe it is, and by what.
    """
    found = _other(parameters, status[0] if status else {})
    if found is None:
        return
    name, said = found
    raise DataError(
        f"the vehicle of this log is {name} ({said}), and only quadrotors are supported",
        where=str(path),
        next_step="Bring a log of a quadrotor, with MAV_TYPE 2; --topic NAME reads a topic as recorded.",
    )


def _other(parameters: Mapping[str, Any], status: Mapping[str, Any]) -> tuple[str, str] | None:
    """What it is and what says so; None for a quadrotor, and where nothing says what it is."""
    if int(_first(status, "is_vtol", 0)):
        return "a VTOL aircraft", f"{STATUS}.is_vtol"
    for said, number in (
        ("MAV_TYPE", int(parameters.get("MAV_TYPE", 0))),
        (f"{STATUS}.system_type", int(_first(status, "system_type", 0))),
    ):
        if number not in (0, QUADROTOR):
            return TYPES.get(number, "no quadrotor"), f"{said} {number}"
    frame = int(parameters.get("CA_AIRFRAME", 0))
    if frame in AIRFRAMES:
        return AIRFRAMES[frame], f"CA_AIRFRAME {frame}"
    kind = int(_first(status, "vehicle_type", 1))
    if kind in VEHICLES:
        return VEHICLES[kind], f"{STATUS}.vehicle_type {kind}"
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    if count not in (0, ROTORS):
        return f"a vehicle of {count} rotors", f"CA_ROTOR_COUNT {count}"
    return None


def _first(data: Mapping[str, Any], name: str, missing: int) -> float:
    """What most rows of a topic say, or what is assumed where it has no such field."""
    values = np.asarray(data.get(name, ()))
    return float(np.median(values)) if len(values) else missing
