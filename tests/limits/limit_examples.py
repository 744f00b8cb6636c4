"""Limits, families and homes for the tests of this folder: arms of joints, and rooms of flights."""

from __future__ import annotations

import math

import numpy as np

from etude.limits import AxisLimit, FeasibleSet, NormLimit, TiltLimit
from etude.protocols import Limit
from etude.trajectories import FourierConfig, FourierFamily

GRAVITY = 9.81
LEAST_LIFT = 0.3

ARM_CONFIGS = {
    "null space": FourierConfig(),
    "two periods": FourierConfig(3, 20.0, 4.0 * np.pi / 20.0),
    "ramp, omega0 free": FourierConfig(2, 60.0, (0.105, 0.2), "ramp"),
    "one harmonic": FourierConfig(1, 15.0, 0.7, "ramp", 3.0),
}


def arm(seed: int = 0, joints: int = 3, jerk: float | None = None) -> tuple[AxisLimit, ...]:
    """Lopsided position limits of very different sizes, speeds and accelerations, rest at both ends."""
    rng = np.random.default_rng(seed)
    lower, upper, speed, bend = np.zeros((4, joints))
    for j in range(joints):
        lower[j] = rng.uniform(-3.0, 1.0)
        upper[j] = lower[j] + 10.0 ** rng.uniform(-1.0, 0.7)
        speed[j], bend[j], _ = 10.0 ** rng.uniform(-1.0, 1.0, 3)
    names = tuple(f"j{j}" for j in range(joints))
    found = (
        AxisLimit("position", 0, names, lower, upper),
        AxisLimit("velocity", 1, names, -speed, speed, rest=True),
        AxisLimit("acceleration", 2, names, -bend, bend),
    )
    return found if jerk is None else (*found, AxisLimit("jerk", 3, names, -jerk * bend, jerk * bend))


def middle(limits: tuple[Limit, ...]) -> np.ndarray:
    """(k,) a pose inside the limits of position, the first of the limits."""
    low, high, _, _ = limits[0].inner("fourier")
    return 0.5 * (low + high)


def room(
    lower=(-10.0, -10.0, 0.3),
    upper=(10.0, 10.0, 5.0),
    speed=6.0,
    radius=None,
    tilt=None,
    thrust=None,
    margin=0.5,
    rest=False,
) -> tuple[Limit, ...]:
    """Limits of a flight; the default is the thesis's box, 20 x 20 x 5 m, at 6 m/s."""
    least = LEAST_LIFT * GRAVITY if thrust is None else max(LEAST_LIFT * GRAVITY, thrust[0])
    free = GRAVITY - least
    lift = np.array([GRAVITY - free]), np.array([GRAVITY + free])
    found: list[Limit] = [
        AxisLimit("position", 0, ("x", "y", "z"), np.array(lower), np.array(upper), margin=margin),
        NormLimit("speed", 1, (0, 1, 2), speed, rest=rest),
    ]
    if radius is not None:
        found.append(NormLimit("radius", 0, (0, 1), radius, margin=margin))
    found.append(AxisLimit("lift", 2, ("vehicle",), *lift, axes=(2,), shift=GRAVITY))
    if thrust is not None:
        found.append(NormLimit("thrust", 2, (0, 1, 2), thrust[1], thrust[0], (0.0, 0.0, GRAVITY)))
    if tilt is not None:
        found.append(TiltLimit(tilt, GRAVITY))
    return tuple(found)


ROOMS = {
    "box": room(),
    "slow": room(speed=2.0),
    "cylinder": room((-1.5, -1.5, 0.3), (1.5, 1.5, 2.3), radius=1.5, speed=1.5, margin=0.2),
    "tilt": room(tilt=0.05),
    "all": room(speed=5.0, radius=9.0, tilt=0.3, thrust=(7.0, 11.0)),
}


def flights(harmonics=2, omega0=None, rest=False, free=False, samples=24, centre=(0.0, 0.0)) -> FourierFamily:
    """Flights of 30 s, x and y about a centre unless that is free too."""
    config = FourierConfig(harmonics, 30.0, omega0, "nullspace" if rest else "none")
    return FourierFamily.of(config, 3, None if free else (*centre, None), samples)


FLIGHTS = {
    "thesis": flights(),
    "aggressive": flights(5),
    "rest, free centre": flights(4, 4.0 * math.pi / 30.0, rest=True, free=True),
    "fast": flights(3, 1.3),
    "fast, on the proof's own grid": flights(3, 1.3, samples=64),
}


def feasible_arm(limits: tuple[AxisLimit, ...], config: FourierConfig, seed: int = 0):
    """A drawn family of as many axes as the limits have, and its feasible set."""
    family = FourierFamily.of(config, len(limits[0].names)).drawn(np.random.default_rng(seed))
    return family, FeasibleSet.of(limits, family, middle(limits))
