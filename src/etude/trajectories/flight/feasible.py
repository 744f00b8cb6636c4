"""The feasible flights of a family: limits (3.4) as a convex set of parameters, valid for all times.

Each limit is asked of samples and shrunk so that it then holds at every time (maths of `extremes`): kappa for
what is linear in the coefficients, its root for the size of a vector, whose square has twice the degree.

Box, cylinder and speed are the thesis's. Largest thrust |a + g| is convex as well, and so is tilt, a cone
about the vertical. Least thrust is not: |a + g| >= c is replaced by its vertical part, which is linear and
implies it. Tilt is asked of a_z and of -a_z, since a bound for all times needs both sides; so flights that
climb hard and lean far at once are left out, although they would be allowed. Thrust and tilt are those of
a + g z; what drag adds has to fit into the limits' own reserve.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from etude.errors import UnsafeTrajectoryError
from etude.robots.flight_spec import FlightSpec
from etude.robots.vehicle import GRAVITY
from etude.trajectories.certificate import OVERSAMPLING
from etude.trajectories.extremes import ROOM, grid
from etude.trajectories.flight.family import FlightFamily
from etude.trajectories.flight.feasible_set import Cone, FeasibleSet
from etude.trajectories.flight.limits import AXES, check_flight_room, inner_box, inner_radius, lift_room
from etude.trajectories.fourier import series

Array = NDArray[np.float64]

SAMPLES = 24
"""Samples per degree of the set's own grid; it gives away 0.9 % of the linear limits."""
CERTIFIED = math.cos(math.pi / OVERSAMPLING)
"""Kept besides, so that the certificate's own bound, from other samples, cannot refuse the set's edge."""
TILT_ROOM = 1.0 - 4.0 * (1.0 - CERTIFIED)
"""The certificate of tilt bounds a polynomial as large as (1.7 g)^2; four times the room covers that."""


def feasible_flights(spec: FlightSpec, family: FlightFamily) -> FeasibleSet:
    """The set of parameters whose flights keep every limit of `spec` at all times, margin included.

    Raises:
        UnsafeTrajectoryError: limits that leave no room, or a fixed centre outside them.
    """
    check_flight_room(spec)
    centre = _hover(spec, family)
    near, kappa = grid(family.harmonics, SAMPLES)
    far, _ = grid(2 * family.harmonics, SAMPLES)
    room = kappa * CERTIFIED * ROOM
    low, high = inner_box(spec)
    position, offset = _rows(near, family, 0)
    half = 0.5 * room * (high - low)
    slabs = [position[j] / half[j] for j in range(3)]
    middle = [(0.5 * (high[j] + low[j]) - offset[j]) / half[j] for j in range(3)]
    lift = _rows(near, family, 2)[0][2] / (room * lift_room(spec))
    slabs.append(lift)
    middle.append(np.zeros(len(lift)))
    cones = [_ball("speed", *_rows(far, family, 1), math.sqrt(room) * spec.speed)]
    if spec.radius is not None:
        rows, offset = _rows(far, family, 0)
        cones.append(_ball("radius", rows[:2], offset[:2], math.sqrt(room) * inner_radius(spec)))
    acceleration = _rows(far, family, 2)[0]
    if spec.thrust is not None:
        up = np.zeros(acceleration.shape[:2])
        up[2] = GRAVITY
        cones.append(_ball("thrust", acceleration, up, math.sqrt(room) * spec.thrust[1]))
    if spec.tilt is not None:
        cones += _tilt(acceleration, math.tan(spec.tilt), kappa * TILT_ROOM * ROOM * GRAVITY)
    return FeasibleSet(np.concatenate(slabs), np.concatenate(middle), tuple(cones), centre)


def _rows(angles: Array, family: FlightFamily, order: int) -> tuple[Array, Array]:
    """Rows (3, M, P) and offsets (3, M) of the order-th derivative of x, y, z in the parameters."""
    whole = series(angles, family.harmonics, family.frequency)[order]
    return np.einsum("mc,jcp->jmp", whole, family.basis), (whole @ family.offset).T


def _ball(name: str, rows: Array, offset: Array, radius: float) -> Cone:
    return Cone(name, rows / radius, offset / radius, np.zeros(rows.shape[1:]))


def _tilt(acceleration: Array, tangent: float, reach: float) -> list[Cone]:
    """|a_xy| <= tan(tilt) (kappa g -+ a_z), both signs."""
    rows = acceleration[:2] / (tangent * reach)
    none, lift = np.zeros(rows.shape[:2]), acceleration[2] / reach
    return [Cone("tilt", rows, none, sign * lift) for sign in (-1.0, 1.0)]


def _hover(spec: FlightSpec, family: FlightFamily) -> Array:
    """Parameters (P,) that stand still in the middle of the room."""
    low, high = inner_box(spec)
    place = 0.5 * (low + high)
    if family.free_centre:
        place[:2] = _inside_both(place[:2], low[:2], high[:2], spec)
    else:
        place[:2] = family.centre
    outside = [axis for j, axis in enumerate(AXES) if not low[j] < place[j] < high[j]]
    if outside or not float(np.hypot(*place[:2])) < inner_radius(spec):
        raise UnsafeTrajectoryError(
            f"flights about x, y = {place[0]:g}, {place[1]:g} m have no room in the box or cylinder",
            where=", ".join(outside) or "radius",
            next_step="Move the family's centre, or widen the limits.",
        )
    table = np.zeros((2 * family.harmonics + 1, 3))
    table[0] = place
    return family.parameters(table)


def _inside_both(middle: Array, low: Array, high: Array, spec: FlightSpec) -> Array:
    """The point (2,) between the box's middle and its nearest point to the axis with the most room."""
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    points = middle + shares * (np.clip(0.0, low, high) - middle)
    room = np.minimum((points - low).min(axis=1), (high - points).min(axis=1))
    room = np.minimum(room, inner_radius(spec) - np.hypot(*points.T))
    return np.asarray(points[int(np.argmax(room))])
