"""Motions of a vehicle: workspace, family, approach and return, and tests of a controller.

Approaches are septics with given jerk at both ends, so that attitudes are continuous. A plan that moves at
its ends may have no lead-in (`limits.lead_ins`). The approach then leads from rest into that motion, and the
return out of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from etude._runtime.rounding import whole_up
from etude.limits.certificate import COMMANDS, SPEED, certify, utilization
from etude.limits.feasible import FeasibleSet
from etude.limits.motion_limits import AxisLimit, NormLimit, TiltLimit
from etude.limits.robot_file_limits import made_limits
from etude.limits.samplers import boundary, uniform
from etude.protocols import Limit, Model, Trajectory
from etude.trajectories.chain import Chain, Part
from etude.trajectories.family import FourierFamily
from etude.trajectories.splined import Splined
from etude.types import Array, Margins, Proof
from etude_quadrotor.channels import AXES
from etude_quadrotor.config import FlightConfig
from etude_quadrotor.flatness import LEAST_LIFT
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY

PLACES = (0, 1, 2)  # x, y, z
UP = (0.0, 0.0, GRAVITY)
TEST_HARMONICS = 2  # harmonics of test flights, independent of designed ones
ATTITUDE_LAG = 1.0 / 6.5 + 0.02
"""s: PX4's MC_ROLL_P and MC_PITCH_P are 6.5 1/s by default, a Crazyflie's gains 6. A set-point is held
for 20 ms, so it is late by half of that, and takes effect one controller step later.
"""
PLACE_GAIN = 0.95
"""1/s, PX4's MPC_XY_P: a position error compensates the speed that a late acceleration lost."""
CUT = 0.9
"""Part of the vertical speeds that plans use: an autopilot clips set-point plus feedback."""
TEST_DURATION = 30.0
"""s: duration of test flights in every campaign, so that results are comparable."""


SAMPLES = 24
"""Points per degree of the feasible set's grid; it loses 0.9 % of the linear limits."""


def flight_family(config: FlightConfig) -> FourierFamily:
    """The family of x, y and z."""
    free = config.free_centre
    constants = (None if free else config.centre[0], None if free else config.centre[1], None)
    return FourierFamily.of(config.series, 3, constants, SAMPLES)


PEAK_SPEED, PEAK_ACCELERATION = 35.0 / 16.0, 84.0 / (5.0 * math.sqrt(5.0))
"""Largest derivatives of a septic from rest to rest over length and time 1."""
UNHURRIED, GENTLE, SHORTEST = 0.3, 0.5, 2.0
"""Approaches: part of the speed limit, acceleration m/s^2, and least duration s."""
ORDERS = 4  # position to jerk
STILL = 1e-9
"""m/s, m/s^2, ...: less is rest."""
UPRIGHT, SETTLED = 1e-4, 1e-3
"""m that a take-off or landing may deviate sideways, and the m/s, m/s^2 at its ends that count as rest:
receivers use single precision.
"""
LIFTED, RAMP = 0.03, 4.0
"""m that a take-off rises in its first s. An autopilot ramps thrust up when a set-point is above the ground
(PX4 for 3 s, MPC_TKO_RAMP_T, and 1 s for the motors, COM_SPOOLUP_TIME), and lags behind a faster rise.
"""
LASTING = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Durations that are tried for an approach into a moving motion, as factors of that of a straight line."""


@dataclass(frozen=True, eq=False)
class RoomLimit(AxisLimit):
    """Limit: the box less its margins; a vertical take-off or landing may pass below.

    Attributes:
        ground: height of the vehicle's centre on the ground, m.
    """

    ground: float = 0.0

    def prove(self, piece: Trajectory) -> Sequence[Proof]:
        """One row for each axis; for a take-off or landing, z begins at the ground."""
        rows = list(super().prove(piece))
        ends = piece.motion(np.array([0.0, piece.duration]), 3).orders
        sideways = max(row.proved_upper - row.proved_lower for row in rows[:2])
        stands = np.abs(ends[0, :, 2] - self.ground) <= UPRIGHT
        still = np.abs(ends[1:]).max() <= SETTLED
        if sideways <= UPRIGHT and stands.any() and still:
            rows[2] = replace(rows[2], lower=self.ground - UPRIGHT, tracking_margin=0.0, confidence=1.0)
        return rows


def standing(spec: QuadrotorSpec, over: Array) -> Array:
    """Position (3,) m of the vehicle on the ground below a place (3,)."""
    return np.array([over[0], over[1], spec.floor])


def approach_and_return(
    spec: QuadrotorSpec, motion: Trajectory, pose: Array, height: float, limits: Sequence[Limit]
) -> tuple[Trajectory, Trajectory]:
    """Approach from the pose to the plan's start, and return from its end.

    Args:
        spec: the vehicle. motion: the plan.
        pose: (3,) m of hover; lower than a flight may be, it means the ground.
        height: of the take-off, m.
        limits: select the approach to a plan that moves at its start.
    """
    low = spec.lower[2] + spec.margins[2]
    hover = np.array(pose, dtype=float)
    if pose[2] < low:
        hover[2] = height
    there, back = _between(spec, motion, hover, limits)
    if pose[2] < low:
        there = [("take-off", _take_off(spec, pose, hover)), *there]
        back = [*back, ("landing", _straight(spec, hover, pose))]
    return _one(there), _one(back)


def _between(
    spec: QuadrotorSpec, motion: Trajectory, hover: Array, limits: Sequence[Limit]
) -> tuple[list[Part], list[Part]]:
    """From hover to the plan, and back."""
    first, last = np.moveaxis(motion.motion(np.array([0.0, motion.duration]), ORDERS).orders, 1, 0)
    there = _transition(spec, at_rest(hover), first, limits)
    back = _transition(spec, last, at_rest(hover), limits)
    return [("approach", there)], [("return", back)]


def _one(parts: list[Part]) -> Trajectory:
    return parts[0][1] if len(parts) == 1 else Chain(tuple(parts))


def at_rest(place: Array) -> Array:
    """Position to jerk (4, 3) of hover."""
    return np.concatenate([place[None], np.zeros((ORDERS - 1, 3))])


def _transition(spec: QuadrotorSpec, start: Array, end: Array, limits: Sequence[Limit]) -> Splined:
    """From state to state (4, 3): straight between two states at rest, else the path with most slack."""
    straight = _straight(spec, start[0], end[0])
    if max(np.abs(start[1:]).max(), np.abs(end[1:]).max()) <= STILL:
        return straight
    tried = [
        Splined(
            np.array([0.0, _whole_set_points(spec, part * straight.duration)]), np.stack([start, end], axis=1)
        )
        for part in LASTING
    ]
    return min(tried, key=lambda path: max(utilization(row) for row in certify(path, limits).rows))


def _straight(spec: QuadrotorSpec, start: Array, end: Array) -> Splined:
    length = float(np.linalg.norm(end - start))
    slow = PEAK_SPEED * length / (UNHURRIED * spec.speed)
    lasting = max(slow, math.sqrt(PEAK_ACCELERATION * length / GENTLE), SHORTEST)
    points = np.stack([at_rest(start), at_rest(end)], axis=1)
    return Splined(np.array([0.0, _whole_set_points(spec, lasting)]), points)


def _take_off(spec: QuadrotorSpec, ground: Array, hover: Array) -> Splined:
    """A vertical rise, first with increasing thrust."""
    first = ground + LIFTED * (hover - ground) / np.linalg.norm(hover - ground)
    remainder = _straight(spec, first, hover)
    points = np.concatenate([at_rest(ground)[:, None], remainder.points], axis=1)
    return Splined(np.concatenate([[0.0], RAMP + remainder.times]), points)


def _whole_set_points(spec: QuadrotorSpec, seconds: float) -> float:
    """At least that duration (s), in a whole number of set-points."""
    return whole_up(seconds * spec.table_rate) / spec.table_rate


def limits(
    spec: QuadrotorSpec, config: FlightConfig, margins: Margins, model: Model | None = None
) -> tuple[Limit, ...]:
    """Box, speed, cylinder, lift, thrust and tilt, then the owner's own; rest if the plan starts and ends at
    rest.

    Box and cylinder are reduced by a tracking margin, the owner's or the learned one. Thrust and tilt are
    those of a + g z, without drag, which needs its own reserve. Flatness bounds the vertical part of a + g z
    ("lift") in any case.
    """
    late = _speed_margin(spec, config, margins)
    lower, upper, box_margin = np.array(spec.lower), np.array(spec.upper), np.array(spec.margins)
    half = 0.25 * (upper - lower)[:2]  # at most half of what there is from the middle
    box_margin[:2] = np.maximum(box_margin[:2], np.minimum(late / PLACE_GAIN, half))
    up, room = (2,), lift_room(spec)
    lift = np.array([GRAVITY - room]), np.array([GRAVITY + room])
    standard: list[Limit] = [
        RoomLimit("position", 0, AXES, lower, upper, margin=box_margin, margins=margins, ground=spec.floor),
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
        standard.append(NormLimit("radius", 0, (0, 1), spec.radius, margin=margin, margins=margins))
    if spec.plant is None:
        rates = np.array([-CUT * spec.descent]), np.array([CUT * spec.climb])
        standard.append(AxisLimit("vertical speed", 1, ("vehicle",), *rates, axes=up))
    standard.append(AxisLimit("lift", 2, ("vehicle",), *lift, axes=up, shift=GRAVITY))
    if spec.thrust is not None:
        least, most = spec.thrust
        standard.append(
            NormLimit("thrust", 2, PLACES, most, least, UP, margins=margins, looks_at=(COMMANDS,))
        )
    tilts = [tilt for tilt in (spec.tilt, config.tilt) if tilt is not None]
    if tilts:
        standard.append(TiltLimit(min(tilts), GRAVITY))
    return (*standard, *made_limits(spec.limits, spec, model, margins, AXES))


def _speed_margin(spec: QuadrotorSpec, config: FlightConfig, margins: Margins) -> float:
    """Margin of a real vehicle's speed until a log gives it, m/s: the attitude's lag delays its acceleration.

    The acceleration of a series is at most its speed times its highest frequency, or half the range times
    that frequency squared.
    """
    if spec.plant is not None or any(np.any(np.asarray(sure) > 0.0) for _, sure in margins.values()):
        return 0.0
    highest = config.harmonics * config.series.omega0_range[1]
    half = 0.5 * float(np.hypot(*(np.array(spec.upper) - np.array(spec.lower))[:2]))
    fastest = min(spec.speed * highest, half * highest**2)
    tilts = [GRAVITY * math.tan(tilt) for tilt in (spec.tilt, config.tilt) if tilt is not None]
    return ATTITUDE_LAG * min([fastest, *tilts])


def lift_room(spec: QuadrotorSpec) -> float:
    """Largest deviation of the vertical part of a + g z from g, m/s^2.

    It may fall to 0.3 g, where flatness ends, or to the least thrust. The same deviation upwards keeps the
    limit linear.
    """
    least = LEAST_LIFT * GRAVITY if spec.thrust is None else max(LEAST_LIFT * GRAVITY, spec.thrust[0])
    return GRAVITY - least


def centred(spec: QuadrotorSpec, config: FlightConfig) -> FlightConfig:
    """The configuration with flights about `home` if no centre is given and the origin is outside the box."""
    margins, centre = np.array(spec.margins)[:2], np.array(config.centre)
    low, high = np.array(spec.lower)[:2] + margins, np.array(spec.upper)[:2] - margins
    if config.free_centre or centre.any() or ((low < centre) & (centre < high)).all():
        return config
    return replace(config, centre=(float(home(spec)[0]), float(home(spec)[1])))


def home(spec: QuadrotorSpec) -> Array:
    """Middle (3,) m of the box less its margin; with a cylinder, the roomiest place towards its axis."""
    margins = np.array(spec.margins)
    low, high = np.array(spec.lower) + margins, np.array(spec.upper) - margins
    place = 0.5 * (low + high)
    reach = math.inf if spec.radius is None else spec.radius - spec.margin
    # 1 % of the distance is less than the tracking error of a flight
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    points = place[:2] + shares * (np.clip(0.0, low[:2], high[:2]) - place[:2])
    room = np.minimum((points - low[:2]).min(axis=1), (high[:2] - points).min(axis=1))
    room = np.minimum(room, reach - np.hypot(*points.T))
    place[:2] = points[int(np.argmax(room))]
    return np.asarray(place)


def approaches(spec: QuadrotorSpec, motion: Trajectory, pose: Array) -> tuple[Trajectory, Trajectory]:
    """From the pose to the plan's start and back, with take-off and landing from the ground."""
    return approach_and_return(spec, motion, pose, float(home(spec)[2]), limits(spec, FlightConfig(), {}))


def trial_flights(
    spec: QuadrotorSpec, config: FlightConfig, rng: np.random.Generator
) -> Mapping[str, Trajectory]:
    """A flight drawn uniformly from the safe ones of the thesis's form (N = 2), and one on their edge."""
    test_config = FlightConfig(TEST_HARMONICS, TEST_DURATION, start=config.start)
    family = flight_family(centred(spec, test_config))
    feasible = FeasibleSet.of(limits(spec, test_config, {}), family, home(spec))
    drawn = {"uniform": uniform(rng, feasible)[0], "boundary": boundary(rng, feasible)[0]}
    return {name: family.trajectory(p) for name, p in drawn.items()}
