"""The room a flight has, and flights that test a controller in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from etude.limits.certificate import COMMANDS, SPEED
from etude.limits.feasible import FeasibleSet
from etude.limits.library import AxisLimit, NormLimit, TiltLimit
from etude.limits.limit_tables import made_limits
from etude.limits.samplers import boundary, uniform
from etude.protocols import Limit, Model, Trajectory
from etude.types import Array, Margins
from etude_quadrotor.channels import AXES
from etude_quadrotor.family import FlightConfig, flight_family
from etude_quadrotor.flatness import LEAST_LIFT
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY
from etude_quadrotor.ways import RoomLimit
from etude_quadrotor.ways import ways as ways_of

PLACES = (0, 1, 2)
UP = (0.0, 0.0, GRAVITY)
TEST_HARMONICS = 2
ATTITUDE_LAG = 1.0 / 6.5 + 0.02
"""s: PX4's MC_ROLL_P and MC_PITCH_P are 6.5 1/s by default, a Crazyflie's gains 6. A set-point is held
for 20 ms, half of which it is late, and acted on a step of the controller later.
"""
PLACE_GAIN = 0.95
"""1/s, PX4's MPC_XY_P: what a late acceleration has cost in speed is made up for by an error of the place."""
CUT = 0.9
"""Part of the vertical speeds that plans use: an autopilot cuts what is asked with its feedback."""
TEST_DURATION = 30.0
"""s, whatever flights a campaign trains on, so that these can be compared."""


def limits(
    spec: QuadrotorSpec, config: FlightConfig, margins: Margins, model: Model | None = None
) -> tuple[Limit, ...]:
    """Box, speed, cylinder, lift, thrust and tilt, then the owner's own; rest if the plan is to start and end
    so.

    Room for the tracking error is kept off box and cylinder: the owner's, or what was learned of it. Thrust
    and tilt are those of a + g z, without drag, which has to fit into their own reserve. The vertical part of
    a + g z ("lift") is held within what flatness needs, limits or not.
    """
    late = _late(spec, config, margins)
    lower, upper, kept = np.array(spec.lower), np.array(spec.upper), np.array(spec.margins)
    half = 0.25 * (upper - lower)[:2]  # at most half of what there is from the middle
    kept[:2] = np.maximum(kept[:2], np.minimum(late / PLACE_GAIN, half))
    up, room = (2,), lift_room(spec)
    lift = np.array([GRAVITY - room]), np.array([GRAVITY + room])
    found: list[Limit] = [
        RoomLimit("position", 0, AXES, lower, upper, margin=kept, margins=margins, ground=spec.floor),
        NormLimit(
            "speed",
            1,
            PLACES,
            spec.speed,
            margin=late,
            margins=margins,
            rest=config.rest,
            looks_at=(SPEED,),
        ),
    ]
    if spec.radius is not None:
        margin = max(spec.margin, min(late / PLACE_GAIN, 0.5 * spec.radius))
        found.append(NormLimit("radius", 0, (0, 1), spec.radius, margin=margin, margins=margins))
    if spec.plant is None:
        rates = np.array([-CUT * spec.descent]), np.array([CUT * spec.climb])
        found.append(AxisLimit("vertical speed", 1, ("vehicle",), *rates, axes=up))
    found.append(AxisLimit("lift", 2, ("vehicle",), *lift, axes=up, shift=GRAVITY))
    if spec.thrust is not None:
        least, most = spec.thrust
        found.append(NormLimit("thrust", 2, PLACES, most, least, UP, margins=margins, looks_at=(COMMANDS,)))
    tilts = [tilt for tilt in (spec.tilt, config.tilt) if tilt is not None]
    if tilts:
        found.append(TiltLimit(min(tilts), GRAVITY))
    return (*found, *made_limits(spec.limits, spec, model, margins))


def _late(spec: QuadrotorSpec, config: FlightConfig, margins: Margins) -> float:
    """m/s by which a real vehicle's speed may exceed the plan's, until a log has told: its acceleration comes
    late by the attitude's lag. That of a series is at most its speed, or half the room, times its highest
    frequency, or that squared.
    """
    if spec.plant is not None or any(np.any(np.asarray(sure) > 0.0) for _, sure in margins.values()):
        return 0.0
    highest = config.harmonics * config.series.omega0_range[1]
    half = 0.5 * float(np.hypot(*(np.array(spec.upper) - np.array(spec.lower))[:2]))
    fastest = min(spec.speed * highest, half * highest**2)
    tilts = [GRAVITY * math.tan(tilt) for tilt in (spec.tilt, config.tilt) if tilt is not None]
    return ATTITUDE_LAG * min([fastest, *tilts])


def lift_room(spec: QuadrotorSpec) -> float:
    """How far the vertical part of a + g z may be from g on either side, m/s^2.

    Down to 0.3 g, where flatness ends, or to the least thrust; the same room upwards keeps the limit linear.
    """
    least = LEAST_LIFT * GRAVITY if spec.thrust is None else max(LEAST_LIFT * GRAVITY, spec.thrust[0])
    return GRAVITY - least


def centred(spec: QuadrotorSpec, config: FlightConfig) -> FlightConfig:
    """With flights about `home` where nobody said a centre and the world's own is outside of the room."""
    margins, own = np.array(spec.margins)[:2], np.array(config.centre)
    low, high = np.array(spec.lower)[:2] + margins, np.array(spec.upper)[:2] - margins
    if config.free_centre or own.any() or ((low < own) & (own < high)).all():
        return config
    return replace(config, centre=(float(home(spec)[0]), float(home(spec)[1])))


def home(spec: QuadrotorSpec) -> Array:
    """(3,) m the middle of the box less its margin; with a cylinder, where it leaves most room on the way
    to its axis.
    """
    margins = np.array(spec.margins)
    low, high = np.array(spec.lower) + margins, np.array(spec.upper) - margins
    place = 0.5 * (low + high)
    reach = math.inf if spec.radius is None else spec.radius - spec.margin
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    points = place[:2] + shares * (np.clip(0.0, low[:2], high[:2]) - place[:2])
    room = np.minimum((points - low[:2]).min(axis=1), (high[:2] - points).min(axis=1))
    room = np.minimum(room, reach - np.hypot(*points.T))
    place[:2] = points[int(np.argmax(room))]
    return np.asarray(place)


def ways(spec: QuadrotorSpec, motion: Trajectory, pose: Array) -> tuple[Trajectory, Trajectory]:
    """From the pose to where the plan begins and back, with take-off and landing from the ground."""
    return ways_of(spec, motion, pose, float(home(spec)[2]), limits(spec, FlightConfig(), {}))


def trial_flights(
    spec: QuadrotorSpec, config: FlightConfig, rng: np.random.Generator
) -> Mapping[str, Trajectory]:
    """A flight uniform on the safe ones of the thesis's form (N = 2), and one on their edge."""
    own = FlightConfig(TEST_HARMONICS, TEST_DURATION, start=config.start)
    family = flight_family(centred(spec, own))
    feasible = FeasibleSet.of(limits(spec, own, {}), family, home(spec))
    drawn = {"uniform": uniform(rng, feasible)[0], "boundary": boundary(rng, feasible)[0]}
    return {name: family.trajectory(p) for name, p in drawn.items()}
