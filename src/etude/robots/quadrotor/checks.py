"""What a log of a flight must be like: gravity, rates and commands in their units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.contracts import Finding, Log
from etude.robots.quadrotor.recorded import IN_G, accelerometer
from etude.robots.quadrotor.spec import QuadrotorSpec
from etude.robots.quadrotor.vehicle import GRAVITY

FASTEST = 10.0
"""rad/s, in the mean over a flight."""
SATURATED = 0.99
"""A command this near to its limit throughout says nothing of the motion."""
OUTSIDE, STRAYS = 0.05, 0.01
"""How far beyond its range, in parts of it, and in which part of the samples a command is out of range."""


def findings(spec: QuadrotorSpec, log: Log) -> Sequence[Finding]:
    """Of each check, what it says of the flight: red where nothing can be learned from it."""
    return (*_gravity(log), *_rates(log), *_commands(spec, log))


def _gravity(log: Log) -> list[Finding]:
    """In flight the thrust carries the weight: the accelerometer's usual length is about g."""
    size = accelerometer(log)
    if 0.5 * GRAVITY < size < 2.0 * GRAVITY:
        return [Finding("gravity", "green", f"The accelerometer's usual length is {size:.3g} m/s^2.")]
    if IN_G[0] < size < IN_G[1]:
        sentence = "The accelerations look like parts of g, and are taken for that."
        return [Finding("gravity", "yellow", sentence, "State the unit in the header, acc_x [g].")]
    return [
        Finding(
            "gravity",
            "red",
            f"the accelerometer's length is {size:.3g} m/s^2, not about {GRAVITY}",
            "State the unit in the header, acc_x [g] for example; cut take-off and landing away.",
        )
    ]


def _rates(log: Log) -> list[Finding]:
    fast = float(np.sqrt(np.mean(log["rates"] ** 2)))
    if fast <= FASTEST:
        return [Finding("rates", "green", f"The rates are {fast:.3g} rad/s in the mean.")]
    return [
        Finding(
            "rates",
            "red",
            f"rates of {fast:.3g} rad/s on average look like degrees per second",
            "State the unit in the header, gyro_x [deg/s], or tell with --degrees.",
        )
    ]


def _commands(spec: QuadrotorSpec, log: Log) -> list[Finding]:
    command, found = log["command"], []
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    room = OUTSIDE * (high - low)
    outside = (command < low - room) | (command > high + room)
    for j, name in enumerate(spec.command_names):
        if outside[:, j].mean() > STRAYS:
            found.append(
                Finding(
                    "command",
                    "red",
                    f"command '{name}' reaches {command[:, j].max():.4g}, not {low[j]:g} to {high[j]:g}",
                    "State the unit in the header, or correct the limits in robot.toml.",
                )
            )
        elif (command[:, j] >= low[j] + SATURATED * (high[j] - low[j])).all():
            found.append(
                Finding(
                    "command",
                    "red",
                    f"command '{name}' is at its limit throughout: it says nothing of the motion",
                    "Fly with less payload, a fuller battery, or gentler limits.",
                )
            )
    return found or [Finding("command", "green", "The commands are within their limits.")]
