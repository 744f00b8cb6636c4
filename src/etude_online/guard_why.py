"""Why a logged command is no law kp e + kd de/dt of its tracking error: what would explain it instead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from etude.types import Array

ENOUGH = 0.9
"""Part of the command's variation, about its mean in each log, from which something explains it."""
CLEARLY = 0.5
"""An integral is told only where it leaves at most that part of what a law without it leaves."""

NOTHING = "nothing is learned on line without."
SIGN = f"Turn the sign of the logged command, or leave the log out; {NOTHING}"
INTEGRAL = (
    "Very probably the controller integrates: with an integral of the error {part:.0f} % are explained "
    "(gain {gain:.3g} per s). Learning on line judges by a feedback of position and velocity alone: "
    "take the integral out and record again, or take another target (etude export --to c), which does not "
    "learn there."
)
CONSTANT = (
    "The command holds a constant beside the feedback ({part:.0f} % are explained with one): an offset of "
    f"its sensor, or gravity that the controller adds; log it as command_ff. Else {NOTHING}"
)
EITHER = (
    "Look at the sign and scale of the logged command; or the controller integrates, or adds what it knows "
    f"(gravity, friction): log that as command_ff. Else {NOTHING}"
)


def why(error: Array, slope: Array, total: Array, u: Array, group: NDArray[np.int64]) -> str:
    """What to do about a command that does not follow from its tracking error, in words.

    Args:
        error, slope, total: (n,) tracking error, its slope and its integral since the log began, by
            decision: rad (m), rad/s, rad s.
        u: (n,) the command less what was fed forward.
        group: (n,) which log each is of: an integral begins anywhere.
    """
    whole, (kp, _) = _explained([error, slope], u)
    if whole >= ENOUGH and kp < 0.0:
        return SIGN
    error, slope, total, u = (_about_means(values, group) for values in (error, slope, total, u))
    plain, (kp, _) = _explained([error, slope], u)
    if plain >= ENOUGH and kp > 0.0:
        return CONSTANT.format(part=100.0 * plain)
    part, (kp, _, ki) = _explained([error, slope, total], u)
    if part >= ENOUGH and min(kp, ki) > 0.0 and 1.0 - part <= CLEARLY * (1.0 - plain):
        return INTEGRAL.format(part=100.0 * part, gain=ki)
    return EITHER


def _about_means(values: Array, group: NDArray[np.int64]) -> Array:
    mean = np.bincount(group, values) / np.maximum(np.bincount(group), 1)
    return np.asarray(values - mean[group])


def _explained(columns: list[Array], u: Array) -> tuple[float, Array]:
    """Part of the squares of u that least squares on the columns explains, and their gains."""
    A = np.column_stack(columns)
    gains, *_ = np.linalg.lstsq(A, u, rcond=None)
    left = u - A @ gains
    return 1.0 - float(left @ left) / max(float(u @ u), np.finfo(float).tiny), np.asarray(gains, dtype=float)
