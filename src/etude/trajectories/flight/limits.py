"""The room a flight has: what a FlightSpec leaves after its margin, or why it leaves none."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY
from etude.trajectories.flight.flatness import LEAST_LIFT

Array = NDArray[np.float64]

AXES = ("x", "y", "z")


def inner_box(spec: FlightSpec) -> tuple[Array, Array]:
    """Corners (3,), (3,) of the box less its margin, m."""
    margins = np.array(spec.margins)
    return np.asarray(spec.lower, dtype=float) + margins, np.asarray(spec.upper, dtype=float) - margins


def inner_radius(spec: FlightSpec) -> float:
    """Radius of the cylinder less its margin, m; infinite without one."""
    return math.inf if spec.radius is None else spec.radius - spec.margin


def lift_room(spec: FlightSpec) -> float:
    """How far the vertical part of a + g z may be from g on either side, m/s^2.

    Down to 0.3 g, where flatness ends, or to the least thrust; the same room upwards keeps the limit linear.
    """
    least = LEAST_LIFT * GRAVITY if spec.thrust is None else max(LEAST_LIFT * GRAVITY, spec.thrust[0])
    return GRAVITY - least


def check_flight_room(spec: FlightSpec) -> None:
    """Refuses limits that leave no room for any flight.

    Raises:
        UnsafeTrajectoryError: a box or cylinder no wider than its margins, a speed limit that is not
            positive, tilt outside (0, pi/2), thrust limits that do not hold the vehicle up.
    """
    low, high = inner_box(spec)
    for j, axis in enumerate(AXES):
        if not high[j] > low[j]:
            _refuse(
                f"the box is {spec.upper[j] - spec.lower[j]:g} m wide in {axis}, "
                f"not more than two margins of {spec.margins[j]:g} m",
                f"box, {axis}",
            )
    if spec.radius is not None and not spec.radius > spec.margin:
        _refuse(
            f"the cylinder's radius {spec.radius:g} m is not above the margin {spec.margin:g} m", "radius"
        )
    for margin in spec.margins:
        if not (math.isfinite(margin) and margin >= 0.0):
            _refuse(f"the margin must be a number of m >= 0, not {margin:g}", "margin")
    if not (math.isfinite(spec.speed) and spec.speed > 0.0):
        _refuse(f"no flight meets a speed limit of {spec.speed:g} m/s", "speed")
    if spec.tilt is not None and not 0.0 < spec.tilt < 0.5 * math.pi:
        _refuse(f"no flight meets a tilt limit of {spec.tilt:g} rad; it must be in 0..pi/2", "tilt")
    if spec.thrust is not None and not spec.thrust[0] < GRAVITY < spec.thrust[1]:
        text = f"{spec.thrust[0]:g}..{spec.thrust[1]:g} m/s^2"
        _refuse(f"the thrust limits {text} do not hold g, so the vehicle cannot hover", "thrust")


def check_start(spec: FlightSpec, position: Array) -> None:
    """Refuses a measured position (3,), m, from which a flight would begin outside its box or cylinder.

    Raises:
        UnsafeTrajectoryError: names the axis, the position and the limit.
    """
    for j, axis in enumerate(AXES):
        if not spec.lower[j] <= position[j] <= spec.upper[j]:
            limit = f"{spec.lower[j]:g}..{spec.upper[j]:g} m"
            _refuse(
                f"the flight would start at {axis} = {position[j]:g} m, outside {limit}", f"start, {axis}"
            )
    distance = float(np.hypot(position[0], position[1]))
    if spec.radius is not None and not distance <= spec.radius:
        text = f"{distance:g} m from the axis, outside the radius {spec.radius:g} m"
        _refuse(f"the flight would start {text}", "start, radius")


def _refuse(fact: str, where: str) -> None:
    raise UnsafeTrajectoryError(
        fact, where=where, next_step="Change the vehicle's file, or the vehicle's place."
    )
