"""Motions of an arm: family, limits, approach and return, and tests."""

from __future__ import annotations

import math

import numpy as np

from etude.limits.motion_limits import AxisLimit
from etude.limits.robot_file_limits import made_limits
from etude.protocols import Limit, Model, Trajectory
from etude.trajectories.config import FourierConfig
from etude.trajectories.extremes import USABLE_PART
from etude.trajectories.family import FourierFamily, suited_to
from etude.trajectories.moves import PointToPoint, random_moves
from etude.types import Array, Margins
from etude_arm.clearance.robot_clearance import clearance_of, ranges_of, search_of
from etude_arm.command_limits import commands_of
from etude_arm.space.space_limit import space_of
from etude_arm.spec import ArmSpec
from etude_arm.velocity_envelope import envelope_of

MOVES = 12  # of a test motion: about a minute
TEST_DURATION = 60.0
"""s, of the test series."""
TEST_RAMP = 2.0
"""s, of its phase ramps."""
EXCURSION = 0.8
"""Part of its range, a turn at most, that a joint goes through in a segment about a clear pose, about."""
UNHURRIED = 0.5
"""Part of the limits of velocity and acceleration that approach and return use."""


def family(spec: ArmSpec, config: FourierConfig) -> FourierFamily:
    """Fourier series of every joint; without omega0, one period that suits the likely path."""
    lower, upper = usual_excursion(spec)
    suited = suited_to(config, lower, upper, spec.velocity, spec.acceleration)
    return FourierFamily.of(suited, axes=spec.dof)


def limits(spec: ArmSpec, margins: Margins, model: Model | None = None) -> tuple[Limit, ...]:
    """Limits of the joints: position, velocity, acceleration, rest at both ends, and optional ones.

    The optional ones are jerk, velocity envelopes, commands, clearance and limits in space; the owner's own
    are last.
    """
    clearance = clearance_of(spec, margins)
    space = space_of(spec)
    commands = commands_of(spec, model, search_of(spec)[0])
    jerked = tuple(int(j) for j in np.flatnonzero(np.isfinite(spec.jerk)))
    jerk = [spec.names[j] for j in jerked], spec.jerk[list(jerked)]
    envelopes = [axis.envelope for axis in spec.axes]
    envelope = envelope_of(spec.names, envelopes, spec.velocity, margins)
    return (
        AxisLimit("position", 0, spec.names, spec.lower, spec.upper, margins=margins),
        AxisLimit("velocity", 1, spec.names, -spec.velocity, spec.velocity, margins=margins, rest=True),
        AxisLimit("acceleration", 2, spec.names, -spec.acceleration, spec.acceleration, margins=margins),
        *((AxisLimit("jerk", 3, tuple(jerk[0]), -jerk[1], jerk[1], jerked),) if jerked else ()),
        *(() if envelope is None else (envelope,)),
        *(() if commands is None else (commands,)),
        *(() if space is None else (space,)),
        *(() if clearance is None else (clearance,)),
        *made_limits(spec.limits, spec, model, margins, spec.names),
    )


def usual_excursion(spec: ArmSpec) -> tuple[Array, Array]:
    """Ends (k,) of each joint's usual path in a motion, rad (m): a part of the range for an arm with
    obstacles, else all of it.
    """
    home, lower, upper = search_of(spec)
    if clearance_of(spec, {}) is None:
        return lower, upper
    low, high = ranges_of(spec)
    half = 0.5 * EXCURSION * (high - low)
    return home - half, home + half


def largest_error(spec: ArmSpec) -> Array:
    """Largest position errors (J,), rad (m), that the feedback gains allow; NaN for unknown gains.

    At an extremum of the error its rate is zero, so the whole command is kp e. A simulated arm's gains are
    known.
    """
    gains = None if spec.gains is None else spec.gains.kp
    if gains is None and spec.plant is not None:
        from etude_arm.plant.parameters import load_parameters, plant_names

        gains = load_parameters(spec.plant).controller.kp if spec.plant in plant_names() else None
    return np.full(spec.dof, np.nan) if gains is None else spec.command / np.array(gains)


def approaches(spec: ArmSpec, motion: Trajectory, pose: Array) -> tuple[PointToPoint, PointToPoint]:
    """Straight moves in joint space from the pose to the start, and from the end to the pose."""
    first, last = motion.motion(np.array([0.0, motion.duration]), 1).orders[0]
    speeds = UNHURRIED * spec.velocity, UNHURRIED * spec.acceleration
    return tuple(  # type: ignore[return-value]
        PointToPoint(
            np.stack(ends), speeds[0], peak_acceleration=speeds[1], peak_jerk=USABLE_PART * spec.jerk
        )
        for ends in ((pose, first), (last, pose))
    )


def tests(spec: ArmSpec, rng: np.random.Generator) -> dict[str, Trajectory]:
    """Motions that are never learned.

    They do not depend on the campaign's family, so that settings can be compared. They are the thesis's form
    (3.5) with N = 2, one to two periods long, and point-to-point moves. For a robot with obstacles, they stay
    in the box of nearly clear poses.
    """
    from etude.limits.feasible import FeasibleSet
    from etude.limits.samplers import scaled

    period = 2.0 * math.pi / TEST_DURATION
    thesis = FourierConfig(2, TEST_DURATION, (period, 2.0 * period), rest="ramp", ramp=TEST_RAMP)
    drawn = family(spec, thesis).drawn(rng)
    home, lower, upper = search_of(spec)
    room = FeasibleSet.of(limits(spec, {}), drawn, home)
    box = lower, upper, spec.velocity, spec.acceleration
    return {
        "fourier": drawn.trajectory(scaled(rng, room)[0]),
        "moves": random_moves(rng, *box, count=MOVES, jerk=spec.jerk),
    }
