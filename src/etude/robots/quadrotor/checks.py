"""What a log of a flight may show beside units and ranges: time on the ground, commands of another scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.contracts import Finding, Log, Mask
from etude.robots.quadrotor.spec import QuadrotorSpec
from etude.robots.quadrotor.vehicle import GRAVITY

STILL = 0.05
"""rad/s and parts of g: motion below which a vehicle may stand."""
IDLE = 0.05
"""Of a command's range: motors that carry nothing."""
LONG_S = 1.0
HOVER = (0.5, 2.0)
"""Over the hover voltage: what the mean command of a flight may be."""


def findings(spec: QuadrotorSpec, log: Log) -> Sequence[Finding]:
    """Of each check, what it says of the flight."""
    return (_ground(spec, log), _scale(spec, log))


def _ground(spec: QuadrotorSpec, log: Log) -> Finding:
    """Motors that idle while nothing moves: take-off or landing is in the log, and teaches nothing."""
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    idle = (log["command"] <= low + IDLE * (high - low)).all(axis=1)
    still = (np.abs(log["rates"]) < STILL).all(axis=1)
    lift = np.linalg.norm(log["specific_force"], axis=1)
    spans = _spans(log, idle & still & (np.abs(lift / GRAVITY - 1.0) < STILL))
    if not spans:
        return Finding("ground", "green", "The motors carry the vehicle throughout.")
    seconds = sum(end - start for start, end in spans)
    return Finding(
        "ground",
        "yellow",
        f"The vehicle seems to stand on the ground for {seconds:.3g} s.",
        "Cut take-off and landing away, or trim with first_s and last_s.",
        flag="Does it fly throughout?",
        spans=spans,
    )


def _spans(log: Log, marked: Mask) -> tuple[tuple[float, float], ...]:
    """Stretches of time (s) that are marked for LONG_S or longer."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    found = [(float(log.t[a]), float(log.t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return tuple((start, end) for start, end in found if end - start >= LONG_S)


def _scale(spec: QuadrotorSpec, log: Log) -> Finding:
    """Of a vehicle whose motors are described: the voltage that it hovers at, against that of the flight."""
    vehicle = spec.body
    if vehicle is None:
        return Finding("scale", "cannot tell", "The motors of the vehicle are not described in V.")
    mean = float(np.mean(log["command"]))
    said = f"The mean command is {mean:.3g} V, it should hover at {vehicle.hover_voltage:.3g} V."
    if HOVER[0] < mean / vehicle.hover_voltage < HOVER[1]:
        return Finding("scale", "green", said)
    step = "Check mass, thrust_constant, motor_constant and resistance in robot.toml, and the commands' unit."
    return Finding("scale", "yellow", said, step, flag="Is the vehicle described right?")
