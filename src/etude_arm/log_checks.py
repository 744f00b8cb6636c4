"""What a log of an arm may show beside its motion and commands: another rate than the robot's, brakes, and a
base that is mounted otherwise than the model file says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from etude.logs.checks.brake import brake_finding
from etude.logs.checks.mounting import mounting_finding
from etude.logs.checks.seen import seen
from etude.logs.cleaning.filters import median_rate
from etude.types import Array, Finding, Log
from etude_arm.spec import COMMAND, PATH, ArmSpec

CHECK = "robot rate"
ALIKE = 1.4
"""Of rates: below, it is a clock's inaccuracy or a bus's."""


def findings(spec: ArmSpec, log: Log) -> Sequence[Finding]:
    """Of each check, what it says of the log."""
    limit = np.array([axis.command for axis in spec.axes])
    return (_rate(spec, log), brake_finding(log, log.channels[COMMAND], limit), *_mounting(spec, log))


def _mounting(spec: ArmSpec, log: Log) -> tuple[Finding, ...]:
    """By the model file, where there is one and commands are forces."""
    from etude_arm.physics.mean import physics_of

    nominal = physics_of(spec, 0.0, False).get("nominal")
    motion = seen(log, log.channels[PATH[0]])
    if nominal is None or motion is None:
        return ()
    model = nominal(None).model

    def commands(gravity: Array, qd: Array, qdd: Array) -> Array:
        tree = replace(model.tree, gravity=gravity)
        return replace(model, tree=tree).predict(motion.q, qd, qdd)

    rest, none = np.zeros_like(motion.q), np.zeros(3)
    inertial, standing = commands(none, motion.qd, motion.qdd), commands(none, rest, rest)
    pulls = np.stack([commands(axis, rest, rest) - standing for axis in np.eye(3)], axis=2)
    found = mounting_finding(motion, inertial, pulls, model.tree.gravity)
    return () if found is None else (found,)


def _rate(spec: ArmSpec, log: Log) -> Finding:
    rate = median_rate(log.t)
    said = f"The log has {rate:.4g} rows a second, the robot file says {spec.rate:.4g}."
    if 1.0 / ALIKE < rate / spec.rate < ALIKE:
        return Finding(CHECK, "green", said)
    step = "If rows were thinned or the robot file is wrong, all is well; else the clock of the log is off."
    return Finding(CHECK, "yellow", said, step)
