"""The channels of a vehicle's logs. World frame: z up; body frame: x forward, y left, z up; SI units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from etude.types import Channel, Expected, Log, Role
from etude_quadrotor.spec import QuadrotorSpec
from etude_quadrotor.vehicle import GRAVITY

AXES = ("x", "y", "z")
PATH = "position"
"""The channel that is compared with the trajectory."""


def _vector(
    name: str, unit: str, role: Role = "state", *, required: bool = False, derivative_of: str = ""
) -> Channel:
    return Channel(name, AXES, (unit,) * 3, role, required, derivative_of)


ALTITUDE = Channel("altitude", ("z",), ("m",))
"""Above ground."""
SPECIFIC_FORCE = _vector("specific_force", "m/s^2", required=True)
"""Reading of an accelerometer, R_body_world (a + g z), body frame."""
RATES = _vector("rates", "rad/s", required=True)
"""Body frame."""
ANGULAR_ACCELERATION = _vector("angular_acceleration", "rad/s^2", derivative_of="rates")
BODY_VELOCITY = _vector("body_velocity", "m/s")
"""Of the centre through still air, body frame."""
BODY_ACCELERATION = _vector("body_acceleration", "m/s^2")
"""R_body_world a, without gravity: the thesis's own input."""
BATTERY = Channel("battery_voltage", ("pack",), ("V",))
"""Not a function of the motion: plans assume the value of `battery.usual_voltage`."""
STATES = (ALTITUDE, SPECIFIC_FORCE, RATES, ANGULAR_ACCELERATION, BODY_VELOCITY, BODY_ACCELERATION)
"""Possible inputs of a model that are functions of the motion."""

IN_WORDS = (
    "Axes of the body: x forward, y left, z up; rates turn by the right hand. specific_force is what an "
    "accelerometer reads, 9.81 along z while hovering; body_velocity is through still air; body_acceleration "
    "is without gravity; altitude is above ground."
)
"""Text for users who have only a header."""

POSITION = _vector(PATH, "m", "aside")
VELOCITY = _vector("velocity", "m/s", "aside", derivative_of=PATH)
"""World frame."""
ORIENTATION = Channel("orientation", ("w", "x", "y", "z"), ("1",) * 4, "aside")
"""Unit quaternion, world <- body."""
ATTITUDE = Channel("attitude", ("roll", "pitch", "yaw"), ("rad",) * 3, "aside")
"""The same as angles, z-y'-x''."""
POSITION_DES = _vector(f"{PATH}_des", "m", "plan")
VELOCITY_DES = _vector("velocity_des", "m/s", "plan", derivative_of=POSITION_DES.name)
ACCELERATION_DES = _vector("acceleration_des", "m/s^2", "plan", derivative_of=VELOCITY_DES.name)
ATTITUDE_DES = Channel("attitude_des", ("roll", "pitch", "yaw"), ("rad",) * 3, "plan")
RATES_DES = _vector("rates_des", "rad/s", "plan")
THRUST_DES = Channel("thrust_des", ("z",), ("m/s^2",), "plan")
"""Per mass."""
PLANNED = (POSITION_DES, VELOCITY_DES, ACCELERATION_DES, ATTITUDE_DES, RATES_DES, THRUST_DES)


def command(spec: QuadrotorSpec) -> Channel:
    """Channel of the commands, in the vehicle's unit."""
    reach = tuple(max(abs(a), abs(b)) for a, b in zip(spec.command_lower, spec.command_upper, strict=True))
    return Channel(
        "command", spec.command_names, (spec.command_unit,) * len(reach), "command", True, reach=reach
    )


def readable(spec: QuadrotorSpec) -> tuple[Channel, ...]:
    """Every channel that a log of the vehicle may have; a log needs the required ones."""
    furthest = tuple(max(abs(a), abs(b)) for a, b in zip(spec.lower, spec.upper, strict=True))
    position = replace(POSITION, reach=furthest)
    asides = (position, VELOCITY, ORIENTATION, ATTITUDE)
    return (command(spec), *STATES, BATTERY, *asides, *PLANNED)


USUAL_RATE = 200.0
"""Hz; flight recorders write 10 to 1000 times a second, so the unit of time can be told."""


def expected(spec: QuadrotorSpec) -> Expected:
    """Ranges for the checks of a log: workspace, speed, commands."""
    lower, upper = np.array(spec.lower), np.array(spec.upper)
    speed = np.full(3, spec.speed)
    limits = {
        PATH: (lower, upper),
        "velocity": (-speed, speed),
        "command": (np.array(spec.command_lower), np.array(spec.command_upper)),
    }
    return Expected(USUAL_RATE, upper - lower, limits, rest=False)


STILL = ("rates", "angular_acceleration", "body_velocity", "body_acceleration")


def hovering(log: Log) -> Log:
    """The log level and at rest at each altitude; missing channels stay missing."""
    weight = np.tile([0.0, 0.0, GRAVITY], (len(log), 1))
    still = log.put(SPECIFIC_FORCE, weight)
    for name in STILL:
        if name in log:
            still = still.put(log.channels[name], np.zeros_like(log[name]))
    return still
