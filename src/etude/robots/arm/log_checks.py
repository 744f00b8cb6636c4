"""What a log of an arm may show beside its motion and commands: another rate than the robot's, brakes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.contracts import Finding, Log
from etude.logs.steps import median_rate
from etude.logs.truth.brake import brake_finding
from etude.robots.arm.spec import COMMAND, ArmSpec

CHECK = "robot rate"
ALIKE = 1.4
"""Of rates: below, it is a clock's inaccuracy or a bus's."""


def findings(spec: ArmSpec, log: Log) -> Sequence[Finding]:
    """Of each check, what it says of the log."""
    limit = np.array([axis.command for axis in spec.axes])
    return (_rate(spec, log), brake_finding(log, log.channels[COMMAND], limit))


def _rate(spec: ArmSpec, log: Log) -> Finding:
    rate = median_rate(log.t)
    said = f"The log has {rate:.4g} rows a second, the robot file says {spec.rate:.4g}."
    if 1.0 / ALIKE < rate / spec.rate < ALIKE:
        return Finding(CHECK, "green", said)
    step = "If rows were thinned or the robot file is wrong, all is well; else the clock of the log is off."
    return Finding(CHECK, "yellow", said, step)
