"""The motors' set-points in PX4's logs: as parts of full scale, or as pulse widths in older ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from etude.types import Array

MOTORS = ("actuator_motors", "actuator_outputs")
"""Where they stand, in the order in which they are looked for."""
PULSE = (800.0, 2200.0)
"""us: what a pulse to a motor may be."""
ROTORS = 4
"""Where PX4's parameter CA_ROTOR_COUNT does not say."""
SLOW = 50.0
"""Hz below which set-points of motors miss much of what they do."""

Dataset = Mapping[str, Array]
"""Field -> (T,); `timestamp` in us."""


def motors_of(
    instances: Sequence[Dataset], topic: str, parameters: Mapping[str, Any], said: list[str]
) -> tuple[Dataset, dict[str, Array]]:
    """Set-points of the motors, parts of full scale, numbered as PX4 does, and their topic's instance.

    Args:
        instances: of the topic; that whose outputs move is of the motors.
        topic: one of MOTORS.
        parameters: PX4's, at the beginning of the log.
        said: takes a sentence for whatever is to be known of them.
    """
    stem = "control" if topic == "actuator_motors" else "output"
    data = max(instances, key=lambda one: sum(moves(one, f"{stem}[{i}]") for i in range(ROTORS)))
    rate = (len(data["timestamp"]) - 1) / max(1e-6 * float(np.ptp(data["timestamp"].astype(float))), 1e-6)
    if rate < SLOW:
        said.append(
            f"Topic {topic} was recorded {rate:.3g} times a second, so little of what the motors did is in "
            "the log: set SDLOG_PROFILE on the vehicle to record it faster."
        )
    if topic == "actuator_motors":
        told = [i for i in range(12) if f"control[{i}]" in data and np.isfinite(data[f"control[{i}]"]).any()]
        return data, _stopped({f"motor_{i + 1}": data[f"control[{i}]"] for i in told}, said)
    count = int(parameters.get("CA_ROTOR_COUNT", 0)) or ROTORS
    told = [i for i in range(count) if f"output[{i}]" in data]
    said.append(f"Outputs 1 to {len(told)} of {topic} were taken for the motors.")
    return data, {f"motor_{i + 1}": _of_full(data[f"output[{i}]"], i, parameters, said) for i in told}


def _stopped(motors: dict[str, Array], said: list[str]) -> dict[str, Array]:
    """Set-points whose rows of NaN, by which PX4 says that it is disarmed, are 0."""
    off = np.all([np.isnan(values) for values in motors.values()], axis=0)
    if not np.any(off):
        return motors
    said.append(
        f"For {100 * off.mean():.3g} % of actuator_motors the vehicle is disarmed (NaN): its motors were "
        "taken for 0."
    )
    return {name: np.where(off, 0.0, values) for name, values in motors.items()}


def moves(data: Dataset, name: str) -> bool:
    """Whether a field is there and changes."""
    values = np.asarray(data.get(name, (0.0,)), dtype=np.float64)
    return bool(np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf))


def _of_full(pulses: Array, i: int, parameters: Mapping[str, Any], said: list[str]) -> Array:
    """Part of full scale of pulse widths in us, between the least and the largest that PX4 was set to."""
    median = float(np.nanmedian(pulses))
    if not PULSE[0] <= median <= PULSE[1]:
        said.append(f"Output {i + 1} is no pulse width (median {median:.4g}) and was taken as it is.")
        return pulses
    ends = []
    for end, usual in (("MIN", 1000.0), ("MAX", 2000.0)):
        names = (f"PWM_MAIN_{end}{i + 1}", f"PWM_MAIN_{end}", f"PWM_{end}")
        ends.append(next((float(parameters[n]) for n in names if parameters.get(n, -1) > 0), usual))
    low, high = ends
    return (pulses - low) / max(high - low, 1.0)
