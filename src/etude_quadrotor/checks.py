"""What a log of a flight may show beside units and ranges: ground, leaps, scales, sensors that disagree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.logs.checks.ground import CHECK, ground_finding, windows
from etude.logs.checks.plausibility import jump_finding
from etude.types import Finding, Log
from etude_quadrotor.agreement import agreement_findings
from etude_quadrotor.channels import PATH
from etude_quadrotor.spec import QuadrotorSpec

HOVER = (0.5, 2.0)
"""Over the hover voltage: what the mean command of a flight may be."""


def findings(spec: QuadrotorSpec, log: Log) -> Sequence[Finding]:
    """Of each check, what it says of the flight."""
    jump = jump_finding(log, PATH, np.full(3, spec.speed))
    return (_ground(spec, log), *_idle(log), jump, *agreement_findings(spec, log), _scale(spec, log))


def _idle(log: Log) -> tuple[Finding, ...]:
    """A vehicle that was never armed: its log teaches nothing."""
    if np.ptp(log["command"], axis=0).any():
        return ()
    fact = "No motor's command ever changes: the vehicle was not armed, or they were not recorded."
    return (Finding("motors", "red", fact, "Record a flight, with the motors' set-points."),)


def _ground(spec: QuadrotorSpec, log: Log) -> Finding:
    """Motors that carry nothing while nothing moves: what a take-off or a landing leaves, which teaches
    nothing.
    """
    low, high = np.array(spec.command_lower), np.array(spec.command_upper)
    motors = low >= 0.0  # other commands are angles and rates, whose middle is no thrust
    if not motors.any():
        return Finding(CHECK, "cannot tell", "No command is that of a motor.")
    throttle = (log["command"] - low)[:, motors] / (high - low)[motors]
    return ground_finding(windows(log.t, log["rates"], log["specific_force"], throttle))


def _scale(spec: QuadrotorSpec, log: Log) -> Finding:
    """Of a vehicle whose motors are described: the voltage that it hovers at, against that of the flight."""
    vehicle = spec.body
    if vehicle is None:
        return Finding("scale", "cannot tell", "The motors of the vehicle are not described in V.")
    mean = float(np.mean(log["command"]))
    said = f"The mean command is {mean:.3g} V, it should hover at {vehicle.hover_voltage:.3g} V."
    if HOVER[0] < mean / vehicle.hover_voltage < HOVER[1]:
        return Finding("scale", "green", said)
    step = "Is the vehicle described right? Check mass, thrust_constant, motor_constant and resistance in "
    return Finding("scale", "yellow", said, f"{step}robot.toml, and the commands' unit.")
